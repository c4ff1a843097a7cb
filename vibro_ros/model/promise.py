"""How well the positions of a scene can be known: what rounding leaves, by the rods' length and the plates' stiffness.

A plate's place is rounded to eps L, L the longer rod. In a contact that lasts pi/w, w² = k/m, the force k eps L changes
a mass's speed by some w eps L, and stiffer plates are struck more often, too: at the start, where a mass bounces on the
plate that its spring presses it on, the number of blows grows with w, and the error with a power of w between two and
three. Over 0.2 s of the shipped scenes, with plates of 1e5 to 1e11 N/m, one unit in the last place of a parameter moves
the positions by no more than

    eps L (w T)^2.5,    T = 7.5 ms

(test_promise.py). Dampers make it less; a motion that grazes a plate, or that is chaotic, makes more of any rounding.
"""

import math

import numpy as np

#: Least error as a part of the rods' length: 4500 times the rounding of a number.
LEAST_SHARE = 1e-12
_TIME, _POWER = 7.5e-3, 2.5


def attainable_accuracy(scene) -> float:
    """Error of a position [m] within 0.2 s that the rounding of numbers may leave in `scene`, a Scene."""
    length = max((scene[f"crank.{side}_rod"] for side in scene.guides), default=0.0)
    rates = [math.sqrt(scene[f"{side}.plate.stiffness"] / scene[f"mass.{side}"])
             for side in scene.plates if scene[f"effects.{side}_contact"] == "compliant"]
    return length * max(LEAST_SHARE, float(np.finfo(float).eps) * (max(rates, default=0.0) * _TIME)**_POWER)


def broken_promise(scene) -> str:
    """Why rounding breaks the `solver.tolerance` of `scene`, a Scene, by the method exact, or nothing."""
    holds = attainable_accuracy(scene)
    if scene["solver.tolerance"] >= holds:
        return ""
    return (f"solver.tolerance: {scene['solver.tolerance']:g} m is below what rounding allows with these rods and "
            f"plates; give at least {rounded_up(holds):g} m, or softer plates")


def rounded_up(number: float) -> float:
    """The next number of two digits, so that what a message asks for is accepted."""
    digit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.ceil(number / digit * (1.0 - 1e-9)) * digit:.2g}")
