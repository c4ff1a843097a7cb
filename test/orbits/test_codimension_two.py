"""Points of codimension two, and curves of Neimark-Sacker points, of a map whose bifurcations have closed forms.

The map is the generalised Henon map of V. S. Gonchenko, Yu. A. Kuznetsov and H. G. E. Meijer, SIAM J. Appl. Dyn. Syst.
4 (2005), pp. 407-436: x' = y, y' = a - b x - y^2 + R x y + S y^3. Its orbit of one turn is x = y = t, where the
derivative has the trace (R - 2) t + 3 S t^2 and the determinant b - R t. Two coordinates that shrink, and a change of
coordinates, make it a map of four; a fifth is held at 0, and as a body on the ground it may not be below.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

from vibro_ros.orbits.continuation import DOUBLING, FOLD, TORUS
from vibro_ros.orbits.curve import Curve, curve_from
from vibro_ros.orbits.passage import Passage
from vibro_ros.orbits.plane import CUSP, FLIP, FOLD_FLIP, R1, R2, R3, R4, Plane, corrected

NOTHING = Passage((), 1.0, 0.0, np.inf, np.inf, (), ())  # happens on the way
SHRINKING = np.array([0.3, -0.5])
MIXED = np.array([[1.0, 0.3, -0.2, 0.1], [0.2, 0.9, 0.4, -0.3], [-0.1, 0.2, 1.1, 0.3], [0.3, -0.2, 0.1, 0.8]])
NEAR = 2e-6
"""Of the orbit t: a point of codimension two is located within an arc of 1e-6, in shares and mixed coordinates."""


@dataclass(frozen=True)
class Henon:
    """The map with its coefficients R and S."""

    crossed: float
    cubic: float

    def image(self, point: np.ndarray, a: float, b: float) -> np.ndarray:
        x, y, *others = point
        return np.array([y, a - b * x - y**2 + self.crossed * x * y + self.cubic * y**3,
                         *(SHRINKING * others + [0.1 * x**2, 0.2 * x * y])])

    def trace(self, t: float) -> float:
        return (self.crossed - 2.0) * t + 3.0 * self.cubic * t**2

    def parameters(self, kind: str, t: float) -> np.ndarray:
        """a and b at which the orbit at t is a special point: its multipliers fulfil 1 -+ trace + determinant = 0, or
        determinant = 1."""
        determinant = {FOLD: self.trace(t) - 1.0, DOUBLING: -self.trace(t) - 1.0, TORUS: 1.0}[kind]
        b = determinant + self.crossed * t
        return np.array([(1.0 + b) * t + (1.0 - self.crossed) * t**2 - self.cubic * t**3, b])

    def state(self, t: float) -> np.ndarray:
        return np.append(MIXED @ [t, t, *(np.array([0.1, 0.2]) * t**2 / (1.0 - SHRINKING))], 0.0)

    def traces(self, value: float) -> list[float]:
        """Orbits whose trace has a value."""
        return sorted(np.roots([3.0 * self.cubic, self.crossed - 2.0, -value]).real)


class HenonPlane(Plane):
    """The map over its two parameters, in place of that of a machine."""

    def __init__(self, henon: Henon, ranges: dict[str, tuple[float, float]]):
        self.henon, self.ranges, self.names, self.turns, self.phase = henon, ranges, tuple(ranges), 1, 0.0
        self.units = np.ones(5)
        self._low, self._high = np.array(list(ranges.values())).T

    def residual(self, vector):
        if vector[4] < 0.0:
            raise ValueError(f"body_height: {vector[4]:g} is out of range")
        image = self.henon.image(np.linalg.solve(MIXED, vector[:4]), *self.values(vector[5:]))
        return np.append(MIXED @ image - vector[:4], 0.0)

    def free(self, vector):
        return np.arange(7) != 4

    def mean_speed(self, vector):
        return 0.0

    def order(self, vector):
        return ()

    def passage(self, vector):
        return NOTHING

    def jacobian(self, vector):
        units, matrix = 1e-3 * np.eye(7), np.zeros((5, 7))
        for k in np.flatnonzero(self.free(vector)):
            wide, narrow = ((self.residual(vector + part * units[k]) - self.residual(vector - part * units[k]))
                            / (2e-3 * part) for part in (1.0, 0.5))
            matrix[:, k] = (4.0 * narrow - wide) / 3.0
        matrix[4, 4] = -1.0
        return matrix


def curve(henon: Henon, kind: str, begin: float, upwards: bool, width: float = 40.0) -> Curve:
    """The curve of special points from the orbit at `begin` on, over ranges of a width around 0."""
    ends = (-0.5 * width, 0.5 * width)
    plane = HenonPlane(henon, {"motor.speed": ends, "upper.gap": ends})
    guess = np.append(henon.state(begin), plane.shares(henon.parameters(kind, begin)))
    ahead = np.append(henon.state(begin + 1e-3), plane.shares(henon.parameters(kind, begin + 1e-3))) - guess
    start, _ = corrected(plane, kind, guess, ahead if upwards else -ahead, None)
    return curve_from(start, 400)


def orbits_at(found: Curve) -> list[float]:
    """The orbits t of a curve."""
    return [float(np.linalg.solve(MIXED, state[:4])[0]) for state in found.states]


def points_of(found: Curve) -> list[tuple[str, float]]:
    """Kinds and orbits t of a curve's points of codimension two."""
    return [(one.kind, float(np.linalg.solve(MIXED, one.state[:4])[0])) for one in found.special_points]


