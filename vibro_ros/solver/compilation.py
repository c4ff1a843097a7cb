"""How kernels are compiled, and where the compiled kernels are stored.

A kernel holds what was inlined into it from other modules: the cache folder is therefore named by the sources of the
whole package, so that no update is served stale.
"""

import functools
import hashlib
import os
import pkgutil
from pathlib import Path

import numba

from vibro_ros.solver.by_reference import references
from vibro_ros.solver.kernel_cache import KernelCache
from vibro_ros.solver.part_compiler import PartCompiler

_OPTIONS = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
# Most kernels are parts of other kernels: they are neither stored nor called from Python.
_PART = {"no_cpython_wrapper": True, "pipeline_class": PartCompiler}
_INLINED = {"forceinline": True, **_PART}


def cache_folder() -> Path | None:
    """Where compiled kernels are stored: `NUMBA_CACHE_DIR`, else beside their source, else in the user's cache.

    None if nobody knows the user's home: whatever lies in a folder that others can write must not be run.
    """
    here = os.path.dirname(os.path.abspath(__file__))
    names = sorted(module.name for module in pkgutil.iter_modules([here]))
    sources = b"".join(pkgutil.get_data(__package__, f"{name}.py") for name in names)
    version = hashlib.sha256(sources).hexdigest()[:16]
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR, f"vibro_ros-{version}")
    if os.access(here, os.W_OK):
        return Path(here, "__pycache__", f"kernels-{version}")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(caches, "vibro_ros", f"kernels-{version}") if os.path.isabs(caches) else None


_FOLDER = cache_folder()


def _compiled(function, fastmath, **options):
    return numba.njit(fastmath=fastmath, **_OPTIONS | options)(function)


def cached(dispatcher):
    """Store what numba's `dispatcher` compiles in a `KernelCache`."""
    dispatcher._cache = KernelCache(dispatcher.py_func, _FOLDER)
    return dispatcher


def kernel(function):
    """Compile a kernel that is part of others: inlined, without reference counts, so that it cannot allocate; multiply
    and add may be fused, but not reordered."""
    return _compiled(function, {"contract"}, **_INLINED)


def rounding_kernel(function):
    """Compile a kernel that rounds every product, so that equal products cancel to exactly zero."""
    return _compiled(function, False, **_INLINED)


def sum_kernel(function):
    """Compile a plain sum, in which the order of the terms does not matter and several are added at once."""
    return _compiled(function, {"contract", "reassoc", "nsz"}, **_INLINED)


def called_kernel(function):
    """Compile a kernel that is called, not inlined: one that few systems need is not compiled into every caller."""
    return _compiled(function, {"contract"}, **_PART)


def entry_kernel(function):
    """Compile a kernel that Python calls, and store the kernel with all that is inlined into it.

    Inside, named tuples are references; kernels call a `kernel`, not this.
    """
    part = kernel(function)

    @functools.wraps(function)
    def entry(*arguments):
        return part(*references(arguments))

    del entry.__wrapped__  # numba would look for the arguments there
    return cached(_compiled(entry, {"contract"}))


def entry_types(entry, arguments: tuple) -> tuple:
    """The types for which an entry kernel is compiled when it is called with these arguments."""
    return (entry.typeof_pyval(arguments),)  # they arrive in one tuple
