"""Curves of special points over two parameters, compared with closed forms, with a branch over one parameter, and from
the other end.
"""

from dataclasses import replace

import numpy as np
import pytest
from closed_form import ImpactOscillator
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar
from test_continuation import HIGH, LOW, oscillator

import vibro_lab
import vibro_ros
from vibro_lab.orbits.branch import Special
from vibro_lab.orbits.continuation import DOUBLING, FOLD, GRAZING, TORUS
from vibro_lab.orbits.turn_map import TurnMap


def first(scene: vibro_ros.Scene, name: str, low: float, high: float, upwards: bool, kind: str, points: int = 60):
    """The branch through the scene's own orbit, and its first special point of a kind."""
    branch = vibro_lab.follow_orbit(vibro_lab.find_orbit(scene), name, low, high, upwards, points)
    return branch, next(one for one in branch.special_points if one.kind == kind)


@pytest.mark.parametrize(("speed", "restitution", "gap", "points", "kind", "reach"), [
    (170.0, 0.5, 0.0, 40, FOLD, 20.0), (230.0, 0.5, -0.003, 22, DOUBLING, 20.0)])
def test_folds_and_doublings_over_two_parameters_are_those_of_the_closed_form(speed, restitution, gap, points, kind,
                                                                             reach):
    branch, special = first(oscillator(speed, restitution, gap), "upper.gap", LOW, HIGH, True, kind, points)
    curve = vibro_lab.follow_bifurcation(branch, special, {
        "upper.gap": (LOW, HIGH), "motor.speed": (speed - reach, speed + reach)})
    assert curve.end == f"motor.speed leaves its range at {speed + reach:g} rad/s"
    assert curve.values[-1, 1] == pytest.approx(speed + reach, abs=1e-12)
    critical = {FOLD: 1.0, DOUBLING: -1.0}[kind]
    for here, at in curve.values[::-4]:
        closed = ImpactOscillator(oscillator(at, restitution, here))
        phases = closed.phases_where(
            lambda phase, own=closed: float(np.prod(own.multipliers(phase) - critical).real), 200)
        # Rounding of the derivative, 1e-10, moves a doubling by as much, in crank radii; a fold by its square.
        assert min(abs(closed.blow(phase).gap - here) for phase in phases) < 1e-12


def test_a_mass_grazes_its_plate_where_the_gap_is_the_amplitude_of_the_steady_motion():
    branch, special = first(oscillator(170.0, 0.8, 0.02), "upper.gap", LOW, HIGH, False, GRAZING)
    assert "no orbit was found beyond" in branch.end and special.change == "upper_contact appears"
    curve = vibro_lab.follow_bifurcation(branch, special, {"upper.gap": (LOW, HIGH), "motor.speed": (160.0, 180.0)})
    assert curve.end == "motor.speed leaves its range at 180 rad/s"
    for here, at in curve.values:
        closed = ImpactOscillator(oscillator(at, 0.8, here))
        phases = np.linspace(0.0, 2.0 * np.pi, 100)
        best = phases[np.argmax([closed.steady(phase)[0] for phase in phases])]
        most = minimize_scalar(lambda phase, own=closed: -own.steady(phase)[0], bounds=(best - 0.1, best + 0.1),
                               method="bounded", options={"xatol": 1e-9})
        assert here + closed.rod == pytest.approx(-most.fun, abs=1e-13)  # rounding, and (1e-6)² crank radii


@pytest.mark.parametrize("kind", [FOLD, GRAZING])
def test_a_curve_comes_back_and_lies_where_one_parameter_has_its_special_point(kind):
    """`damped` over motor speed and gap: the curve is followed for a few orbits; the branch at the gap of the last one
    has its special point there, and the curve from there leads back.
    """
    branch, special = first(vibro_ros.load_scene("damped"), "motor.speed", 95.0, 112.0, True, kind)
    ranges = {"motor.speed": (90.0, 112.0), "inclined.gap": (0.0, 0.001)}
    there = vibro_lab.follow_bifurcation(branch, special, ranges, points=4)
    assert len(there) == 4 and not there.special_points
    gap = there.values[-1, 1]
    moved = branch.scene.with_parameters({"inclined.gap": gap})
    last = Special(kind, there.mean_speeds[-1], there.multipliers[-1], special.change, there.phases[-1],
                   there.states[-1], 0, there.values[-1])
    back = vibro_lab.follow_bifurcation(replace(branch, scene=moved), last, ranges, upwards=False)
    assert gap > 1e-5 and back.end == "inclined.gap leaves its range at 0 m"
    assert back.values[-1, 0] == pytest.approx(special.value, abs=1e-7)  # to which one parameter locates it
    assert back.values[-1] == pytest.approx(there.values[0], abs=1e-9)
    assert back.mean_speeds[-1] == pytest.approx(there.mean_speeds[0], abs=1e-9)
    _, found = first(moved, "motor.speed", 95.0, 112.0, True, kind)
    assert there.values[-1, 0] == pytest.approx(found.value, abs=1e-7)


