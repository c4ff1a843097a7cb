"""Vectors: a polynomial's coefficients as one value, in the processor's vector registers.

The compiler turns a short loop into several loops, for vectors of different widths and for single numbers, and the
fastest of these takes more numbers at a time than a polynomial has. An operation on a vector is one instruction to
the compiler, which splits it into as few as the processor needs.

In kernels, vectors are added, subtracted and multiplied, number by number, and scaled:

    store(target, vector(p) + 2.0 * (vector(q) * powers(x)))

This module uses only numba's documented interface for extensions. If numba compiles nothing, a vector is an array,
and each function is the numpy expression in its decorator.
"""

import itertools
import operator
from collections.abc import Callable

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

#: Numbers in a vector. A flow's series is cut where 1.7^n / n! and 0.225^n (`system.STRIDE`) reach rounding.
LENGTH = 24
# A vector has parts of a power of two of numbers; the compiler would keep any other number of them one by one.
_WIDTH = 8

_NUMBER = ir.DoubleType()
_PART = ir.VectorType(_NUMBER, _WIDTH)
_PARTS = ir.ArrayType(_PART, LENGTH // _WIDTH)
_INDEX, _BITS = ir.IntType(32), ir.IntType(64)
_FIRST = ir.Constant(_INDEX, 0)
_ZEROS = ir.Constant(_PART, [0.0] * _WIDTH)


class Vector(types.Type):
    """Numba's type of a vector."""

    def __init__(self):
        super().__init__(name=f"Vector({LENGTH})")


_VECTOR = Vector()


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, numba_type):
        super().__init__(manager, numba_type, _PARTS)


def _split(builder, numbers):
    return [builder.extract_value(numbers, k) for k in range(_PARTS.count)]


def _join(builder, parts):
    numbers = ir.Constant(_PARTS, ir.Undefined)
    for k, part in enumerate(parts):
        numbers = builder.insert_value(numbers, part, k)
    return numbers


def _pick(builder, numbers, indices, others=None):
    """Return the numbers of an LLVM vector with these indices, which continue in `others`."""
    others = others or ir.Constant(numbers.type, ir.Undefined)
    return builder.shuffle_vector(numbers, others, ir.Constant(ir.VectorType(_INDEX, len(indices)), list(indices)))


def _repeat(builder, number, count=_WIDTH):
    one = builder.insert_element(ir.Constant(ir.VectorType(_NUMBER, 1), ir.Undefined), number, _FIRST)
    return _pick(builder, one, [0] * count)


def _part_pointers(context, builder, array_type, array):
    first = builder.bitcast(cgutils.create_struct_proxy(array_type)(context, builder, array).data, _PART.as_pointer())
    return [builder.gep(first, [ir.Constant(_INDEX, k)]) for k in range(_PARTS.count)]


def _check(array):
    if array.layout != "C" or array.dtype != types.float64:
        raise numba.TypingError(f"a vector's array is contiguous and of doubles, not {array}")


def _instead_of(plain: Callable) -> Callable:
    """Return a decorator that makes an intrinsic for kernels, or replaces it by `plain` if nothing is compiled."""
    return (lambda _: plain) if numba.config.DISABLE_JIT else intrinsic


# The sum and the powers have roundings whose order is the same whether compiled or not.