def assert_on_closed_form(found: Curve, henon: Henon):
    """That each orbit of the curve has the parameters of the closed form."""
    for t, values in zip(orbits_at(found), found.values, strict=True):
        assert values == pytest.approx(henon.parameters(found.kind, t), abs=1e-8)  # the test's differences leave 1e-9


def assert_located(found: Curve, expected: list[tuple[str, float]]):
    """That the points of codimension two are those of the closed form, in their order, and no others."""
    met = points_of(found)
    assert [kind for kind, _ in met] == [kind for kind, _ in expected]
    assert [t for _, t in met] == pytest.approx([t for _, t in expected], abs=NEAR)


def test_a_curve_of_neimark_sacker_points_goes_through_strong_resonances_from_1_1_to_1_2():
    """A pair of multipliers on the unit circle has the sum 2 at a 1:1 resonance, 0 at 1:4, -1 at 1:3, and -2 at 1:2."""
    henon = Henon(0.6, 0.05)
    first, fourth, third, second = (henon.traces(value)[0] for value in (2.0, 0.0, -1.0, -2.0))
    upwards, downwards = (curve(henon, TORUS, 0.1, ahead) for ahead in (True, False))
    for found, points in ((upwards, [(R3, third), (R2, second)]), (downwards, [(R4, fourth), (R1, first)])):
        assert_on_closed_form(found, henon)
        assert_located(found, points)
        last = points[-1][0]
        assert found.end == f"the curve ends at a {last}, where the pair of multipliers becomes real"
        assert orbits_at(found)[-1] == pytest.approx(points[-1][1], abs=NEAR)
        assert np.abs(found.multipliers[:-1, :2]) == pytest.approx(1.0, abs=1e-7)  # not the last: a double multiplier


def test_a_curve_of_neimark_sacker_points_ends_at_its_resonance_whatever_lies_in_the_same_step():
    """Over ranges of 4000 the first step crosses the whole curve, and the 1:3 resonance with it."""
    henon = Henon(0.6, 0.05)
    found = curve(henon, TORUS, 0.1, True, width=4000.0)
    assert [kind for kind, _ in points_of(found)] == [R3, R2] and "ends at a 1:2 resonance" in found.end


def test_a_curve_of_folds_has_the_cusp_resonances_and_fold_flips_of_the_closed_form():
    """The second multiplier is the trace - 1; the parameter a turns back, at steady b, where (1 - R) = 3 S t."""
    henon = Henon(0.6, 0.5)
    found = curve(henon, FOLD, -0.9, True)
    assert_on_closed_form(found, henon)
    (flip, other_flip), (resonance, other_resonance) = henon.traces(0.0)[::-1], henon.traces(2.0)
    cusp = (1.0 - henon.crossed) / (3.0 * henon.cubic)
    assert_located(found, sorted([(R1, resonance), (R1, other_resonance), (CUSP, cusp), (FOLD_FLIP, flip),
                                  (FOLD_FLIP, other_flip)], key=lambda one: one[1]))


def test_a_curve_of_doublings_has_the_generalized_flips_and_fold_flips_of_the_closed_form():
    """Orbits of two turns u, v have 1 + b = s - S (s^2 - p) with s = u + v and p = u v, and

        2 a = s (1 + b) + s^2 - 2 (1 + R) p - S (s^3 - 3 s p),

    so that they leave a doubling, s = 2 t and p = t^2, to the other side of a where the derivative of a by s is 0.
    """
    henon = Henon(0.6, 0.5)
    found = curve(henon, DOUBLING, -0.3, True)
    assert_on_closed_form(found, henon)

    def turning(t):
        slope = 4.0 * t - 1.0 / henon.cubic  # of p by s
        return (2.0 * t - 3.0 * henon.cubic * t**2 + 4.0 * t - 2.0 * (1.0 + henon.crossed) * slope
                - henon.cubic * (9.0 * t**2 - 6.0 * t * slope))

    flips = [brentq(turning, *bounds) for bounds in ((0.5, 1.0), (1.2, 1.5))]
    assert_located(found, sorted([*((FOLD_FLIP, t) for t in henon.traces(0.0)), *((FLIP, t) for t in flips)],
                                 key=lambda one: one[1]))


def test_a_curve_of_doublings_has_the_1_2_resonance_of_the_closed_form():
    henon = Henon(0.6, 0.05)
    found = curve(henon, DOUBLING, 0.1, True)
    assert_on_closed_form(found, henon)
    assert_located(found, [(R2, henon.traces(-2.0)[0])])
