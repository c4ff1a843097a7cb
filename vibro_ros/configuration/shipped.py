"""The files that come with the package, found by name or by path: scenes, controller scripts, sweeps."""

import os
from pathlib import Path

from vibro_ros.model.parameters import nearest
from vibro_ros.process.files import user_path

FOLDERS = {"scene": ("scenes", ".yaml"), "script": ("controller", ".yaml"), "sweep": ("studies", ".yaml")}
"""Folder below `config_folder()` and file suffix of each kind of file."""


def shipped(kind: str) -> tuple[str, ...]:
    """Return the names, sorted, of the files of a kind in `FOLDERS` that come with the package."""
    folder, suffix = FOLDERS[kind]
    return tuple(sorted(path.stem for path in (config_folder() / folder).glob(f"*{suffix}")))


def find_file(kind: str, name_or_path: str, folder: Path | None = None) -> Path:
    """Return the path of a shipped file or of a user's; a relative path starts from `folder` or the current folder.

    ValueError when there is neither a shipped file of this name nor a file at this path; the message lists the shipped
    ones.
    """
    if name_or_path in shipped(kind):
        place, suffix = FOLDERS[kind]
        return config_folder() / place / f"{name_or_path}{suffix}"
    path = (folder or Path()) / user_path(name_or_path)
    if os.path.isfile(path):  # false, not an error, for an impossible file name
        return path
    names = f"shipped {kind}s are {', '.join(shipped(kind))}"
    if not name_or_path:
        raise ValueError(f"no {kind} is given; give the path of a file, or a shipped one: {names}")
    question = nearest(name_or_path, shipped(kind))
    raise ValueError(f"{name_or_path}: neither a shipped {kind} nor a file; {question}{' ' * bool(question)}{names}")


def config_folder() -> Path:
    """Return the folder of the shipped configuration: scenes, scripts, sweeps and the robot's parameter file.

    It is found in a source checkout, a pip installation and a colcon workspace. FileNotFoundError if the package was
    installed without its data.
    """
    package = Path(__file__).resolve().parents[1]
    # <prefix>/lib/python3.x/site-packages/vibro_ros; Debian puts `local/` before `lib/`.
    underlays = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    candidates = [prefix / "share" / "vibro_ros" / "config"
                  for prefix in [*package.parents[:5], *map(Path, underlays)]]
    if (package.parent / "package.xml").is_file():
        candidates.insert(0, package.parent / "config")
    for folder in candidates:
        if folder.is_dir():
            return folder
    looked_for = ", ".join(map(str, candidates))
    raise FileNotFoundError(f"vibro_ros is installed without its config folder (looked for {looked_for}); reinstall it")
