"""Where compiled kernels are kept: files that are whole or not there, and that only this user can have written.

A compiled kernel is machine code that is run as it is read, so that whoever can write its file can run code as this
user. A folder and its files are therefore used only if they belong to this user or to root and nobody else can write
them; the file that was opened is checked, not its name. Each kernel is one file. It is named by all that the kernel
depends on and begins with a checksum. A kernel whose file is missing, damaged or not trusted is compiled again.
"""

import functools
import hashlib
import os
import pkgutil
import stat
import uuid
from pathlib import Path

_CHECKSUM = hashlib.sha256().digest_size  # bytes, at the beginning of a file
_ROOT = 0
_OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH
_OUR_NAME = "vibro_ros"  # of a folder between the user's caches and the kernels'


class Progress:
    """The kernels that this process has compiled or loaded, and those that it compiles now.

    Attributes
    ----------
    under_way, done, loaded : list of str
        Kernels that are being compiled, that have been compiled, and that were in the cache.
    unwritable : str
        Why the last compiled kernel could not be stored: folder and reason; empty when it could.
    """

    def __init__(self):
        self.under_way: list[str] = []
        self.done: list[str] = []
        self.loaded: list[str] = []
        self.unwritable = ""


progress = Progress()
"""The progress of this process."""


@functools.cache
def sources_digest() -> str:
    """Digest of this room's sources: a kernel holds what was inlined into it from any of them."""
    names = sorted(module.name for module in pkgutil.iter_modules([os.path.dirname(os.path.abspath(__file__))]))
    sources = b"".join(pkgutil.get_data(__package__, f"{name}.py") or b"" for name in names)
    return hashlib.sha256(sources).hexdigest()[:16]


def cache_folder(chosen: str) -> Path | None:
    """Where compiled kernels are kept: in the folder `chosen` by the user, else beside their sources, else in the
    user's caches; None if nobody knows the user's home."""
    here = os.path.dirname(os.path.abspath(__file__))
    if chosen:
        return Path(chosen, f"{_OUR_NAME}-{sources_digest()}")
    if os.access(here, os.W_OK):
        return Path(here, "__pycache__", f"kernels-{sources_digest()}")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(caches, _OUR_NAME, f"kernels-{sources_digest()}") if os.path.isabs(caches) else None


def _distrust(status: os.stat_result, is_kind) -> str:
    """Why a file of this status is not used; empty if it is of the kind and only this user and root can write it."""
    if not is_kind(status.st_mode):
        return "it is a link or no folder"
    if status.st_uid not in (os.geteuid(), _ROOT):
        return "it belongs to another user"
    return "other users can write it" if status.st_mode & _OTHERS_MAY_WRITE else ""


class KernelFolder:
    """The folder of compiled kernels.

    Parameters
    ----------
    path : Path or None
        Where it is, or will be when it is needed; None keeps nothing.
    """

    def __init__(self, path: Path | None):
        self.path = path

    def distrust(self) -> str:
        """Why nothing may be read from the folder or written to it; nothing if the folder may be used or made."""
        if self.path is None:
            return "no home folder is known"
        for folder in self._own():
            try:
                if reason := _distrust(os.lstat(folder), stat.S_ISDIR):
                    return f"{folder}: {reason}"
            except FileNotFoundError:
                return ""
            except OSError as error:
                return f"{folder}: {error.strerror}"
        return ""

    def make(self) -> str:
        """Make the folder if it is not there; returns why it cannot be used, or nothing."""
        if reason := self.distrust():
            return reason
        try:
            own = self._own()
            own[0].parent.mkdir(parents=True, exist_ok=True)
            for folder in own:
                folder.mkdir(mode=0o755, exist_ok=True)
        except OSError as error:
            return f"{self.path}: {error.strerror}"
        return self.distrust()

    def distrust_inside(self) -> str:
        """Why a file in the folder, at any depth, is not trusted, or nothing: numba's own cache does not ask."""
        for path in sorted(self.path.rglob("*")) if self.path else ():
            status = os.lstat(path)
            if reason := _distrust(status, stat.S_ISDIR if stat.S_ISDIR(status.st_mode) else stat.S_ISREG):
                return f"{path}: {reason}"
        return ""

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return self.path is not None and not self.distrust() and (self.path / name).exists()

    def read(self, name: str) -> bytes | None:
        """What `write` has written under this name; None if the file is missing, damaged or not trusted."""
        if self.path is None or self.distrust():
            return None
        try:
            opened = os.open(self.path / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)  # a pipe would wait
            with os.fdopen(opened, "rb") as file:
                content = b"" if _distrust(os.fstat(opened), stat.S_ISREG) else file.read()
        except OSError:
            return None
        data = content[_CHECKSUM:]
        return data if _checksum(name, data) == content[:_CHECKSUM] else None

    def write(self, name: str, data: bytes) -> str:
        """Write under another name first, so that no process ever reads a part; returns why it cannot be written, or
        nothing."""
        if reason := self.make():
            return reason
        assert self.path is not None
        fresh = self.path / f"{name}.{uuid.uuid4().hex[:8]}"
        try:
            try:
                with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), "wb") as file:
                    file.write(_checksum(name, data) + data)
                fresh.replace(self.path / name)
            finally:
                fresh.unlink(missing_ok=True)
        except OSError as error:
            return f"{self.path}: {error.strerror}"
        return ""

    def _own(self) -> list[Path]:
        """The folders that hold nothing but kernels, the outermost first."""
        assert self.path is not None
        return [self.path.parent, self.path] if self.path.parent.name == _OUR_NAME else [self.path]


def _checksum(name: str, data: bytes) -> bytes:
    """Of the name, too: a kernel under another kernel's name is damaged."""
    return hashlib.sha256(name.encode() + b"\0" + data).digest()
