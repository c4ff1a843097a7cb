"""How kernels are compiled, and where they are kept.

numba looks for changes in a kernel's own file only; kernels that were inlined into another module's would
be served stale after an update. The cache folder is therefore named by the sources of the whole package.
"""

import hashlib
import os
import pkgutil

import numba

_OPTIONS = {"error_model": "numpy", "_nrt": False}
# Most kernels are parts of others: neither called from Python, which would crash, nor kept, they need not become
# machine code themselves.
_PART = {"forceinline": True, "no_cpython_wrapper": True}


def _cache_folder() -> str:
    here = os.path.dirname(os.path.abspath(__file__))
    names = sorted(module.name for module in pkgutil.iter_modules([here]))
    sources = b"".join(pkgutil.get_data(__package__, f"{name}.py") for name in names)
    version = hashlib.sha256(sources).hexdigest()[:16]
    if numba.config.CACHE_DIR:
        return os.path.join(numba.config.CACHE_DIR, f"vibro_ros-{version}")
    if os.access(here, os.W_OK):
        return os.path.join(here, "__pycache__", f"kernels-{version}")
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(caches, "vibro_ros", f"kernels-{version}")


_FOLDER = _cache_folder()


def _compiled(function, fastmath, **options):
    """Give `function` to numba, which reads its cache folder from its configuration when it decorates."""
    others = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER
    try:
        return numba.njit(fastmath=fastmath, **_OPTIONS | options)(function)
    finally:
        numba.config.CACHE_DIR = others


def kernel(function):
    """Compile a kernel that is part of others: inlined, without reference counts (it cannot allocate), fused
    multiply-add allowed, reordering not."""
    return _compiled(function, {"contract"}, **_PART)


def rounding_kernel(function):
    """Compile a kernel that rounds every product, so that equal products cancel to exactly zero."""
    return _compiled(function, False, **_PART)


def sum_kernel(function):
    """Compile a plain sum, in which the order of the terms does not matter and several are added at once."""
    return _compiled(function, {"contract", "reassoc", "nsz"}, **_PART)


def called_kernel(function):
    """Compile a kernel that is called, not inlined: what few systems need must not be compiled at every call."""
    return _compiled(function, {"contract"}, no_cpython_wrapper=True)


def entry_kernel(function):
    """Compile a kernel that Python calls, and keep it with all that is inlined into it."""
    return _compiled(function, {"contract"}, cache=True)