def _plain_total(numbers):
    parts = numbers.reshape(-1, _WIDTH)
    part = (parts[0] + parts[1]) + parts[2]
    while len(part) > 1:
        part = part[:len(part) // 2] + part[len(part) // 2:]
    return part[0]


def _plain_powers(x):
    known, factor = np.ones(1), x
    while len(known) < _WIDTH:
        known, factor = np.append(known, known * factor), factor * factor
    return np.concatenate([known, known * factor, known * factor * factor])


@_instead_of(lambda array: array[:LENGTH].copy())
def vector(_, array):
    """Return the vector of an array's first LENGTH numbers."""
    def generate(context, builder, sign, arguments):
        parts = [builder.load(pointer) for pointer in _part_pointers(context, builder, sign.args[0], arguments[0])]
        for part in parts:
            part.align = 8  # an array may begin anywhere
        return _join(builder, parts)
    _check(array)
    return _VECTOR(array), generate


@_instead_of(lambda array, numbers: np.copyto(array[:LENGTH], numbers))
def store(_, array, numbers):
    """Store a vector in an array of LENGTH numbers."""
    def generate(context, builder, sign, arguments):
        pointers = _part_pointers(context, builder, sign.args[0], arguments[0])
        for pointer, part in zip(pointers, _split(builder, arguments[1]), strict=True):
            builder.store(part, pointer, align=8)
        return context.get_dummy_value()
    _check(array)
    return types.void(array, numbers), generate


@_instead_of(_plain_total)
def total(_, numbers):
    """Return the sum of the numbers, added in the same order on every processor."""
    def generate(context, builder, sign, arguments):
        result, *others = _split(builder, arguments[0])
        for part in others:
            result = builder.fadd(result, part)
        while (width := result.type.count // 2) > 0:
            result = builder.fadd(_pick(builder, result, range(width)), _pick(builder, result, range(width, 2 * width)))
        return builder.extract_element(result, _FIRST)
    return types.float64(numbers), generate


@_instead_of(lambda numbers: np.append(0.0, numbers[:-1]))
def raised(_, numbers):
    """Return the vector with every number moved to the next index; the first becomes zero, the last is dropped."""
    def generate(context, builder, sign, arguments):
        parts = [_ZEROS, *_split(builder, arguments[0])]
        return _join(builder, [_pick(builder, low, range(_WIDTH - 1, 2 * _WIDTH - 1), high)
                               for low, high in itertools.pairwise(parts)])
    return _VECTOR(numbers), generate


@_instead_of(lambda numbers: np.append(numbers[1:], 0.0))
def lowered(_, numbers):
    """Return the vector with every number moved to the index before; the last becomes zero, the first is dropped."""
    def generate(context, builder, sign, arguments):
        parts = [*_split(builder, arguments[0]), _ZEROS]
        return _join(builder, [_pick(builder, low, range(1, _WIDTH + 1), high)
                               for low, high in itertools.pairwise(parts)])
    return _VECTOR(numbers), generate


@_instead_of(lambda numbers, number: np.append(number, numbers[1:]))
def with_first(_, numbers, number):
    """Return the vector with its first number replaced."""
    def generate(context, builder, sign, arguments):
        first = builder.insert_element(builder.extract_value(arguments[0], 0), arguments[1], _FIRST)
        return builder.insert_value(arguments[0], first, 0)
    return _VECTOR(numbers, types.float64), generate


@_instead_of(lambda numbers: numbers[-1])
def last(_, numbers):
    """Return the last number."""
    def generate(context, builder, sign, arguments):
        part = builder.extract_value(arguments[0], _PARTS.count - 1)
        return builder.extract_element(part, ir.Constant(_INDEX, _WIDTH - 1))
    return types.float64(numbers), generate


@_instead_of(lambda numbers, limit: sum(1 << n for n in range(LENGTH) if numbers[n] > limit))
def indices_above(_, numbers, limit):
    """Return an integer whose bit n is set if number n is greater than `limit`."""
    def generate(context, builder, sign, arguments):
        limits, result = _repeat(builder, arguments[1]), ir.Constant(_BITS, 0)
        for k, part in enumerate(_split(builder, arguments[0])):
            bits = builder.bitcast(builder.fcmp_ordered(">", part, limits), ir.IntType(_WIDTH))
            result = builder.or_(result, builder.shl(builder.zext(bits, _BITS), ir.Constant(_BITS, k * _WIDTH)))
        return result
    return types.int64(numbers, types.float64), generate


@_instead_of(lambda bits: (bits & -bits).bit_length() - 1 if bits else 64)
def first_index(_, bits):
    """Return the index of the lowest bit that is set; LENGTH or more if no bit is."""
    def generate(context, builder, sign, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))
    return types.int64(types.int64), generate


@_instead_of(lambda number: np.full(LENGTH, number))
def repeated(_, number):
    """Return the vector of LENGTH equal numbers."""
    def generate(context, builder, sign, arguments):
        return _join(builder, [_repeat(builder, arguments[0])] * _PARTS.count)
    return _VECTOR(types.float64), generate


@_instead_of(_plain_powers)
def powers(_, x):
    """Return the vector 1, x, x², ..."""
    def generate(context, builder, sign, arguments):
        known, factor = ir.Constant(ir.VectorType(_NUMBER, 1), [1.0]), arguments[0]
        while (count := known.type.count) < _WIDTH:
            higher = builder.fmul(known, _repeat(builder, factor, count))
            known = _pick(builder, known, range(2 * count), higher)
            factor = builder.fmul(factor, factor)
        parts = [known]
        while len(parts) < _PARTS.count:
            parts.append(builder.fmul(parts[-1], _repeat(builder, factor)))
        return _join(builder, parts)
    return _VECTOR(types.float64), generate


def _provide(operation, result, *operands):
    """Let kernels apply `operation` to operands of these numba types; the decorated function generates the code."""
    def decorate(generate):
        @type_callable(operation)
        def _(_):
            def of_one(a):
                return result if (a,) == operands else None

            def of_two(a, b):
                return result if (a, b) == operands else None

            return of_one if len(operands) == 1 else of_two

        lower_builtin(operation, *operands)(generate)
        return generate
    return decorate


def _provide_number_by_number(operation, instruction):
    @_provide(operation, _VECTOR, _VECTOR, _VECTOR)
    def _(context, builder, sign, arguments):
        pairs = zip(*(_split(builder, numbers) for numbers in arguments), strict=True)
        return _join(builder, [getattr(builder, instruction)(*pair) for pair in pairs])


_provide_number_by_number(operator.add, "fadd")
_provide_number_by_number(operator.sub, "fsub")
_provide_number_by_number(operator.mul, "fmul")


@_provide(operator.mul, _VECTOR, types.float64, _VECTOR)
def _multiple(context, builder, sign, arguments):
    factor = _repeat(builder, arguments[0])
    return _join(builder, [builder.fmul(factor, part) for part in _split(builder, arguments[1])])


@_provide(abs, _VECTOR, _VECTOR)
def _magnitudes(context, builder, sign, arguments):
    function = builder.module.declare_intrinsic(f"llvm.fabs.v{_WIDTH}f64", fnty=ir.FunctionType(_PART, [_PART]))
    return _join(builder, [builder.call(function, [part]) for part in _split(builder, arguments[0])])
