"""Folders and files that one study at a time writes into."""

import contextlib
import fcntl
import os
import time
from collections.abc import Iterator
from pathlib import Path

# The workers of a study that was killed hold its lock until they have ended the run that they are in [s].
_PATIENCE, _POLL = 3.0, 0.05


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make `folder`, and keep others from it until the context or the process ends.

    Where the file system knows no locks, nobody is kept away.

    Raises
    ------
    ValueError
        When another study uses it, or it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise ValueError(f"{folder}: {error.strerror}; give an --output that can be written") from error
    try:
        lock(descriptor, folder)
        yield
    finally:
        os.close(descriptor)


def lock(descriptor: int, path: Path) -> None:
    """Keep other studies from an open file or folder for as long as it is open (ValueError when another has it)."""
    deadline = time.monotonic() + _PATIENCE
    while True:
        try:
            return fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > deadline:
                raise ValueError(f"{path}: another study writes here; wait for its end, or give another "
                                 "--output") from None
        except OSError:
            return
        time.sleep(_POLL)
