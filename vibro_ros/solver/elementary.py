"""Elementary functions with the same bits on every computer: sine, cosine, exponential, logarithm.

The C library has several variants of these functions and chooses among them by the processor; numpy has its own. Their
results differ in the last bit, and from there a simulation grows apart. The functions of this module consist of sums,
differences, products, quotients and comparisons, each of which the standard (IEEE 754) lets round in one way only, so
that a result has the same bits from every compiler that neither fuses nor reorders, and from plain Python. All of them
err by less than one unit in the last place.

Each function reduces its argument to a short interval, where a Taylor series is summed. The reduced argument is kept in
two parts, the second of which holds the rounding error of the first.
"""

import math

from vibro_ros.solver.typed import entry, part

# A number below 2^51 that is added to this one and taken away again is rounded to the nearest whole number.
_WHOLE = 1.5 * 4503599627370496.0
_COARSE = 1.5 * 67108864.0  # the same for multiples of 2^-26, whose squares below 1 are exact
# Quarter turns, pi / 2, and ln 2 in parts. Products of the first parts and whole numbers below 2^20 are exact.
_QUARTER_1, _QUARTER_2, _QUARTER_3 = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
_LN2_1, _LN2_2 = 0.6931471803691238, 1.9082149292705877e-10
_QUARTERS_PER_RADIAN, _PER_LN2 = 0.6366197723675814, 1.4426950408889634
# Beyond these arguments, exp overflows or rounds to zero, and beside exp(40) a 1 is less than rounding.
_OVERFLOW, _UNDERFLOW, _LARGE = 709.782712893384, -745.1332191019412, 40.0
_MOST, _LEAST = 4294967296.0, 1.0 / 4294967296.0  # 2^32 and its inverse, by which `log` scales its argument
_ROOT_2 = 1.4142135623730951


@part
def _power_of_two(n: float) -> float:
    """Return 2^n, exactly, for a whole number n from -1022 to 1023."""
    power, factor, left = 1.0, 2.0 if n > 0 else 0.5, abs(n)
    while left >= 1.0:
        half = (0.5 * left - 0.25 + _WHOLE) - _WHOLE  # the whole number below
        if left != 2.0 * half:
            power *= factor
        factor *= factor
        left = half
    return power


# Sine and cosine


@part
def _sine_series(x: float, rest: float) -> float:
    """Return sin(x + rest) for |x| <= pi / 4."""
    z = x * x
    series = 1.0 / 362880.0 + z * (-1.0 / 39916800.0 + z * (1.0 / 6227020800.0 + z * (
        -1.0 / 1307674368000.0 + z * (1.0 / 355687428096000.0))))
    series = 1.0 / 120.0 + z * (-1.0 / 5040.0 + z * series)
    return x + (x * z * (-1.0 / 6.0 + z * series) + rest * (1.0 - 0.5 * z))


@part
def _cosine_series(x: float, rest: float) -> float:
    """Return cos(x + rest) for |x| <= pi / 4."""
    z = x * x
    series = -1.0 / 3628800.0 + z * (1.0 / 479001600.0 + z * (-1.0 / 87178291200.0 + z * (1.0 / 20922789888000.0)))
    series = 1.0 / 24.0 + z * (-1.0 / 720.0 + z * (1.0 / 40320.0 + z * series))
    half = 0.5 * z
    most = 1.0 - half
    return most + (((1.0 - most) - half) + (z * z * series - x * rest))


@part
def _sine_after(x: float, quarters: float) -> float:
    """Return the sine of `x` and a number of quarter turns."""
    turned = (x * _QUARTERS_PER_RADIAN + _WHOLE) - _WHOLE
    # The first difference is exact, and so is the second product; the error of the second difference is found exactly.
    high, low = x - turned * _QUARTER_1, turned * _QUARTER_2
    reduced = high - low
    back = high - reduced
    error = (high - (reduced + back)) + (back - low) - turned * _QUARTER_3
    angle = reduced + error
    rest = (reduced - angle) + error
    quarter = turned + quarters
    quarter -= 4.0 * ((0.25 * quarter + _WHOLE) - _WHOLE)  # from -2 to 2
    if quarter == 0.0:
        return _sine_series(angle, rest)
    if quarter == 1.0:
        return _cosine_series(angle, rest)
    if quarter == -1.0:
        return -_cosine_series(angle, rest)
    return -_sine_series(angle, rest)


@entry
def sin(x: float) -> float:
    """Return the sine of an angle [rad] of at most 100,000 in magnitude; of a larger one the error grows with it."""
    return _sine_after(x, 0.0)


@entry
def cos(x: float) -> float:
    """Return the cosine of an angle [rad] of at most 100,000 in magnitude; of a larger one the error grows with it."""
    return _sine_after(x, 1.0)


# Exponential


