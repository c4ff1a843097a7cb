"""The first sign change of a polynomial, certified by ball arithmetic (python-flint)."""

from flint import arb, arb_poly, ctx

LEADING_TOLERANCE = 1e-38  # events are located to about 1e-50, so a coefficient this small is a zero
TOUCH_WIDTH = arb("1e-45")  # two crossings closer than this [s] count as a touch without crossing


def leading(coefficients: list, step: float) -> tuple[int, int]:
    """Return the sign of the polynomial just after 0, and the index of the coefficient that decides the sign.

    Coefficients that `step` [s] makes smaller than LEADING_TOLERANCE of the largest count as zero;
    (0, 0) when all are zero.
    """
    sizes, power = [], 1.0
    for coefficient in coefficients:
        sizes.append(abs(float(coefficient)) * power)
        power *= step
    limit = max(sizes) * LEADING_TOLERANCE
    for index, size in enumerate(sizes):
        if size > limit:
            return (1 if coefficients[index] > 0 else -1), index
    return 0, 0


def first_crossing(coefficients: list, step: arb, natural_step: float) -> arb | None:
    """Return the first time in (0, step] at which the polynomial changes the sign that it has just after 0.

    `natural_step` [s] is the scale on which `leading` weighs the coefficients. A zero at 0 itself is divided out. No
    pair of crossings is missed: an interval is discarded only if the polynomial or its derivative is proved to have no
    zero in it.
    """
    sign, index = leading(coefficients, natural_step)
    if sign == 0:
        return None
    polynomial = arb_poly([sign * c for c in coefficients[index:]])
    derivative = polynomial.derivative()
    pieces = [(arb(0), step)]
    while pieces:
        start, end = pieces.pop()
        interval = start.union(end)
        if polynomial(interval) > 0:
            continue
        monotone = not derivative(interval).contains(0)
        if monotone or end - start < TOUCH_WIDTH:
            if polynomial(end).mid() < 0:
                return _located(polynomial, derivative, start, end)
            continue
        middle = ((start + end) / 2).mid()
        pieces += [(middle, end), (start, middle)]
    return None


def _located(polynomial: arb_poly, derivative: arb_poly, start: arb, end: arb) -> arb:
    """The zero between `start` (positive) and `end` (negative), by Newton inside a shrinking bracket."""
    point, near = ((start + end) / 2).mid(), arb(10) ** -(ctx.dps - 8)
    for _ in range(400):
        value = polynomial(point).mid()
        if value > 0:
            start = point
        else:
            end = point
        slope = derivative(point).mid()
        closer = (point - value / slope).mid() if slope != 0 else end
        if not start < closer < end:
            closer = ((start + end) / 2).mid()
        if abs(closer - point) < near:
            return closer
        point = closer
    return point
