"""Compiled kernels in files: whole or not at all, checked when they are read, and never a reason to fail.

numba's own cache takes any file that it can unpickle for machine code, keeps an index that two processes can spoil for
each other, and gives the errors of a full disk to whoever calls the kernel. Here each compiled kernel is one file that
is named by all that it depends on and begins with a checksum. A kernel whose file is missing or damaged is compiled and
written anew; if it cannot be written, `Progress.unwritable` tells why.
"""

import hashlib
import inspect
import platform
import uuid
from collections.abc import Callable
from pathlib import Path

import numba
from numba.core import compiler, serialize
from numba.core.runtime import rtsys

from vibro_ros.solver.progress import progress

_CHECKSUM = hashlib.sha256().digest_size  # bytes, at the beginning of a file


class KernelCache:
    """The cache of one kernel; what numba's dispatcher calls.

    Parameters
    ----------
    function : callable
        The kernel's text.
    folder : Path or None
        Where its files lie, made when it is needed; None keeps nothing.
    """

    def __init__(self, function: Callable, folder: Path | None):
        self.cache_path = str(folder) if folder else None
        self._function, self._folder = function, folder

    def holds(self, signature: object, target: object) -> bool:
        """Whether there is a file for a signature."""
        return self._folder is not None and self._file(signature, target.codegen()).exists()

    def load_overload(self, signature: object, target: object) -> object | None:
        """The compiled kernel for a signature; None when it must be compiled."""
        found = _read(self._file(signature, target.codegen())) if self._folder else None
        if found is not None:
            # All that machine code needs of a target; `refresh`, which numba calls here, gets ready to compile and
            # takes three times as long as everything else, scipy's import included.
            rtsys.initialize(target)
            progress.loaded.append(self._function.__name__)
            return compiler.CompileResult._rebuild(target, *found)
        progress.under_way.append(self._function)
        return None

    def save_overload(self, signature: object, compiled: object) -> None:
        """Keep a compiled kernel, if there is room for it."""
        progress.under_way.remove(self._function)
        progress.done.append(self._function.__name__)
        if self._folder is None:
            progress.unwritable = "no home folder is known"
        elif not compiled.library.has_dynamic_globals:  # which hold addresses of this process
            progress.unwritable = _write(self._file(signature, compiled.codegen), compiled._reduce())

    def _file(self, signature: object, codegen: object) -> Path:
        source = inspect.getsource(inspect.getmodule(self._function))
        key = (numba.__version__, platform.python_version(), source, str(signature), codegen.magic_tuple())
        name = f"{self._function.__module__.rpartition('.')[2]}.{self._function.__qualname__}"
        return self._folder / f"{name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}.kernel"


def _read(file: Path) -> tuple | None:
    """What `_write` has written; None when the file is missing or does not hold that."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    checksum, data = content[:_CHECKSUM], content[_CHECKSUM:]
    return serialize.loads(data) if hashlib.sha256(data).digest() == checksum else None


def _write(file: Path, parts: tuple) -> str:
    """Write under another name first, so that no process ever reads a part; why it cannot be written, or nothing."""
    data = serialize.dumps(parts)
    fresh = file.with_suffix(f".{uuid.uuid4().hex[:8]}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            fresh.write_bytes(hashlib.sha256(data).digest() + data)
            fresh.replace(file)
        finally:
            fresh.unlink(missing_ok=True)
    except OSError as error:
        return f"{file.parent}: {error.strerror}"
    return ""
