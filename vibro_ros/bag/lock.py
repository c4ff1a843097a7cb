"""Whether a bag is still being recorded."""

import contextlib
import fcntl
import os
from collections.abc import Iterable, Iterator
from pathlib import Path


def lock(folder: Path) -> int:
    """Mark a bag folder as in use until the returned descriptor is closed, at the latest by the process's end.

    Where the file system knows no locks the folder stays unmarked.

    Raises
    ------
    BlockingIOError
        When another process has marked it.
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
    """A context in which the folder is marked as in use (BlockingIOError when it is already)."""
    descriptor = lock(folder)
    try:
        yield
    finally:
        os.close(descriptor)


def writers(folders: Iterable[Path]) -> dict[Path, list[int]]:
    """Of those folders in which files are open for writing, the ids of the processes, as far as this user may see them.

    Finds recorders that do not lock, such as ``ros2 bag record``.
    """
    by_name = {str(folder.resolve()): folder for folder in folders}
    found: dict[Path, set[int]] = {}
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            for link in (process / "fd").iterdir():
                with contextlib.suppress(OSError):
                    folder = by_name.get(os.path.dirname(os.readlink(link)))
                    if folder and _is_for_writing(process / "fdinfo" / link.name):
                        found.setdefault(folder, set()).add(int(process.name))
    return {folder: sorted(processes) for folder, processes in found.items()}


def _is_for_writing(information: Path) -> bool:
    flags = next(line.split()[1] for line in information.read_text().splitlines() if line.startswith("flags:"))
    return int(flags, 8) & os.O_ACCMODE != os.O_RDONLY
