"""Layouts: the arrays of a named tuple as compiled kernels take them.

In C++ a named tuple of arrays is a structure of their addresses and lengths (`unit`). The layout is the memory of this
structure, so that a call from Python passes one address in place of forty arrays.
"""

from typing import Any

import numpy as np

from vibro_ros.solver.typed import PLAIN, Kind, address_of


class Laid:
    """A named tuple of arrays, with its layout for the kernels that Python calls.

    Parameters
    ----------
    values : NamedTuple
        A tuple of contiguous arrays of the kinds that its class declares, and of such tuples. The arrays are not
        copied; their contents may change.

    Attributes
    ----------
    values : NamedTuple
        As given.
    layout : ndarray of int, shape (numbers,), or NamedTuple
        Argument of an entry in place of the tuple; valid only as long as this object exists, which keeps the arrays.

    Raises
    ------
    TypeError
        For an array that is not of the kind that the class of the tuple declares.
    """

    def __init__(self, values: Any):
        self.values = values
        self.layout: Any = values
        if not PLAIN:
            numbers: list[int] = []
            _add_numbers(values, numbers)
            self.layout = np.array(numbers)

    def __reduce__(self) -> tuple:
        """Let a copy have a layout of its own arrays."""
        return Laid, (self.values,)


def _add_numbers(values: Any, numbers: list[int]) -> None:
    """Append address and shape of each array to `numbers`; of a record of records, the addresses of its parts."""
    for value, (name, kind, offsets) in zip(values, _fields_of(type(values)), strict=True):
        if kind is None:
            _add_numbers(value, numbers)
            continue
        if value.dtype != kind.dtype or value.ndim != kind.dimensions or not value.flags.c_contiguous:
            raise TypeError(f"{type(values).__name__}.{name} is not what kernels read: a contiguous array of "
                            f"{kind.dimensions} dimensions and {kind.dtype}")
        address = address_of(value)
        numbers += [address + offset for offset in offsets] if offsets else (address, *value.shape)


_fields: dict[type, list[tuple[str, Kind | None, tuple[int, ...]]]] = {}


def _fields_of(record: type) -> list[tuple[str, Kind | None, tuple[int, ...]]]:
    """Return name, kind and offsets of the parts of each field of a class of named tuples."""
    if record not in _fields:
        _fields[record] = [(name, kind, tuple(parts_of(kind).values()) if kind else ())
                           for name, kind in kinds_of(record).items()]
    return _fields[record]


def kinds_of(record: type) -> dict[str, Kind | None]:
    """Return the kind of array of each field of a class of named tuples; None for a field that is such a tuple."""
    return {name: next(iter(getattr(annotation, "__metadata__", ())), None)
            for name, annotation in record.__annotations__.items()}


def parts_of(kind: Kind) -> dict[str, int]:
    """Return the offsets of the parts of a record of records, by name; empty for any other kind."""
    fields = dict(kind.dtype.fields or {})
    parts = {name: int(offset) for name, (dtype, offset, *_) in fields.items() if dtype.names}
    return parts if len(parts) == len(fields) else {}
