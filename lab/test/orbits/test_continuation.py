"""Branches of orbits, compared with closed forms and with the same branch from the other end."""

import itertools

import numpy as np
import pytest
from closed_form import ImpactOscillator

import vibro_lab
import vibro_ros
from vibro_lab.orbits.continuation import CORNER, DOUBLING, FOLD, GRAZING, TORUS, follow, special_points
from vibro_lab.orbits.family import Family, corrected_orbit, point_at
from vibro_lab.orbits.orbit import fixed_point
from vibro_lab.orbits.turn_map import TurnMap

LOW, HIGH = -0.03, 0.06  # m, of the gap


def oscillator(speed: float, restitution: float, gap: float) -> vibro_ros.Scene:
    return vibro_ros.load_scene("unilateral").with_parameters({
        "motor.speed": speed, "effects.inclined_mass": False, "upper.spring.damping": 1.0, "upper.gap": gap,
        "effects.upper_contact": "restitution", "upper.plate.restitution": restitution})


def branch(scene: vibro_ros.Scene, name: str, low: float, high: float, direction: float):
    """Return neighbouring orbits on the branch through the scene's own orbit."""
    orbit = vibro_lab.find_orbit(scene)
    turn_map = TurnMap(scene, orbit.state.crank_angle)
    family = Family(scene, name, (low, high), 1, turn_map.phase)
    return followed(family, np.append(turn_map.read(orbit.state), family.scaled(scene[name])), direction)


def followed(family: Family, unknowns: np.ndarray, direction: float):
    """Return neighbouring orbits on the branch through a known one, towards larger or smaller values."""
    along = direction * np.eye(len(unknowns))[-1]
    unknowns, _ = corrected_orbit(family, unknowns, along)
    return follow(point_at(family, unknowns, along))


@pytest.mark.parametrize(("speed", "restitution", "gap", "direction", "kind"), [
    (170.0, 0.5, 0.0, 1.0, FOLD), (230.0, 0.5, -0.003, -1.0, FOLD), (130.0, 0.8, 0.01, -1.0, DOUBLING)])
def test_folds_and_doublings_of_an_impact_oscillator_are_those_of_its_closed_form(speed, restitution, gap, direction,
                                                                                  kind):
    scene = oscillator(speed, restitution, gap)
    closed = ImpactOscillator(scene)
    expected = [closed.blow(phase).gap for phase in (closed.folds() if kind == FOLD else closed.doublings())]
    neighbours = branch(scene, "upper.gap", LOW, HIGH, direction)
    special = next(special for pair in neighbours for special in special_points(*pair))
    assert special.kind == kind
    assert special.point.value == pytest.approx(expected[0], abs=1e-10)
    assert special.width < 1e-9
    critical = {FOLD: 1.0, DOUBLING: -1.0}[kind]
    assert np.abs(special.point.multipliers - critical).min() < 1e-6


def test_points_of_a_branch_lie_on_the_curve_of_its_closed_form():
    scene = oscillator(170.0, 0.5, 0.0)
    closed = ImpactOscillator(scene)
    for _, point in itertools.islice(branch(scene, "upper.gap", LOW, HIGH, 1.0), 0, 40, 8):
        sizes = sorted(np.abs(point.multipliers))
        assert any(np.allclose(sorted(np.abs(closed.multipliers(phase))), sizes, rtol=1e-4)
                   for phase in closed.phases_where(lambda phase, at=point.value: closed.blow(phase).gap - at))


@pytest.mark.parametrize(("scene", "name", "low", "high", "direction", "special"), [
    (oscillator(170.0, 0.5, 0.0), "upper.gap", LOW, HIGH, 1.0, [FOLD]),
    (vibro_ros.load_scene("device").with_parameters({"motor.speed": 62.64}), "motor.speed", 60.0, 65.0, -1.0,
     [CORNER, GRAZING, TORUS])])
def test_a_branch_is_the_same_from_either_end(scene, name, low, high, direction, special):
    """The branch is followed through its special points, and back again from beyond them."""
    forwards, kinds = [], []
    for pair in branch(scene, name, low, high, direction):
        kinds += [special.kind for special in special_points(*pair)]
        forwards.append(pair)
        if kinds == special:
            break
    (_, start), (_, last) = forwards[0], forwards[-1]
    backwards = followed(last.family, last.unknowns, -float(np.sign(last.tangent[-1])))
    _ = next(backwards)
    earlier, later = next((earlier, later) for earlier, later in backwards
                          if (later.value - start.value) * (earlier.value - start.value) < 0.0 and
                          np.linalg.norm(later.unknowns - start.unknowns) < 1.0)
    part = (start.value - earlier.value) / (later.value - earlier.value)
    guess = earlier.unknowns + part * (later.unknowns - earlier.unknowns)
    across = np.eye(len(start.unknowns))[-1]
    unknowns, _ = corrected_orbit(earlier.family, guess, across)
    _, (at_first_cut,) = earlier.family.recut(start.family.phase, [unknowns])
    assert at_first_cut == pytest.approx(start.unknowns, abs=1e-9)


