"""How far this process is with compiling its kernels."""

import functools
from collections.abc import Callable
from inspect import getclosurevars


class Progress:
    """The kernels that this process has compiled or loaded, and those that it compiles now.

    Attributes
    ----------
    under_way : list of callable
        Texts of the kernels that are being compiled, each as a part of the one before.
    parts : set of callable
        Texts of the parts that have been compiled.
    whole : list of str
        Kernels that are being compiled on the plain road, which says nothing of parts.
    elsewhere : list of str
        Kernels that another process compiles, and that this one waits for.
    done, loaded : list of str
        Kernels that have been compiled, and kernels that were in the cache.
    unwritable : str
        Why the last compiled kernel could not be stored: folder and reason; empty when it could.
    """

    def __init__(self):
        self.under_way: list[Callable] = []
        self.parts: set[Callable] = set()
        self.whole: list[str] = []
        self.elsewhere: list[str] = []
        self.done: list[str] = []
        self.loaded: list[str] = []
        self.unwritable = ""

    def in_words(self) -> str:
        """The kernel that is compiled now and how far that is; empty if none is. Any thread may ask."""
        if under_way := list(self.under_way):
            parts = parts_of(under_way[0])
            ready = len(parts & set(self.parts))
            what = f"{ready} of {len(parts)} parts" if ready < len(parts) else f"machine code of {len(parts)} parts"
            return f"{under_way[0].__name__}, {what}"
        if whole := list(self.whole):
            return f"{whole[-1]} without private parts of numba"
        if elsewhere := list(self.elsewhere):
            return f"{', '.join(elsewhere)} in another process"
        return ""


progress = Progress()
"""The progress of this process."""


@functools.cache
def parts_of(kernel: Callable) -> frozenset[Callable]:
    """Texts of all parts of a kernel: what it calls, and what that calls in turn."""
    found: set[Callable] = set()
    texts = [kernel]
    while texts:
        named = getclosurevars(texts.pop())
        called = {value.py_func for value in {**named.nonlocals, **named.globals}.values() if hasattr(value, "py_func")}
        texts += called - found
        found |= called
    return frozenset(found)
