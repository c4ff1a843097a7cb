"""Room on the disk that is kept for the index, so that a recording on a full disk can still be sealed."""

import contextlib
import os
from pathlib import Path

NAME = ".reserve"
MARGIN = 64 * 1024  # bytes; metadata.yaml and the data's last kilobytes fit in


class Reserve:
    """A file of zeros in a bag folder, given back before the bag is sealed.

    Parameters
    ----------
    folder : Path
        The bag folder.

    Attributes
    ----------
    size : int
        Bytes kept.

    Raises
    ------
    OSError
        When there is no room.
    """

    def __init__(self, folder: Path):
        self._folder = folder
        self.size = 0
        self.hold(0)

    def hold(self, size: int) -> None:
        """Keep at least `size` bytes and a margin (OSError when there is no room)."""
        if size + MARGIN // 2 <= self.size:
            return
        wanted = 2 * size + MARGIN
        file = os.open(self._folder / NAME, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            os.posix_fallocate(file, 0, wanted)
        finally:
            os.close(file)
        self.size = wanted

    def release(self) -> None:
        """Give the room back; calling it again does nothing."""
        remove(self._folder)


def remove(folder: Path) -> None:
    """Remove the reserve that a killed recorder left behind, if there is one."""
    with contextlib.suppress(OSError):
        (folder / NAME).unlink()
