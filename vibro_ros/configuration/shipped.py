"""The files that come with the package, found by name or by path: scenes, command maps, controller scripts, sweeps."""

import os
from pathlib import Path

FOLDERS = {"scene": ("scenes", ".yaml"), "map": ("maps", ".json"), "script": ("controller", ".yaml"),
           "sweep": ("studies", ".yaml")}
"""Folder below `config_folder()`, and end of the file's name, of each kind of file."""


def shipped(kind: str) -> tuple[str, ...]:
    """Names of the files of a kind of `FOLDERS` that come with the package, in order."""
    folder, suffix = FOLDERS[kind]
    return tuple(sorted(path.stem for path in (config_folder() / folder).glob(f"*{suffix}")))


def find_file(kind: str, name_or_path: str, folder: Path | None = None) -> Path:
    """The file of a shipped name, or of a path, which starts from `folder` or the current one if it is relative.

    Raises
    ------
    ValueError
        When there is neither; the message names those that are shipped.
    """
    if name_or_path in shipped(kind):
        place, suffix = FOLDERS[kind]
        return config_folder() / place / f"{name_or_path}{suffix}"
    path = (folder or Path()) / name_or_path
    if os.path.isfile(path):  # which is false, not an error, for a name that no file can have
        return path
    raise ValueError(f"{name_or_path or repr('')}: neither a shipped {kind} nor a file; shipped {kind}s are "
                     f"{', '.join(shipped(kind))}")


def config_folder() -> Path:
    """The folder of the shipped configuration: scenes, maps, controller scripts and the robot's parameter file.

    The same call serves a source checkout, a pip installation and a colcon workspace.

    Returns
    -------
    Path
        Absolute; holds `robot.yaml`, `scenes/` and `controller/`.

    Raises
    ------
    FileNotFoundError
        If the package was installed without its data; one line that names where it was looked for.
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
