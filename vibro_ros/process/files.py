"""Text and files that another hand may have written, taken so that they can do no harm.

Text is shown in one line of bounded length. Files are opened only if they are regular files, so that no open waits and
no read is endless, and read up to a limit.
"""

import errno
import os
import re
import secrets
import stat
from pathlib import Path
from typing import BinaryIO

LONGEST = 2000
"""Characters of a text that are shown, unless the caller wants fewer."""

_KINDS = {stat.S_IFIFO: "a named pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFDIR: "a folder",
          stat.S_IFSOCK: "a socket", stat.S_IFLNK: "a symbolic link"}


def one_line(text: object, longest: int = LONGEST) -> str:
    """`text` without line breaks: what cannot be printed is escaped, and beyond `longest` its middle is left out.

    A file's name may hold any byte but two. Printed as it is, one would end the program (bytes that are no UTF-8),
    feign another message (a line break), or change the terminal's colours (escape sequences).
    """
    shown = str(text)
    if len(shown) > longest:
        shown = f"{shown[:longest // 2]}…{shown[-(longest // 2):]}"
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in shown)


def kind_of(mode: int) -> str:
    """What a file's `st_mode` says that it is; empty for a regular file."""
    return _KINDS.get(stat.S_IFMT(mode), "")


def opened(path: Path, flags: int = os.O_RDONLY, follow: bool = True) -> int:
    """Descriptor of the regular file at `path`, to be closed by the caller; `flags` are those of `os.open`.

    `follow` says whether `path` itself may be a symbolic link; the folders above it may be in any case. OSError when it
    cannot be opened, or is something else than a regular file.
    """
    _check(path, os.stat(path, follow_symlinks=follow).st_mode)  # first, because opening some devices acts on them
    descriptor = os.open(path, flags | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY | (0 if follow else os.O_NOFOLLOW))
    try:
        _check(path, os.fstat(descriptor).st_mode)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def open_to_read(path: Path, follow: bool = True) -> BinaryIO:
    """The regular file at `path`, for reading (OSError as `opened`)."""
    return os.fdopen(opened(path, follow=follow), "rb")


def content(path: Path, limit: int, follow: bool = True) -> bytes:
    """All of a regular file of at most `limit` bytes (OSError as `opened`, and when it is larger)."""
    with open_to_read(path, follow) as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        raise OSError(errno.EFBIG, f"is larger than {limit} bytes", str(path))
    return data


def write_all(descriptor: int, data: bytes) -> None:
    """Write all of `data` where the descriptor stands (OSError)."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(descriptor, rest):]


def is_temporary(name: str) -> bool:
    """Whether `replace_file` may have given this name to a file that it had not finished."""
    return re.fullmatch(r"\..+\.[0-9a-f]{16}", name) is not None


def replace_file(path: Path, data: bytes) -> None:
    """Put a file in the place of whatever is at `path`, whole or not at all; a link there is replaced (OSError)."""
    fresh = path.with_name(f".{path.name}.{secrets.token_hex(8)}")  # nobody can guess it, and lay a link under it
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    try:
        with os.fdopen(descriptor, "wb", buffering=0) as file:
            write_all(file.fileno(), data)
            os.fsync(file.fileno())
        fresh.replace(path)
    except BaseException:
        fresh.unlink(missing_ok=True)
        raise


def _check(path: Path, mode: int) -> None:
    if kind := kind_of(mode):
        raise OSError(errno.EINVAL, f"is {kind}, not a regular file", str(path))
