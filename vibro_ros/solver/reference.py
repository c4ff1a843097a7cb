"""References: one pointer through which kernels read a named tuple of arrays.

numba passes a named tuple to a function field by field, and each array as seven numbers or more: a kernel that reads
one field of a system would take four hundred arguments, and a call from Python would unpack forty arrays. Here a
*layout*, one array of integers, lists address and shape of each array of the tuple. A kernel that Python calls takes
the layout and makes a reference of it; `system.row` is then read through the layout:

    @entry
    def advance(system, state):
        system, state = system_of(system), state_of(state)

All of this is numba's documented interface for extensions. With `NUMBA_DISABLE_JIT=1` nothing is compiled: kernels
get the tuples themselves, and a debugger shows them.
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
    """A field of a class of named tuples: index of its first number in the layout, and its type."""

    place: int
    kind: type | None  # the class of a named tuple; None for an array with these dimensions and dtype
    dimensions: int = 0
    dtype: np.dtype | None = None


# Fields by class. The first tuple of a class defines them, and `Laid` refuses another one that differs.
_fields: dict[type, dict[str, _Field]] = {}
_sizes: dict[type, int] = {}


class Laid:
    """A named tuple of arrays, with its layout for the kernels that Python calls.

    Parameters
    ----------
    values : NamedTuple
        A tuple of contiguous arrays and of such tuples, with the same dimensions and dtypes as every other tuple of its
        class. The arrays are not copied; their contents may change.

    Attributes
    ----------
    values : NamedTuple
        As given.
    layout : ndarray of int, shape (numbers,), or NamedTuple
        Argument of an entry in place of the tuple; valid only as long as this object exists, which keeps the arrays.

    Raises
    ------
    TypeError
        For a tuple whose arrays differ from those for which kernels are compiled.
    """

    def __init__(self, values: NamedTuple):
        self.values = values
        self.layout: Any = values
        if not numba.config.DISABLE_JIT:
            numbers: list[int] = []
            _add_numbers(values, numbers)
            self.layout = np.array(numbers)

    def __reduce__(self) -> tuple:
        """Let a copy have a layout of its own arrays."""
        return Laid, (self.values,)


def _add_numbers(values: Any, numbers: list[int]) -> None:
    """Append address and shape of each array to `numbers`."""
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
            # `ctypes` is used, because the array interface takes 20 µs to describe the fields of a record.
            numbers += value.ctypes.data, *value.shape


def _declare(values: Any) -> None:
    """Register the fields of a named tuple's class, so that kernels can read them."""
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
    """Types of the attributes of references, for numba."""

    key = Reference

    def generic_resolve(self, reference, name):
        """Return numba's type of the attribute of this name; None if there is none."""
        field = _fields[reference.record].get(name)
        if field is None:
            return None
        if field.kind is not None:
            return Reference(field.kind)
        return types.Array(numba.from_dtype(field.dtype), field.dimensions, "C")


@lower_getattr_generic(Reference)
def _read(context, builder, reference, pointer, name):
    """Generate the code that reads an attribute: a pointer to a tuple's numbers, or an array by address and shape."""
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
    """Return the function that makes a reference from the layout of a named tuple of this class, in kernels."""
    if numba.config.DISABLE_JIT:
        return lambda values: values
    kind = Reference(record)

    @intrinsic
    def refer(_, layout):
        def generate(context, builder, sign, arguments):
            return builder.bitcast(cgutils.create_struct_proxy(layout)(context, builder, arguments[0]).data, _BYTES)
        return kind(layout), generate
    return refer
