"""The optimum as a scene file, which `load_scene` and `robot --params-file` take."""

from pathlib import Path

import yaml

from vibro_ros.model.scene import Scene
from vibro_ros.process.untrusted import replace_file


def write_scene(path: Path, scene: Scene, comment: str) -> None:
    """Write every parameter of `scene`, so that the file depends on no other; `comment` is its first line (OSError)."""
    values = {name: value for name, value in scene.parameters.items()}
    text = yaml.safe_dump({"/**": {"ros__parameters": {"scene": "paper", **values}}}, sort_keys=False)
    replace_file(path, f"# {comment}\n{text}".encode())
