"""Folds and period doublings of a driven impact oscillator against the closed forms that were published of it.

C. Budd and F. Dux (Phil. Trans. R. Soc. A 347, 1994, and Nonlinearity 7, 1994) give the speeds of impact of the orbits
with one impact in n turns of x'' + x = cos wt below a rigid stop at s: an ellipse over s, whose ends are the folds; a
period doubling is where the orbit's derivative, which follows from the speed, has the eigenvalue -1.

The crank's drive has a second harmonic of r / (4 L), which is no part of the published oscillator: what is found with
two lengths of the rod is extrapolated to an endless one.
"""

from dataclasses import replace

import numpy as np
import pytest

import vibro_lab
from research.literature.impact_oscillator import Oscillator, doubling, oscillator_scene

RADIUS, RODS = 1e-3, (1.0, 2.0)  # m; much longer ones cost digits of the position


def special_place(oscillator: Oscillator, kind: str, expected: float, rod: float) -> float:
    """Place s of the first special point of a kind on the branch of the (1, 1) orbit."""
    scene = oscillator_scene(oscillator).with_parameters({
        "crank.radius": RADIUS, "crank.upper_rod": rod, "crank.inclined_rod": rod,
        "upper.gap": 0.6 * expected * RADIUS})
    reach = 2.0 * abs(expected) * RADIUS
    orbit = vibro_lab.find_orbit(scene)
    branch = vibro_lab.follow_orbit(orbit, "upper.gap", -reach, reach, expected > 0.0, points=60)
    found = next(point for point in branch.special_points if point.kind == kind)
    assert np.abs(found.multipliers - (1.0 if kind == "fold" else -1.0)).min() < 1e-5
    assert found.width < 1e-8 * RADIUS
    return found.value / RADIUS


def extrapolated(oscillator: Oscillator, kind: str, expected: float) -> float:
    """The place with an endless rod, from which a rod of the length L differs in proportion to 1 / L."""
    short, long = (special_place(oscillator, kind, expected, rod) for rod in RODS)
    return 2.0 * long - short


def test_a_fold_is_at_the_end_of_the_published_ellipse():
    oscillator = Oscillator(1.9, 0.0, 0.8)
    fold = oscillator.fold(1)
    assert extrapolated(oscillator, "fold", fold) == pytest.approx(fold, rel=1e-6)


def test_a_period_doubling_is_where_the_published_orbit_has_the_eigenvalue_minus_one():
    oscillator = Oscillator(2.5, 0.0, 0.8)
    places = oscillator.reach * np.linspace(-0.99, 0.99, 100)
    defects = np.array([replace(oscillator, sigma=place).doubling_defect(1) for place in places])
    at = int(np.flatnonzero(defects[1:] * defects[:-1] < 0.0)[0])
    expected = doubling(oscillator, 1, places[at], places[at + 1])
    assert extrapolated(oscillator, "period doubling", expected) == pytest.approx(expected, rel=1e-6)
