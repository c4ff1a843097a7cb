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
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model

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
    _fields[type(values)], _sizes[type(values)] = fields, place


@infer_getattr
class _Attributes(AttributeTemplate):
    """What numba asks for the type of an attribute of a reference."""

    key = Reference

    def generic_resolve(self, reference, name):
        """numba's type of the attribute of this name; None if there is none."""
        field = _fields[reference.record].get(name)
        if field is None:
            return None
        if field.kind is not None:
            return Reference(field.kind)
        return types.Array(numba.from_dtype(field.dtype), field.dimensions, "C")


@lower_getattr_generic(Reference)
def _read(context, builder, reference, pointer, name):
    """Generate what reads an attribute: a pointer to the numbers of a tuple, or an array from its address and shape."""
    field = _fields[reference.record][name]
    numbers = builder.gep(builder.bitcast(pointer, _NUMBER.as_pointer()), [ir.Constant(_NUMBER, field.place)])
    if field.kind is not None:
        return builder.bitcast(numbers, _BYTES)
    kind = context.typing_context.resolve_getattr(reference, name)
    size = ir.Constant(_NUMBER, field.dtype.itemsize)
    address, *shape = (builder.load(builder.gep(numbers, [ir.Constant(_NUMBER, k)]))
                       for k in range(1 + field.dimensions))
    strides, items = [], ir.Constant(_NUMBER, 1)
    for length in reversed(shape):
        strides.insert(0, builder.mul(items, size))
        items = builder.mul(items, length)
    array = context.make_array(kind)(context, builder)
    array.data, array.nitems, array.itemsize = builder.inttoptr(address, array.data.type), items, size
    array.shape, array.strides = cgutils.pack_array(builder, shape), cgutils.pack_array(builder, strides)
    return array._getvalue()


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
