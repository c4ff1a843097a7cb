"""The cache of compiled kernels: a folder that only this user can have written.

numba's own cache stores the kernels. It checks only the source file of an entry, not those of its parts, so the folder
is named by a digest of all sources of this package. numba also runs the machine code that it finds: anybody who can
write to the folder, or rename a folder above it, could run code as this user. Such a folder is not used.
"""

import atexit
import functools
import grp
import hashlib
import os
import pkgutil
import platform
import pwd
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

import llvmlite.binding as llvm
import numba

_ROOT = 0


@functools.cache
def _folder_name() -> str:
    """Return a name from all that compiled kernels depend on: the sources of this package, any of which may be a part
    of them, the compiler, and the processor, which may be another one at the next start."""
    names = sorted(module.name for module in pkgutil.iter_modules([os.path.dirname(os.path.abspath(__file__))]))
    sources = b"".join(pkgutil.get_data(__package__, f"{name}.py") or b"" for name in names)
    target = numba.__version__, platform.python_version(), llvm.get_host_cpu_name(), numba.config.CPU_NAME
    return "kernels-" + hashlib.sha256(sources + repr(target).encode()).hexdigest()[:16]


class KernelStore:
    """The folder of the compiled kernels, which is created if it does not exist.

    Parameters
    ----------
    chosen : str
        The folder that the user chose for all that numba stores; if empty, the kernels are stored beside their
        sources or, if that folder cannot be used, in the user's caches.

    Attributes
    ----------
    path : Path
        The folder. If no folder can be used, a temporary one, which is removed when this process ends.
    chosen : str
        The argument with which another process uses the same folder.
    unusable : str
        Why kernels are not stored for the next start; empty if they are.
    """

    def __init__(self, chosen: str):
        self.chosen = chosen
        path, self.unusable = _first_usable(_candidates(chosen))
        if path is None:
            self.chosen = tempfile.mkdtemp(prefix="vibro_ros-")
            atexit.register(shutil.rmtree, self.chosen, ignore_errors=True)
            path, reason = _first_usable(_candidates(self.chosen))
            if path is None:
                raise OSError(reason)
        self.path = path

    def has(self, family: str) -> bool:
        """Return whether all kernels of a family are stored."""
        return self._mark(family).exists()

    def mark(self, family: str) -> None:
        """Tell other processes that all kernels of a family are stored."""
        self._mark(family).touch()

    def discard(self) -> None:
        """Remove all kernels, because one of them is damaged."""
        shutil.rmtree(self.path, ignore_errors=True)
        with suppress(OSError):
            self.path.mkdir(mode=0o755, parents=True, exist_ok=True)

    def _mark(self, family: str) -> Path:
        return self.path / f"{family}.stored"


def _first_usable(folders: list[Path]) -> tuple[Path | None, str]:
    """Return the first folder that can be used, or None and the reason why the last one cannot."""
    reason = "no home folder is known"
    for folder in folders:
        try:
            folder.mkdir(mode=0o755, parents=True, exist_ok=True)
            reason = distrust(folder)
            if not reason and not os.access(folder, os.W_OK):
                reason = f"{folder}: you cannot write it"
        except OSError as error:
            reason = f"{folder}: {error.strerror}"
        if not reason:
            return folder, ""
    return None, reason


def _candidates(chosen: str) -> list[Path]:
    if chosen:
        return [Path(os.path.abspath(chosen), "vibro_ros", _folder_name())]
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    beside = Path(os.path.abspath(__file__)).with_name("__pycache__") / _folder_name()
    return [beside, *([Path(caches, "vibro_ros", _folder_name())] if os.path.isabs(caches) else [])]


def distrust(folder: Path) -> str:
    """Return why nothing in a folder may be run: a path that others can write or rename; empty if there is none."""
    inside = [folder, *sorted(folder.rglob("*"))]
    for path in (*inside, *Path(os.path.realpath(folder)).parents):
        status = os.lstat(path)
        if not (stat.S_ISDIR(status.st_mode) or stat.S_ISREG(status.st_mode)):
            return f"{path}: it is a link or no folder"
        if status.st_uid not in (os.geteuid(), _ROOT):
            return f"{path}: it belongs to another user"
        # In a sticky folder above, such as /tmp, only the owner of a file can rename it.
        if _others_may_write(status) and (path in inside or not status.st_mode & stat.S_ISVTX):
            return f"{path}: other users can write it"
    return ""


def _others_may_write(status: os.stat_result) -> bool:
    if status.st_mode & stat.S_IWOTH:
        return True
    return bool(status.st_mode & stat.S_IWGRP) and status.st_gid != _private_group()


@functools.cache
def _private_group() -> int | None:
    """Return the user's own group without other members, as most systems create for each user; None without one."""
    with suppress(KeyError):
        user = pwd.getpwuid(os.geteuid())
        group = grp.getgrgid(user.pw_gid)
        if group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}:
            return group.gr_gid
    return None

