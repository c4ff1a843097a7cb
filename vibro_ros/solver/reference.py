"""References: how kernels read a named tuple of arrays, through one pointer.

numba passes a named tuple to a function field by field, and each array as seven numbers or more: a kernel that reads
one field of a system would take four hundred arguments, and a call from Python would look at forty arrays. Here a
*layout* lists, in one array of integers, where each array of the tuple begins and how long it is. A kernel that Python
calls takes the layout and makes a reference of it; `system.row` is then read through the layout:

    @entry
    def advance(system, state):
        system, state = system_of(system), state_of(state)

All of this is numba's documented interface for extensions. Where numba compiles nothing (`NUMBA_DISABLE_JIT=1`),
kernels are given the tuples themselves, and a debugger shows them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload_attribute, register_model

_NUMBER = ir.IntType(64)
_BYTES = ir.IntType(8).as_pointer()


class Reference(types.Type):
    """numba's type of a reference to a named tuple of a class."""

    def __init__(self, record: type):
        self.record = record
        super().__init__(name=f"Reference({record.__name__})")


register_model(Reference)(models.OpaqueModel)


class _Field(NamedTuple):
    """A field of a class of named tuples: its first number in the layout, and what it is."""

    place: int
    kind: type | None  # the class of a named tuple; None for an array, of which ...
    dimensions: int = 0
    dtype: np.dtype | None = None


# Fields by class. The first tuple of a class tells them, and `Laid` refuses another that differs.
_fields: dict[type, dict[str, _Field]] = {}
_sizes: dict[type, int] = {}
_readable: set[str] = set()


class Laid:
    """A named tuple of arrays, laid out in memory once for the kernels that Python calls.

    Parameters
    ----------
    values : NamedTuple
        Of contiguous arrays and of such tuples, with as many dimensions and of the types as every other of its class.
        The arrays stay where they are; what they hold may change.

    Attributes
    ----------
    values : NamedTuple
        The same.
    layout : ndarray of int, shape (numbers,), or NamedTuple
        What an entry takes in its place; not for longer than this is there, which keeps the arrays.

    Raises
    ------
    TypeError
        For another tuple than kernels are compiled for.
    """

    def __init__(self, values: NamedTuple):
        self.values = values
        self.layout: Any = values
        if not numba.config.DISABLE_JIT:
            numbers: list[int] = []
            _add_numbers(values, numbers)
            self.layout = np.array(numbers)

    def __reduce__(self) -> tuple:
        """A copy keeps its own arrays."""
        return Laid, (self.values,)


def _add_numbers(values: Any, numbers: list[int]) -> None:
    """Add address and shape of each array."""
    record = type(values)
    if record not in _fields:
        _declare(values)
    for value, (name, field) in zip(values, _fields[record].items(), strict=True):
        if field.kind is not None:
            _add_numbers(value, numbers)
        elif value.dtype != field.dtype or value.ndim != field.dimensions or not value.flags.c_contiguous:
            raise TypeError(f"{record.__name__}.{name} is not what kernels read: a contiguous array of "
                            f"{field.dimensions} dimensions and {field.dtype}")
        else:
            # Not by the array interface, which takes 20 µs to describe the fields of a record.
            numbers += value.ctypes.data, *value.shape


def _declare(values: Any) -> None:
    """Let kernels read the fields of a named tuple's class."""
    place, fields = 0, {}
    for name, value in zip(values._fields, values, strict=True):
        if isinstance(value, np.ndarray):
            fields[name] = _Field(place, None, value.ndim, value.dtype)
            place += 1 + value.ndim
        else:
            if type(value) not in _fields:
                _declare(value)
            fields[name] = _Field(place, type(value))
            place += _sizes[type(value)]
        if name not in _readable:
            _readable.add(name)
            # Reference counts, which a kernel lacks, are for returning an array; the compiler takes them out again.
            overload_attribute(Reference, name, jit_options={"_nrt": True})(_reader(name))
    _fields[type(values)], _sizes[type(values)] = fields, place


def _reader(name: str) -> Callable:
    """What numba asks how to read the attribute `name` of a reference."""
    def read(reference):
        field = _fields[reference.record].get(name)
        if field is None:
            return None
        place, dtype = field.place, field.dtype
        if field.kind is not None:
            refer = _referring(field.kind)
            return lambda reference: refer(reference, place)
        shape = _shape(field.dimensions)
        return lambda reference: numba.carray(_address(reference, place), shape(reference, place), dtype)
    return read


def reference_to(record: type) -> Callable:
    """What makes a reference of the layout of a named tuple of this class, in kernels."""
    if numba.config.DISABLE_JIT:
        return lambda values: values
    kind = Reference(record)

    @intrinsic
    def refer(_, layout):
        def generate(context, builder, sign, arguments):
            return builder.bitcast(cgutils.create_struct_proxy(layout)(context, builder, arguments[0]).data, _BYTES)
        return kind(layout), generate
    return refer


def _referring(record: type) -> Callable:
    """What makes a reference to a tuple within a tuple."""
    kind = Reference(record)

    @intrinsic
    def refer(_, reference, place):
        def generate(context, builder, sign, arguments):
            return builder.bitcast(_pointer(builder, arguments), _BYTES)
        return kind(reference, types.intp), generate
    return refer


def _pointer(builder, arguments):
    """Pointer to the number at a place of a layout; `arguments` are the reference and the place."""
    return builder.gep(builder.bitcast(arguments[0], _NUMBER.as_pointer()), [arguments[1]])


def _shape(dimensions: int) -> Callable:
    """What reads the shape of an array of so many dimensions, whose address is at a place of a layout."""
    @intrinsic
    def shape(_, reference, place):
        def generate(context, builder, sign, arguments):
            address = _pointer(builder, arguments)
            return cgutils.pack_array(builder, [
                builder.load(builder.gep(address, [ir.Constant(_NUMBER, 1 + k)])) for k in range(dimensions)])
        return types.UniTuple(types.intp, dimensions)(reference, types.intp), generate
    return shape


@intrinsic
def _address(_, reference, place):
    def generate(context, builder, sign, arguments):
        return builder.inttoptr(builder.load(_pointer(builder, arguments)), _BYTES)
    return types.voidptr(reference, types.intp), generate
