"""Named tuples of arrays laid out in memory once, which kernels then get as one array from Python, too.

numba looks at every array of a tuple at every call: 10 µs for the forty of a system and its state, twice as much where
a tick finds none of that code in the processor's caches, and more than the kernel then takes.
"""

from typing import Any, NamedTuple

import numba
import numpy as np

from vibro_ros.solver.by_reference import kept_as


class Kept:
    """A named tuple of arrays, and of such tuples, as kernels see it in memory.

    Parameters
    ----------
    values : NamedTuple
        Its arrays stay where they are; what they hold may change.

    Attributes
    ----------
    values : NamedTuple
        The same.
    layout : ndarray, shape (numbers,)
        What an entry kernel takes in its place; not for longer than this is there, which keeps the arrays.
    """

    def __init__(self, values: NamedTuple):
        self.values = values
        numbers: list[int] = []
        _add_numbers(values, numbers)
        self.layout = np.array(numbers, dtype=np.int64).view(_dtype(values))

    def __reduce__(self) -> tuple:
        """A copy keeps its own arrays."""
        return Kept, (self.values,)


_dtypes: dict[tuple, np.dtype] = {}


def _dtype(values: NamedTuple) -> np.dtype:
    """The type of a layout names that of the tuple, which takes numba a third of a millisecond to find: too long for
    a sweep."""
    keys: list[Any] = []
    _add_keys(values, keys)
    key = tuple(keys)
    if key not in _dtypes:
        _dtypes[key] = np.dtype([(kept_as(numba.typeof(values)), np.int64)])
    return _dtypes[key]


def _add_keys(values: Any, keys: list[Any]) -> None:
    keys.append(type(values))
    for value in values:
        if isinstance(value, np.ndarray):
            keys += value.dtype, value.ndim, value.flags.num
        else:
            _add_keys(value, keys)


def _add_numbers(values: Any, numbers: list[int]) -> None:
    """Add the tuple as kernels see it: of each array owner and parent, which no kernel reads, size, size of an item,
    address, shape and strides."""
    for value in values:
        if isinstance(value, np.ndarray):
            # Not by the array interface, which takes 20 µs to describe the fields of a record.
            numbers += 0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides
        else:
            _add_numbers(value, numbers)
