"""Folders of bags: their names, their files, whether a bag is still being recorded, and which bags are not sealed."""

import contextlib
import fcntl
import os
import re
from collections.abc import Iterable, Iterator
from datetime import datetime
from itertools import count, islice
from pathlib import Path

from vibro_ros.bag.metadata import FILE_NAME
from vibro_ros.process.files import kind_of

BAG_PATTERN = "vibro_robot_*"  # pattern of the names that `bag_folders` gives

LONGEST_NAMESPACE = 150
"""Longest part [characters] of a namespace in a folder's name; file systems allow 255 for the whole name."""

MOST_ENTRIES = 100_000  # most files of a folder that are examined

SUFFIX = ".mcap"
_FOREIGN = {".db3": "is of the storage sqlite3; `ros2 bag convert` makes an MCAP bag of it",
            ".zstd": "is compressed as a whole; `zstd -d` unfolds it"}


def bag_folders(directory: Path, now: datetime, namespace: str = "/") -> Iterator[Path]:
    """Yield names for a bag's folder, as rosbag2 names them; each is to be tried if the previous one exists.

    The first is ``vibro_robot_YYYY_MM_DD-HH_MM_SS`` in `directory`, in the namespace ``/r1`` ``vibro_robot_r1_YYYY…``
    (at most `LONGEST_NAMESPACE` characters of the namespace); then ``_2``, ``_3``, … are appended. `now` is the start
    of the recording, local time. Only the attempt to make the folder shows whether a name is free, because another
    robot may make it at the same instant. `Recorder` makes it, and raises FileExistsError.
    """
    suffix = namespace.rstrip("/").replace("/", "_")[:LONGEST_NAMESPACE]
    folder = directory / now.strftime(f"vibro_robot{suffix}_%Y_%m_%d-%H_%M_%S")
    yield folder
    yield from (folder.with_name(f"{folder.name}_{number}") for number in count(2))


def bag_files(folder: Path) -> tuple[list[Path], list[str]]:
    """Return the MCAP files of a bag in the order of their numbers, and why other files are not read (OSError)."""
    files, flaws = [], []
    with os.scandir(folder) as entries:
        for entry in islice(entries, MOST_ENTRIES):
            suffix = Path(entry.name).suffix
            if suffix in _FOREIGN:
                flaws.append(f"{entry.name}: {_FOREIGN[suffix]}")
            elif suffix == SUFFIX and (kind := kind_of(entry.stat(follow_symlinks=False).st_mode)):
                flaws.append(f"{entry.name}: is {kind}, and only regular files of the folder are read")
            elif suffix == SUFFIX:
                files.append(folder / entry.name)
    numbers = {file: re.search(r"_(\d{1,18})$", file.stem) for file in files}
    return (sorted(files, key=lambda file: (int(number[1]) if (number := numbers[file]) else 0, file.name)),
            sorted(flaws))


def lock(folder: Path) -> int:
    """Lock a bag folder until the returned descriptor is closed, at the latest at the process's end.

    On a file system without locks the folder stays unlocked. BlockingIOError when another process has locked it.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise
    except OSError:
        pass
    return descriptor


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Context in which the folder is locked (BlockingIOError when it is locked already)."""
    descriptor = lock(folder)
    try:
        yield
    finally:
        os.close(descriptor)


def writing_processes(folders: Iterable[Path]) -> dict[Path, list[int]]:
    """Return the ids of the processes that have MCAP files in a folder open for writing, by folder.

    It finds recorders that do not lock, such as ``ros2 bag record``, among the processes that this user may inspect.
    """
    by_name = {str(folder.resolve()): folder for folder in folders}
    writers: dict[Path, set[int]] = {}
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            for link in (process / "fd").iterdir():
                with contextlib.suppress(OSError):
                    path, file = os.path.split(os.readlink(link))
                    folder = by_name.get(path) if file.endswith(SUFFIX) else None
                    lines = (process / "fdinfo" / link.name).read_text().splitlines() if folder else []
                    flags = next((int(line.split()[1], 8) for line in lines if line.startswith("flags:")), os.O_RDONLY)
                    if folder and flags & os.O_ACCMODE != os.O_RDONLY:
                        writers.setdefault(folder, set()).add(int(process.name))
    return {folder: sorted(processes) for folder, processes in writers.items()}


def unsealed_bags(directory: Path, pattern: str = "*") -> list[Path]:
    """Return the bag folders in `directory` that are not sealed, not empty, and not being recorded.

    Folders that this user may not read, and symbolic links, are not listed.
    """
    try:
        folders = sorted(folder for folder in directory.glob(pattern) if _is_unsealed(folder))
    except OSError:
        return []
    in_use = writing_processes(folders) if folders else {}
    return [folder for folder in folders if folder not in in_use and _is_abandoned(folder)]


def _is_unsealed(folder: Path) -> bool:
    try:
        if folder.is_symlink() or not folder.is_dir() or os.path.lexists(folder / FILE_NAME):
            return False
        files, _ = bag_files(folder)
        return any(file.stat().st_size for file in files)
    except OSError:
        return False


def _is_abandoned(folder: Path) -> bool:
    """Return whether a folder is unsealed, and no recorder has locked it."""
    try:
        with locked(folder):
            return _is_unsealed(folder)
    except OSError:
        return False
