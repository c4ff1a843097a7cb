"""Write the shipped scenes' robots as URDF to config/urdf, which is installed into the package's share folder."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tools.generated_text import given_file
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.messages.urdf import robot_description


def write_urdf(scene: str, folder: Path) -> Path:
    """Write the URDF of a shipped scene or a scene file into a folder (ValueError if that fails)."""
    loaded = load_scene(scene)
    file = folder / f"{loaded.name}.urdf"
    with given_file(file):
        folder.mkdir(parents=True, exist_ok=True)
        file.write_text(robot_description(loaded), encoding="utf-8")
    return file


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=shipped_scenes(), metavar="SCENE",
                        help="a shipped scene's name, or a scene file (default: every shipped scene)")
    parser.add_argument("--output", type=Path, default=Path("config/urdf"), help="folder (default: %(default)s)")
    options = parser.parse_args(words)
    for scene in options.scenes:
        print(f"{write_urdf(scene, options.output)}: written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
