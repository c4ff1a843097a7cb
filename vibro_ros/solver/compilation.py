"""How kernels are compiled: by numba's private parts, or by the plain road, which any numba has.

The plain road is `numba.njit(cache=True)` and nothing private. Its kernels compute the same, compile in minutes and
take ten times as long. It is taken if numba lacks a private part that `numba_private` relies on, or if the environment
variable `VIBRO_ROS_KERNELS` is `plain`. So a new numba never stops a robot.
"""

from collections.abc import Callable
from os import environ
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba

from vibro_ros.solver.kernel_cache import KernelFolder, cache_folder, progress

_FOLDER = KernelFolder(cache_folder(numba.config.CACHE_DIR))
_CONTRACT = {"contract"}  # multiply and add may be fused, but not reordered


def _reason_for_plain_road() -> str:
    if environ.get("VIBRO_ROS_KERNELS") == "plain":
        return "VIBRO_ROS_KERNELS is plain"
    try:
        from vibro_ros.solver import numba_private
    except Exception as error:
        return f"numba {numba.__version__} lacks a part ({error})"
    missing = "" if numba.__version__ in numba_private.TESTED else numba_private.missing_parts()
    return f"numba {numba.__version__}: {missing}" if missing else ""


#: Why kernels take the plain road; empty if they do not.
PLAIN = _reason_for_plain_road()
if not PLAIN:
    from vibro_ros.solver import numba_private


def _compiled_part(function: Callable, fastmath, inlined: bool = True):
    if PLAIN:
        return numba.njit(error_model="numpy", fastmath=fastmath)(function)
    return numba_private.compiled_part(function, fastmath, inlined)


def kernel(function):
    """Compile a kernel that is part of others."""
    return _compiled_part(function, _CONTRACT)


def rounding_kernel(function):
    """Compile a kernel that rounds every product, so that equal products cancel to exactly zero."""
    return _compiled_part(function, False)


def sum_kernel(function):
    """Compile a plain sum, in which the order of the terms does not matter and several are added at once."""
    return _compiled_part(function, _CONTRACT | {"reassoc", "nsz"})


def called_kernel(function):
    """Compile a kernel that is called, not inlined: one that few systems need is not compiled into every caller."""
    return _compiled_part(function, _CONTRACT, inlined=False)


def entry_kernel(function):
    """Compile a kernel that Python calls, and store the kernel with all that is inlined into it.

    Kernels call a `kernel`, not this.
    """
    if PLAIN:
        return stored_kernel(function, _CONTRACT)
    return numba_private.compiled_entry(function, _CONTRACT, _FOLDER)


def stored_kernel(function, fastmath=False):
    """Compile a function that needs no part of the solver, as numba itself does, and store it."""
    options = {"error_model": "numpy", "fastmath": fastmath}
    if not PLAIN:
        return numba_private.stored(numba.njit(**options)(function), _FOLDER)
    progress.unwritable = _FOLDER.make() or _FOLDER.distrust_inside()
    usual = numba.config.CACHE_DIR
    try:
        numba.config.CACHE_DIR = str(_FOLDER.path)  # whose name changes with the sources of the parts
        return numba.njit(cache=not progress.unwritable, **options)(function)
    finally:
        numba.config.CACHE_DIR = usual


class Laid:
    """A named tuple of arrays, laid out in memory once for the kernels that Python calls.

    Parameters
    ----------
    values : NamedTuple
        Its arrays stay where they are; what they hold may change.

    Attributes
    ----------
    values : NamedTuple
        The same.
    layout : ndarray, shape (numbers,), or NamedTuple
        What an entry kernel takes in its place; not for longer than this is there, which keeps the arrays.
    """

    def __init__(self, values: NamedTuple):
        self.values = values
        self.layout: Any = values if PLAIN else numba_private.layout(values)

    def __reduce__(self) -> tuple:
        """A copy keeps its own arrays."""
        return Laid, (self.values,)


# For those who compile kernels before a clock starts


def entry_types(entry, arguments: tuple) -> tuple:
    """The types for which an entry kernel is compiled when it is called with these arguments."""
    return tuple(map(numba.typeof, arguments)) if PLAIN else numba_private.entry_types(entry, arguments)


def is_stored(entry, kinds: tuple) -> bool:
    """Whether a compiled entry kernel is stored, as far as that can be known."""
    return False if PLAIN else numba_private.is_stored(entry, kinds)


def compile_entry(entry, kinds: tuple) -> None:
    """Compile an entry kernel, or load it, if neither was done before."""
    if not PLAIN:
        entry.compile(kinds)
        return
    progress.under_way.append(entry.__name__)
    try:
        entry.compile(kinds)
        (progress.loaded if entry.stats.cache_hits else progress.done).append(entry.__name__)
    finally:
        progress.under_way.pop()


# For those who must know how kernels round

#: Features of a processor by which kernels round, or cut their loops, in another way.
_FEATURES = ("avx", "avx2", "avx512f", "avx512vl", "fma", "neon", "sve", "sve2")


@entry_kernel
def _sum_of_products(a, b, c):
    return a * b + c


def multiply_add() -> str:
    """How kernels multiply and add: `fused`, with one rounding, or `apart`, with two."""
    above_one = 1.0 + 2.0**-30  # whose square is 1 + 2^-29 and, beyond the digits of a double, 2^-60
    return "apart" if _sum_of_products(above_one, above_one, -1.0 - 2.0**-29) == 0.0 else "fused"


def processor() -> str:
    """The processor that kernels are compiled for, as LLVM calls it, and its features that matter to them."""
    name = numba.config.CPU_NAME or llvm.get_host_cpu_name()
    given = numba.config.CPU_FEATURES
    if given is None:
        found = {feature for feature, present in llvm.get_host_cpu_features().items() if present}
    else:
        found = {word[1:] for word in given.split(",") if word.startswith("+")}
    return " ".join([name, *(feature for feature in _FEATURES if feature in found)])