def test_a_compliant_plate_is_grazed_and_passed():
    """`damped` from 100 rad/s: a fold at 107.96, back to where a blow vanishes, and on with one blow less."""
    scene = vibro_ros.load_scene("damped")
    kinds, passed = [], False
    for earlier, later in branch(scene, "motor.speed", 60.0, 130.0, 1.0):
        kinds += [(special.kind, special.point.value) for special in special_points(earlier, later)]
        passed = passed or (kinds and kinds[-1][0] == GRAZING and later.value > 110.0)
    assert [kind for kind, _ in kinds] == [FOLD, FOLD, GRAZING, CORNER]
    assert kinds[0][1] == pytest.approx(107.9599109, abs=1e-6)
    assert kinds[2][1] == pytest.approx(104.8526521, abs=1e-6) and passed
    settled = vibro_lab.find_orbit(scene.with_parameters({"motor.speed": later.value}))  # which a long run comes to
    assert later.stable and later.mean_speed == pytest.approx(settled.mean_speed, abs=1e-9)


def test_a_rigid_plate_is_grazed_and_passed():
    """A second blow a turn appears, and with it a square root of the distance: beyond the grazing, the orbit is
    unstable at once.
    """
    scene = oscillator(170.0, 0.8, 0.005)
    for earlier, later in branch(scene, "upper.gap", LOW, HIGH, -1.0):
        if specials := list(special_points(earlier, later)):
            break
    (grazing,) = specials
    assert grazing.kind == GRAZING and grazing.change == "upper_contact appears"
    assert grazing.point.passage.miss < 1e-9 and earlier.passage.contacts == (("upper_contact", 1),)
    assert later.passage.contacts == (("upper_contact", 2),)
    assert not later.stable and np.abs(later.multipliers[0]) > 10.0 * np.abs(grazing.point.multipliers[0])


def test_a_landing_that_no_longer_stops_the_body_is_a_corner():
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 62.19})
    for earlier, later in branch(scene, "motor.speed", 60.0, 65.0, 1.0):
        if specials := list(special_points(earlier, later)):
            break
    assert [special.kind for special in specials] == [CORNER]
    assert specials[0].change == "landing_stops vanishes, landing_slips_backward appears"
    assert specials[0].point.value == pytest.approx(62.208519643, abs=1e-8) and specials[0].width < 1e-8
    assert np.abs(earlier.multipliers[0]) < 2.01 and np.abs(later.multipliers[0]) > 2.3


def test_a_machine_has_a_neimark_sacker_point_beyond_which_a_circle_appears():
    """`device` at 62.626 rad/s: a run that begins beside the orbit ends on the orbit, or on a circle around it."""
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 62.64})
    special = next(point for pair in branch(scene, "motor.speed", 62.0, 63.0, -1.0) for point in special_points(*pair)
                   if point.kind == TORUS)
    phase, state = special.point.family.phase, special.point.state

    def settled(beside):
        """Return the states once a turn, minus the orbit, of a run that begins 1e-4 beside the orbit."""
        turn_map = TurnMap(scene.with_parameters({"motor.speed": special.point.value + beside}), phase)
        orbit = fixed_point(turn_map, state, 1).state
        turn_map.put(turn_map.device, orbit + 1e-4 * (np.arange(len(orbit)) == 0))
        return turn_map.cuts(turn_map.device, 4000).states[2000:] - orbit

    assert np.abs(settled(2e-4)[-1]).max() < 1e-9
    circle = settled(-2e-4)
    circle -= circle.mean(axis=0)
    left, sizes, _ = np.linalg.svd(circle, full_matrices=False)
    assert sizes[1] > 50.0 * sizes[2]  # it lies in the plane of the pair of multipliers, and ...
    around = np.hypot(*left[:, :2].T) * np.sqrt(0.5 * len(circle))
    assert 0.5 < around.min() and around.max() < 1.5  # ... goes round the orbit, which is unstable, by their angle
    angles = np.angle(left[:, 0] + 1j * left[:, 1])
    turned = abs(np.mod(np.diff(angles) + np.pi, 2.0 * np.pi).mean() - np.pi)
    expected = abs(np.angle(special.point.multipliers[0]))
    assert turned == pytest.approx(expected, abs=0.02)  # which has moved by the square


def test_a_range_that_is_none_is_refused():
    scene = oscillator(170.0, 0.5, 0.0)
    with pytest.raises(ValueError, match="upper.gap: from 0.1 to 0 is no range; give the smaller value first"):
        Family(scene, "upper.gap", (0.1, 0.0), 1, 0.0)
