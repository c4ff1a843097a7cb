"""Whether a file that is written is still where it was made."""

import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Identity:
    """A file on its file system, whatever its name."""

    device: int
    number: int


def identity_of(status: os.stat_result) -> Identity:
    """The file of which `os.stat` told this."""
    return Identity(status.st_dev, status.st_ino)


def check_in_place(path: Path, identity: Identity) -> None:
    """Return when the file at `path` is this one (OSError when it was removed or replaced).

    Writing to a removed file succeeds, and what is written is nowhere: so a recorder has to look.
    """
    if identity_of(os.stat(path, follow_symlinks=False)) != identity:
        raise OSError(0, f"{path.name} was replaced by another file", str(path))


def is_in_place(path: Path, identity: Identity) -> bool:
    """Whether the file at `path` is this one."""
    try:
        return identity_of(os.stat(path, follow_symlinks=False)) == identity
    except OSError:
        return False
