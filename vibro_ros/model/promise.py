"""How well the positions of a scene can be known: the error that rounding leaves, by rods and plates.

The position of a plate is rounded to eps L, where L is the longer rod. In a contact that lasts pi/w, w² = k/m, the
force k eps L changes a mass's speed by some w eps L. Stiffer plates are also struck more often: at the start, where a
mass bounces on the plate on which its spring presses it, the number of blows grows with w, and the error grows with a
power of w between two and three. Over 0.2 s of the shipped scenes, with plates of 1e5 to 1e11 N/m, one unit in the
last place of a parameter moves the positions by no more than

    eps L (w T)^2.5,    T = 7.5 ms

(test_promise.py). Dampers reduce the error; a motion that grazes a plate, or is chaotic, enlarges every rounding
error.
"""

import math

import numpy as np

#: Least error as a part of the rods' length: 4500 times the rounding of a number.
LEAST_SHARE = 1e-12
_TIME, _POWER = 7.5e-3, 2.5


def attainable_accuracy(longest_rod: float, fastest_plate: float) -> float:
    """Error of a position [m] within 0.2 s that the rounding of numbers may leave.

    Parameters
    ----------
    longest_rod : float
        Length of the longer rod [m].
    fastest_plate : float
        Largest sqrt(k / m) [rad/s] of a compliant plate and its mass; 0 without compliant plates.
    """
    return longest_rod * max(LEAST_SHARE, float(np.finfo(float).eps) * (fastest_plate * _TIME)**_POWER)


def broken_promise(tolerance: float, attainable: float) -> str:
    """Why rounding does not let the method `exact` keep a `solver.tolerance` [m]; empty if the promise holds."""
    if tolerance >= attainable:
        return ""
    return (f"solver.tolerance: {tolerance:g} m is below what rounding allows with these rods and plates; give at "
            f"least {rounded_up(attainable):g} m, or softer plates")


def rounded_up(number: float) -> float:
    """The least number of two digits that is not below `number`, so that the number in a message is accepted."""
    digit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.ceil(number / digit * (1.0 - 1e-9)) * digit:.2g}")