@part
def _exponential_less(x: float, twos: float, less: float) -> float:
    """Return exp(x - twos ln 2) - less, where the difference in the exponent is at most ln(2) / 2 in magnitude."""
    high, low = x - twos * _LN2_1, twos * _LN2_2
    reduced = high - low
    rest = (high - reduced) - low
    series = 1.0 / 5040.0 + reduced * (1.0 / 40320.0 + reduced * (1.0 / 362880.0 + reduced * (
        1.0 / 3628800.0 + reduced * (1.0 / 39916800.0 + reduced * (1.0 / 479001600.0 + reduced / 6227020800.0)))))
    series = 1.0 / 6.0 + reduced * (1.0 / 24.0 + reduced * (1.0 / 120.0 + reduced * (1.0 / 720.0 + reduced * series)))
    coarse = (reduced + _COARSE) - _COARSE
    square, fine = 0.5 * coarse * coarse, 0.5 * (reduced - coarse) * (reduced + coarse)  # reduced² / 2; one is exact
    constant = 1.0 - less
    linear = constant + reduced
    lost = ((1.0 - constant) - less) + (reduced - (linear - constant))
    most = linear + square
    lost += square - (most - linear)
    return most + (reduced * reduced * reduced * series + (fine + (lost + rest)))


@entry
def exp(x: float) -> float:
    """Return the exponential of a number."""
    if x > _OVERFLOW:
        return math.inf
    if x < _UNDERFLOW:
        return 0.0
    twos = (x * _PER_LN2 + _WHOLE) - _WHOLE
    half = (0.5 * twos + _WHOLE) - _WHOLE
    return _exponential_less(x, twos, 0.0) * _power_of_two(half) * _power_of_two(twos - half)


@entry
def expm1(x: float) -> float:
    """Return the exponential of a number, less 1, without cancellation near 0."""
    if x > _LARGE:
        return exp(x)
    if x < -_LARGE:
        return -1.0
    twos = (x * _PER_LN2 + _WHOLE) - _WHOLE
    return _exponential_less(x, twos, _power_of_two(-twos)) * _power_of_two(twos)


# Logarithm


@part
def _log_of_sum(x: float, rest: float) -> float:
    """Return ln(x + rest) for a positive, finite x, beside which `rest` is at most rounding."""
    twos = 0.0
    while x >= _MOST:
        x, rest, twos = x * _LEAST, rest * _LEAST, twos + 32.0
    while x < _LEAST:
        x, rest, twos = x * _MOST, rest * _MOST, twos - 32.0
    while x >= _ROOT_2:
        x, rest, twos = 0.5 * x, 0.5 * rest, twos + 1.0
    while x < 0.5 * _ROOT_2:
        x, rest, twos = 2.0 * x, 2.0 * rest, twos - 1.0
    # With s = f / (2 + f), ln(1 + f) = 2 artanh(s) = 2 (s + s³/3 + s⁵/5 + ...), and 2 s = f - s f.
    f = x - 1.0
    s = f / (2.0 + f)
    z = s * s
    series = z * (2.0 / 13.0 + z * (2.0 / 15.0 + z * (2.0 / 17.0 + z * (2.0 / 19.0 + z * (2.0 / 21.0 + z / 11.5)))))
    series = z * (2.0 / 3.0 + z * (2.0 / 5.0 + z * (2.0 / 7.0 + z * (2.0 / 9.0 + z * (2.0 / 11.0 + series)))))
    half = 0.5 * f * f
    return twos * _LN2_1 - ((half - (s * (half + series) + (twos * _LN2_2 + rest / x))) - f)


@entry
def log(x: float) -> float:
    """Return the natural logarithm of a number; not a number (nan) if the number is negative."""
    if x > 0.0 and x < math.inf:
        return _log_of_sum(x, 0.0)
    return -math.inf if x == 0.0 else math.inf if x > 0.0 else math.nan


@entry
def log1p(x: float) -> float:
    """Return the natural logarithm of 1 and a number, without cancellation near 0; not a number (nan) below -1."""
    if x > -1.0 and x < math.inf:
        total = 1.0 + x
        return _log_of_sum(total, x - (total - 1.0) if x < 1.0 else 1.0 - (total - x))
    return -math.inf if x == -1.0 else math.inf if x > 0.0 else math.nan


# Arctangent


@entry
def atan(x: float) -> float:
    """Return the arctangent [rad] of a number of at most 1 in magnitude; its error is below two units in the last
    place."""
    angle = x * (0.785 + 0.273 * (1.0 - abs(x)))  # to 0.004
    sine, cosine = sin(angle), cos(angle)
    rest = (x * cosine - sine) / (cosine + x * sine)  # the tangent of what is missing
    square = rest * rest
    return angle + rest * (1.0 - square * (1.0 / 3.0 - square * (0.2 - square / 7.0)))
