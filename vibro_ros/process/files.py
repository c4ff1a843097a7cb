"""Untrusted text and files, handled so that they can do no harm.

Text is shown in one line of bounded length. Files are opened only if they are regular files, so that no call of open or
read blocks for ever, and read up to a limit.
"""

import errno
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

LONGEST = 2000  # longest text [characters] that is shown, unless the caller gives another limit

_KINDS = {stat.S_IFIFO: "a named pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFDIR: "a folder",
          stat.S_IFSOCK: "a socket", stat.S_IFLNK: "a symbolic link"}


def one_line(text: object, longest: int = LONGEST) -> str:
    """Return `text` in one line: unprintable characters are escaped, and of a text over `longest` the middle is cut.

    A file's name may hold any byte but two. Printed as it is, a name could end the program (bytes that are not UTF-8),
    fake another message (a line break), or change the terminal's colours (escape sequences).
    """
    shown = str(text)
    if len(shown) > longest:
        shown = f"{shown[:longest // 2]}…{shown[-(longest // 2):]}"
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in shown)


def user_path(path: str | Path) -> Path:
    """Return a path that a user gave, with `~` and `~NAME` at its beginning as home folders.

    A shell expands `~` only at the beginning of a word, neither in `--output=~/out` nor in `scene:=~/robot.yaml`, and
    no program does in a parameter file. A home folder that is unknown stays as it is written.
    """
    return Path(os.path.expanduser(path))


def kind_of(mode: int) -> str:
    """Return the kind of a file in words, from its `st_mode`; empty for a regular file."""
    return _KINDS.get(stat.S_IFMT(mode), "")


def open_to_read(path: Path, follow: bool = True) -> BinaryIO:
    """Open the regular file at `path` for reading (OSError when it cannot be opened, or is no regular file).

    `follow` says whether `path` itself may be a symbolic link; the folders above it always may.
    """
    _check(path, os.stat(path, follow_symlinks=follow).st_mode)  # before open, which acts on some devices
    flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY | (0 if follow else os.O_NOFOLLOW)
    file = os.fdopen(os.open(path, flags), "rb")
    try:
        _check(path, os.fstat(file.fileno()).st_mode)
    except OSError:
        file.close()
        raise
    return file


def read_file(path: Path, limit: int, follow: bool = True) -> bytes:
    """Read a regular file of at most `limit` bytes (OSError as `open_to_read`, and when it is larger)."""
    with open_to_read(path, follow) as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise OSError(errno.EFBIG, f"is larger than {limit} bytes", str(path))
    return data


def is_temporary(name: str) -> bool:
    """Return whether a name has the form of the temporary files of `replace_file`."""
    return re.fullmatch(r"\..+\.[0-9a-f]{16}", name) is not None


def replace_file(path: Path, data: bytes) -> None:
    """Write a file to `path`, whole or not at all, and replace what is there, even a link (OSError)."""
    with replacement(path) as file:
        file.write(data)


@contextmanager
def replacement(path: Path) -> Iterator[BinaryIO]:
    """Context with a new file that replaces what is at `path`, even a link, unless an error ends it (OSError)."""
    temporary = path.with_name(f".{path.name}.{os.urandom(8).hex()}")  # unguessable, so that no link can be put there
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _check(path: Path, mode: int) -> None:
    if kind := kind_of(mode):
        raise OSError(errno.EINVAL, f"is {kind}, not a regular file", str(path))
