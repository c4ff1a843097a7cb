"""Periodic orbits, compared with closed forms and independent numerics, and checked for invariants."""

import math

import numpy as np
import pytest
from closed_form import ImpactOscillator

import vibro_lab
import vibro_ros
from vibro_lab.orbits.orbit import OrbitNotFoundError, derivative, differences, fixed_point, orbit_at
from vibro_lab.orbits.turn_map import TurnMap

SPEED = 100.0  # rad/s
PERIOD = 2.0 * math.pi / SPEED


def scene(name: str, **changes) -> vibro_ros.Scene:
    return vibro_ros.load_scene(name).with_parameters({"motor.speed": SPEED} | changes)


def lone_mass(**changes) -> vibro_ros.Scene:
    """Return a scene with the upper mass alone on its damped drive."""
    return scene("unilateral", **{"effects.inclined_mass": False, "upper.spring.damping": 3.0} | changes)


def matrix(robot: vibro_ros.Scene) -> np.ndarray:
    """d/dt (u, u') = A (u, u') + forcing, in flight."""
    mass = robot["mass.upper"]
    return np.array([[0.0, 1.0], [-robot["upper.spring.stiffness"] / mass, -robot["upper.spring.damping"] / mass]])


def in_order(values) -> np.ndarray:
    return np.array(sorted(np.asarray(values, dtype=complex), key=lambda z: (-round(abs(z), 9), z.imag)))


@pytest.mark.process
def test_a_mirrored_crank_has_the_same_orbits():
    """The inclined mass cannot tell which way the crank turns; with the body it moves at the same mean speed."""
    orbits = {speed: vibro_lab.find_orbit(scene("damped", **{"effects.upper_mass": False, "motor.speed": speed}))
              for speed in (SPEED, -SPEED)}
    forwards, backwards = orbits.values()
    assert backwards.mean_speed == pytest.approx(forwards.mean_speed, abs=1e-13) and abs(forwards.mean_speed) > 0.01
    assert in_order(backwards.multipliers) == pytest.approx(in_order(forwards.multipliers), abs=1e-6)
    ends = {name: vibro_lab.follow_orbit(orbits[speed], "motor.speed", low, high, upwards=speed > 0.0)
            for name, speed, low, high in (("forwards", SPEED, 99.0, 102.0), ("backwards", -SPEED, -102.0, -99.0))}
    assert ends["backwards"].values[-1] == -ends["forwards"].values[-1] == -102.0
    assert ends["backwards"].mean_speeds[-1] == pytest.approx(ends["forwards"].mean_speeds[-1], abs=1e-9)
    with pytest.raises(ValueError, match="motor.speed: from -1 to 102 rad/s holds 0, which turns no crank; give a ran"):
        vibro_lab.follow_orbit(orbits[SPEED], "motor.speed", -1.0, 102.0)


@pytest.mark.parametrize("damping", [3.0, 20.0])
def test_a_linear_machine_has_the_multipliers_of_its_eigenvalues(damping):
    """Of e^(lambda T); 20 N s/m is the critical damping, whose two multipliers are equal."""
    robot = lone_mass(**{"effects.upper_contact": "none", "upper.spring.damping": damping})
    orbit = vibro_lab.find_orbit(robot)
    expected = in_order(np.exp(np.linalg.eigvals(matrix(robot)) * PERIOD))
    # A turn's rounding of 1e-14 over a step of 1e-6; two equal eigenvalues part with the root of this error.
    assert in_order(orbit.multipliers) == pytest.approx(expected, abs=1e-4 if damping == 20.0 else 1e-8)
    assert np.abs(in_order(orbit.multipliers) - expected).max() <= orbit.multiplier_error
    assert orbit.multiplier_error < (1e-4 if damping == 20.0 else 1e-8)
    assert orbit.stable and orbit.residual < 1e-13 and orbit.mean_speed == 0.0


@pytest.mark.parametrize(("restitution", "gap", "damping"), [(0.8, 0.0, 3.0), (0.5, 0.005, 1.0)])
def test_an_impact_oscillator_has_the_multipliers_of_its_closed_form(restitution, gap, damping):
    """One blow a turn, on a plate at rest."""
    robot = lone_mass(**{"effects.upper_contact": "restitution", "upper.plate.restitution": restitution,
                         "upper.gap": gap, "upper.spring.damping": damping})
    orbit, closed = vibro_lab.find_orbit(robot), ImpactOscillator(robot)
    phases = closed.phases_where(lambda phase: closed.blow(phase).gap - gap)
    multipliers = in_order(orbit.multipliers)
    expected = min((in_order(closed.multipliers(phase)) for phase in phases),
                   key=lambda pair: np.abs(multipliers - pair).max())
    assert multipliers == pytest.approx(expected, abs=1e-7)
    assert np.abs(multipliers - expected).max() <= orbit.multiplier_error + 1e-9  # of the phase
    assert np.prod(multipliers) == pytest.approx(restitution**2 * math.exp(-damping / robot["mass.upper"] * PERIOD))


def test_the_step_of_the_differences_suits_contacts_that_lie_close_together():
    """`device` at 62 rad/s: four steps agree to 1.6e-6 that the pair is -1.120327 ± 1.154315 i; 1e-5 is 5e-6 off."""
    robot = scene("device", **{"motor.speed": 62.0})
    orbit = vibro_lab.find_orbit(robot)
    turn_map = TurnMap(robot, orbit.state.crank_angle)
    state = turn_map.read(orbit.state)
    pairs = [in_order(np.linalg.eigvals(derivative(turn_map, state, 1, step)[0]))[:2] for step in (
        3e-6, 1e-6, 3e-7, 1e-7)]
    assert np.ptp(pairs, axis=0).max() < 1.6e-6
    pair = np.mean(pairs, axis=0)
    assert pair[1] == pytest.approx(-1.120327 + 1.154315j, abs=1e-6)
    assert np.abs(in_order(orbit.multipliers)[:2] - pair).max() < 1e-6
    assert 1e-8 < orbit.multiplier_error < 2.0 * 1.6e-6  # twice the difference between two of these steps


