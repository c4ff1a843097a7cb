"""The motions that starts settle to, compared with orbits by Newton's method, maps with known attractors, and counted
basins.
"""

import math

import numpy as np
import pytest
from closed_form import ImpactOscillator

import vibro_lab
import vibro_ros
from vibro_lab.orbits.orbit import fixed_point
from vibro_lab.orbits.recurrence import (
    CLOSE,
    Cloud,
    NotSettledError,
    SettledMotion,
    period_of,
    settle,
    settled_motion,
)
from vibro_lab.orbits.turn_map import Stroboscope, TurnMap, free_cut


def scene(name: str, **changes) -> vibro_ros.Scene:
    return vibro_ros.load_scene(name).with_parameters({"motor.speed": 100.0} | changes)


def test_states_at_cuts_are_those_of_the_turn_map():
    turn_map = TurnMap(scene("device"), 0.85)
    state = turn_map.read(Stroboscope(turn_map).turn_map.sample(np.full(7, 0.1)))
    stroboscope = Stroboscope(turn_map)
    stroboscope.begin(state)
    seen = stroboscope.turns(3), stroboscope.turns(2)
    for number, cut in enumerate(np.concatenate([part.states for part in seen]), 1):
        end = turn_map(state, number)
        assert cut == pytest.approx(end.state, abs=1e-9)
    assert seen[1].positions[-1] == pytest.approx(end.advance, abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 2.0, 5.5])
def test_a_start_at_any_crank_angle_is_first_seen_at_the_next_cut(angle):
    robot = scene("damped")
    stroboscope = Stroboscope(TurnMap(robot, 2.0))
    first = stroboscope.begin_as(crank_angle=angle, upper_velocity=0.3)
    device = vibro_ros.Simulator(robot)
    device.set_state(crank_angle=angle, upper_velocity=0.3)
    device.advance_to((2.0 - angle) % (2.0 * math.pi) / 100.0)
    assert first.states[0] == pytest.approx(stroboscope.turn_map.read(device.state), abs=1e-12)


@pytest.mark.parametrize(("name", "speed", "turns"), [
    ("damped", 100.0, 1), ("device", 100.0, 4), ("device", 240.0, 8), ("rigid", 100.0, 1)])
def test_what_a_start_settles_to_is_the_orbit_that_newton_finds(name, speed, turns):
    """A48. Both begin with the scene's own start."""
    robot = scene(name, **{"motor.speed": speed})
    stroboscope = Stroboscope(free_cut(robot))
    stroboscope.begin_as()
    motion = settle(stroboscope)
    assert motion.turns == turns == len(motion.states)
    orbit = fixed_point(stroboscope.turn_map, motion.states[-1], turns)
    assert np.abs(motion.states[-1] - orbit.state).max() <= CLOSE
    assert motion.mean_speed == pytest.approx(vibro_lab.find_orbit(robot, turns).mean_speed, abs=1e-6)
    assert vibro_lab.settled_motion(robot).is_same(motion)


@pytest.mark.parametrize(("speed", "restitution", "gap"), [(170.0, 0.5, 0.01), (130.0, 0.8, 0.03)])
def test_an_unstable_orbit_of_closed_form_parts_the_basins_of_two_stable_ones(speed, restitution, gap):
    """A49. The saddle lies on the border of the basins: a blow a thousandth faster or slower decides between the orbit
    with one blow a turn and the steady motion that misses the plate."""
    robot = scene("unilateral", **{
        "motor.speed": speed, "effects.inclined_mass": False, "upper.spring.damping": 1.0, "upper.gap": gap,
        "effects.upper_contact": "restitution", "upper.plate.restitution": restitution})
    closed = ImpactOscillator(robot)
    phases = closed.phases_where(lambda phase: closed.blow(phase).gap - gap)
    stable, saddle = sorted(phases, key=lambda phase: np.abs(closed.multipliers(phase)).max())
    assert np.abs(closed.multipliers(stable)).max() < 1.0 < closed.multipliers(saddle).real.max()

    def after_blow(phase: float, part: float) -> SettledMotion:
        return settled_motion(robot, crank_angle=phase, upper_position=closed.rod + gap,
                              upper_velocity=-restitution * closed.blow(phase).speed * part)

    struck, missed = sorted((after_blow(saddle, part) for part in (0.999, 1.001)),
                            key=lambda motion: not motion.is_same(after_blow(stable, 1.0)))
    assert struck.is_same(after_blow(stable, 1.0)) and not missed.is_same(struck)
    turn_map = free_cut(robot)
    steady = np.array(closed.steady(turn_map.phase)[:2]) / turn_map.units
    assert missed.turns == 1 and missed.states[0] == pytest.approx(steady, abs=1e-5)


def test_a_scene_without_losses_does_not_settle():
    with pytest.raises(NotSettledError, match=r"no_impact: at 100 rad/s nothing has settled within 4096 turns"):
        settled_motion(scene("no_impact"))


@pytest.mark.parametrize("multiplier", [0.5, 0.9, -0.9, 0.97, 0.95 * np.exp(1j)])
def test_an_approach_is_not_taken_for_its_end(multiplier):
    """The map x -> multiplier x has only the motion x = 0; states that still approach 0 must not count as settled."""
    for length in (64, 128, 256, 512, 1024, 2048):
        at = multiplier ** np.arange(length)
        states = np.column_stack([np.real(at), np.imag(at)])
        if turns := period_of(states):
            break
    assert turns == 1 and np.abs(states[-1]).max() <= CLOSE


@pytest.mark.parametrize("period", [1, 2, 3, 12, 30])
def test_the_least_period_is_found(period):
    states = np.random.default_rng(period).normal(size=(period, 5))[np.arange(512) % period]
    assert period_of(states) == period
    assert period_of(states + np.random.default_rng(1).normal(scale=1e-4, size=states.shape)) == 0


def henon(x: float, y: float, a: float) -> np.ndarray:
    """Henon's map, chaotic at a = 1.4 and 1.3."""
    speeds = []
    for number in range(1256):
        x, y = 1.0 - a * x * x + y, 0.3 * x
        if number >= 1000:
            speeds.append((x, y))
    return np.array(speeds)


def test_a_strange_attractor_is_known_from_any_start_and_told_from_what_is_not_it():
    first, other = henon(0.1, 0.1, 1.4), henon(-0.2, 0.05, 1.4)
    assert Cloud(other).holds(first) and Cloud(first).holds(other)
    moved_and_turned = np.stack([first + [0.0, 0.1], first, first * [-1.0, 1.0]])
    assert Cloud(other).holds(moved_and_turned).tolist() == [False, True, False]
