"""Where the shipped configuration lies: scenes, controller scripts and the robot's parameter file."""

import os
from collections.abc import Iterator
from pathlib import Path


def config_folder() -> Path:
    """Return the folder of the shipped configuration.

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
    candidates = list(_candidates(Path(__file__).resolve().parents[1]))
    for folder in candidates:
        if folder.is_dir():
            return folder
    looked_for = ", ".join(map(str, candidates))
    raise FileNotFoundError(f"vibro_ros is installed without its config folder (looked for {looked_for}); reinstall it")


def _candidates(package: Path) -> Iterator[Path]:
    """Yield the folders that config/ may be, the most specific first.

    Parameters
    ----------
    package : Path
        The folder of the imported package, links resolved.
    """
    if (package.parent / "package.xml").is_file():
        yield package.parent / "config"
    # <prefix>/lib/python3.x/site-packages/vibro_ros; Debian puts `local/` before `lib/`.
    underlays = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    for prefix in [*package.parents[:5], *map(Path, underlays)]:
        yield prefix / "share" / "vibro_ros" / "config"