@pytest.mark.process
@pytest.mark.parametrize(("name", "turns"), [("damped", 1), ("device", 2)])
def test_multipliers_do_not_depend_on_the_cut_nor_on_the_step_of_the_differences(name, turns):
    robot = scene(name)
    orbit = vibro_lab.find_orbit(robot, turns)
    for ahead in (0.1, -0.1):
        other_map = TurnMap(robot, (orbit.state.crank_angle + ahead) % (2.0 * math.pi))
        device = vibro_ros.Simulator(robot)
        turn_map = TurnMap(robot, orbit.state.crank_angle)
        turn_map.put(device, turn_map.read(orbit.state))
        device.advance_to((ahead / SPEED) % PERIOD)
        closed = fixed_point(other_map, other_map.read(device.state), turns)
        other = orbit_at(other_map, closed, turns)
        assert other.mean_speed == pytest.approx(orbit.mean_speed, abs=1e-12)
        large = np.abs(orbit.multipliers) > 1e-3
        assert in_order(other.multipliers[large]) == pytest.approx(in_order(orbit.multipliers[large]), abs=1e-6)
        for step in (1e-4, 1e-6):
            other = np.linalg.eigvals(derivative(other_map, closed.state, turns, step)[0])
            other = other[np.abs(other) > 1e-3]
            assert in_order(other) == pytest.approx(in_order(orbit.multipliers[large]), abs=1e-5)


def test_a_disturbed_motion_leaves_an_unstable_orbit_as_fast_as_its_multiplier_says():
    robot = scene("device")
    orbit = vibro_lab.find_orbit(robot, 2)
    assert not orbit.stable
    turn_map = TurnMap(robot, orbit.state.crank_angle)
    state = turn_map.read(orbit.state)
    free = ~turn_map.held(state)
    values, vectors = np.linalg.eig(derivative(turn_map, state, 2)[0][np.ix_(free, free)])
    fastest = int(np.argmax(np.abs(values)))
    assert values[fastest] == pytest.approx(orbit.multipliers[0])
    away = 1e-8 * np.real(vectors[:, fastest])
    for passes in (1, 2, 3, 4):
        moved = turn_map(state + away, 2 * passes).state - state
        assert moved == pytest.approx(np.real(values[fastest])**passes * away, abs=1e-3 * np.abs(moved).max())


@pytest.mark.process
def test_a_motion_that_repeats_itself_later_is_named():
    with pytest.raises(OrbitNotFoundError, match=r"device: at 100 rad/s no motion was found that repeats itself after "
                                                 r"3 turns; it repeats itself after 4 turns: give turns=4"):
        vibro_lab.find_orbit(scene("device"), 3)


def test_a_resonance_without_losses_never_repeats_itself():
    with pytest.raises(OrbitNotFoundError, match="nor one that repeats itself within 64 turns"):
        vibro_lab.find_orbit(scene("no_impact"))


def test_a_number_of_turns_out_of_range_and_a_crank_that_stands_are_refused():
    for turns in (0, 65, 1.0, True):
        with pytest.raises(ValueError, match="turns: .* is out of range; give a whole number from 1 to 64"):
            vibro_lab.find_orbit(scene("damped"), turns)
    with pytest.raises(ValueError, match=r"motor.speed: 0 rad/s turns no crank; give the speed"):
        vibro_lab.find_orbit(vibro_ros.load_scene("device"))


def test_an_orbit_can_be_taken_up():
    orbit = vibro_lab.find_orbit(scene("damped"))
    device = vibro_ros.Simulator(orbit.scene)
    turn_map = TurnMap(orbit.scene, orbit.state.crank_angle)
    device.set_state(crank_angle=orbit.state.crank_angle,
                     **{name: getattr(orbit.state, name) for name in turn_map.names})
    device.advance_to(10 * PERIOD)
    assert turn_map.read(device.state) == pytest.approx(turn_map.read(orbit.state), abs=1e-12)
    assert device.state.body_position == pytest.approx(orbit.mean_speed * 10 * PERIOD, abs=1e-12)


def test_a_guess_far_off_leads_nowhere_and_says_so():
    robot = scene("device")
    turn_map = TurnMap(robot, 1.0)
    assert fixed_point(turn_map, turn_map.read(vibro_ros.Simulator(robot).state) + 50.0, 1) is None


def test_what_cannot_be_moved_one_way_has_a_one_sided_difference_and_what_is_held_has_none():
    """The derivatives of a square at a wall at 1, of three times another number, and by a coordinate that is held."""
    def end_of(at):
        if at[0] > 1.0:
            raise ValueError("within the wall")
        return np.array([at[0]**2, 3.0 * at[1], at[2]])

    at, free = np.array([1.0, 2.0, 5.0]), np.array([True, True, False])
    slopes = differences(end_of, at, free, 1e-6, end_of(at))
    assert slopes == pytest.approx(np.diag([2.0, 3.0, 0.0]), abs=2e-6)
    with pytest.raises(ValueError, match="within the wall"):
        differences(end_of, at, free, 1e-6)