def test_a_special_point_without_a_curve_and_parameters_that_are_not_two_are_refused():
    scene = oscillator(170.0, 0.5, 0.0)
    branch, fold = first(scene, "upper.gap", LOW, HIGH, True, FOLD)
    landing = replace(fold, kind=GRAZING, change="landing_stops appears, lift_off appears")
    circle = replace(fold, kind=TORUS)
    for special, ranges, message in (
            (circle, {"upper.gap": (LOW, HIGH), "motor.speed": (160.0, 180.0)},
             "special: a Neimark-Sacker has no curve; give a fold, a period doubling, or a grazing of a plate"),
            (landing, {"upper.gap": (LOW, HIGH), "motor.speed": (160.0, 180.0)}, "special: a grazing .* has no curve"),
            (fold, {"upper.gap": (LOW, HIGH)}, "ranges: 1 parameters; give two"),
            (fold, {"motor.speed": (160.0, 180.0), "mass.upper": (0.1, 0.2)}, "ranges: has no upper.gap"),
            (fold, {"upper.gap": (LOW, HIGH), "motor.speed": (171.0, 180.0)}, "motor.speed: the special point's 170")):
        with pytest.raises(ValueError, match=message):
            vibro_lab.follow_bifurcation(branch, special, ranges)


def test_two_folds_meet_in_the_cusp_of_the_closed_form():
    """From one fold at 56 rad/s through the cusp to the other fold at 56 rad/s."""
    def closed(speed):
        return ImpactOscillator(oscillator(speed, 0.2, 0.0).with_parameters({"upper.spring.damping": 0.5}))

    def slope(phase, own):
        """Derivative of the gap by the phase of the blow, by differences of fourth order; 0 at a fold."""
        gaps = [own.blow(phase + k * 1e-3).gap for k in (-2.0, -1.0, 1.0, 2.0)]
        return (gaps[0] - 8.0 * gaps[1] + 8.0 * gaps[2] - gaps[3]) / 12e-3

    def lowest(speed):
        """Return where the slope between the folds is least, and the slope there, which is 0 at the cusp."""
        own = closed(speed)
        return minimize_scalar(lambda phase: slope(phase, own), bounds=(5.1, 5.5), method="bounded",
                               options={"xatol": 1e-8})

    own = closed(56.0)
    first_fold, second_fold = (brentq(slope, *bounds, args=(own,)) for bounds in ((5.1, 5.3), (5.3, 5.6)))
    at_cusp = brentq(lambda speed: lowest(speed).fun, 56.1, 56.5, xtol=1e-12)
    blow = own.blow(first_fold)
    scene = own.scene.with_parameters({"upper.gap": blow.gap})
    turn_map, phase = TurnMap(scene), first_fold + 2.0  # rad, of the cut
    position, velocity, _ = own.steady(first_fold)
    after = [blow.gap + own.rod - position, -own.restitution * blow.speed - velocity]
    state = np.array(own.steady(phase)[:2]) + expm(own.matrix * 2.0 / own.speed) @ after
    orbit = vibro_lab.find_orbit(scene.with_parameters({"upper.gap": 0.0222}))
    branch = replace(vibro_lab.follow_orbit(orbit, "upper.gap", 0.022, 0.023, points=2), scene=scene)
    special = Special(FOLD, 0.0, own.multipliers(first_fold), "", phase % (2.0 * np.pi), state / turn_map.units, 0,
                      np.array([blow.gap]))
    curve = vibro_lab.follow_bifurcation(branch, special, {"upper.gap": (0.015, 0.03), "motor.speed": (56.0, 62.0)})
    turns_back = np.argmax(curve.values[:, 1])
    assert 56.0 < curve.values[turns_back, 1] <= at_cusp + 1e-9 and 0 < turns_back < len(curve) - 1
    assert curve.end == "motor.speed leaves its range at 56 rad/s"
    assert curve.values[-1, 0] == pytest.approx(own.blow(second_fold).gap, abs=1e-12)
