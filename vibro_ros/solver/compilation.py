"""Compilation of kernels: parts, and entries that Python calls, by numba's documented interface alone.

A part is a Python function that numba compiles into the kernels that call it. An entry is compiled as a whole, with all
its parts, and stored. Kernels cannot allocate, so that numba leaves out reference counts, which take half of the time.

With `NUMBA_DISABLE_JIT=1` nothing is compiled, and a debugger steps from `simulate` into every kernel.
"""

from collections.abc import Callable

import numba
from numba.extending import register_jitable

from vibro_ros.solver.kernel_cache import KernelStore

# Products are never fused with sums, and sums never reordered: both change bits from processor to processor.
_OPTIONS = {"error_model": "numpy", "_nrt": False, "fastmath": False}


def part(function):
    """Declare a function that kernels may call; it becomes a part of them."""
    return register_jitable(**_OPTIONS)(function)


def inlined_part(function):
    """Declare a part that numba copies into the kernel that calls it, before compiling the kernel.

    Any other part numba first compiles to machine code by itself, with all that it calls, and then again within its
    caller. So parts that call most of the others, and that only one kernel calls, are inlined, which saves an eighth of
    the first start. Inlining small parts saves nothing, because numba then works longer on the larger kernels.
    """
    return numba.njit(inline="always")(function)


class Progress:
    """The kernels that this process has compiled or loaded, and those that it compiles now.

    Attributes
    ----------
    under_way, done, loaded : list of str
        Kernels that are being compiled, that have been compiled, and that were in the cache.
    unwritable : str
        Why compiled kernels are not stored: folder and reason; empty if they are.
    """

    def __init__(self):
        self.under_way: list[str] = []
        self.done: list[str] = []
        self.loaded: list[str] = []
        self.unwritable = ""


progress = Progress()
"""The progress of this process."""

_store = None if numba.config.DISABLE_JIT else KernelStore(numba.config.CACHE_DIR)
progress.unwritable = _store.unusable if _store else ""


def entry(function):
    """Compile a kernel that Python calls, and store it with all its parts.

    In place of a named tuple the kernel takes its `reference.Laid.layout`. Kernels call parts, not entries.
    """
    usual = numba.config.CACHE_DIR
    try:
        numba.config.CACHE_DIR = str(_store.path) if _store else usual
        return numba.njit(cache=True, **_OPTIONS)(function)
    finally:
        numba.config.CACHE_DIR = usual


# Functions for compiling kernels before a clock starts


def store_environment() -> dict[str, str]:
    """Return the environment variables for a process that compiles kernels for this one."""
    return {"NUMBA_CACHE_DIR": _store.chosen} if _store and _store.chosen else {}


def is_stored(family: str) -> bool:
    """Return whether all kernels of a family are stored, or nothing is compiled at all."""
    return _store is None or _store.has(family)


def mark_as_stored(family: str) -> None:
    """Tell other processes that all kernels of a family are stored."""
    if _store and not progress.unwritable:
        _store.mark(family)


def compile_entry(kernel: Callable, arguments: tuple) -> None:
    """Load an entry for arguments of these types, or compile it, unless this was done before.

    If a stored kernel cannot be read, it is damaged: all stored kernels are removed, and this one is compiled again.
    """
    kinds = tuple(map(numba.typeof, arguments))
    if _store is None or kinds in kernel.overloads:
        return
    try:
        _compile(kernel, kinds)
    except Exception:
        _store.discard()
        progress.under_way.append(kernel.__name__)
        try:
            _compile(kernel, kinds)
        finally:
            progress.under_way.pop()
    (progress.loaded if kernel.stats.cache_hits else progress.done).append(kernel.__name__)


def _compile(kernel, kinds: tuple) -> None:
    try:
        kernel.compile(kinds)
    except OSError as error:
        if kinds not in kernel.overloads:
            raise
        progress.unwritable = f"{_store.path}: {error.strerror}"  # it was compiled, and could not be stored
