"""Motions that starts settle to: against orbits of Newton's method, maps of known attractors, and counted basins."""

import math

import numpy as np
import pytest
from closed_form import ImpactOscillator

import vibro_ros
from vibro_ros.orbits.orbit import close
from vibro_ros.orbits.recurrence import (
    CLOSE,
    Cloud,
    NotSettledError,
    SettledMotion,
    number_among,
    period_of,
    settle,
    settled_motion,
)
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap, free_cut


def scene(name: str, **changes) -> vibro_ros.Scene:
    return vibro_ros.load_scene(name).with_parameters({"motor.speed": 100.0} | changes)


def drawn(number: int) -> dict[str, float]:
    """A start about which nothing is special."""
    draw = np.random.default_rng((18, number))
    around = {"body_velocity": (0.0, 1.0), "upper_position": (0.06, 0.02), "upper_velocity": (0.0, 2.0),
              "inclined_position": (0.06, 0.02), "inclined_velocity": (0.0, 2.0), "crank_angle": (math.pi, math.pi)}
    return {name: float(draw.uniform(middle - reach, middle + reach)) for name, (middle, reach) in around.items()}


def motions(of: vibro_ros.Scene, starts: int) -> list[tuple[SettledMotion, int]]:
    """Motions and how many of the first drawn starts settle to each."""
    stroboscope, known, count = Stroboscope(free_cut(of)), [], []
    for number in range(starts):
        stroboscope.begin_as(**drawn(number))
        motion = settle(stroboscope)
        place = number_among(motion, known)
        if place is None:
            known.append(motion)
            count.append(0)
            place = -1
        count[place] += 1
    return list(zip(known, count, strict=True))


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
    of = scene("damped")
    stroboscope = Stroboscope(TurnMap(of, 2.0))
    first = stroboscope.begin_as(crank_angle=angle, upper_velocity=0.3)
    device = vibro_ros.Simulator(of)
    device.set_state(crank_angle=angle, upper_velocity=0.3)
    device.advance_to((2.0 - angle) % (2.0 * math.pi) / 100.0)
    assert first.states[0] == pytest.approx(stroboscope.turn_map.read(device.state), abs=1e-12)


ATTRACTING = [("damped", 100.0, 1), ("device", 60.0, 1), ("device", 100.0, 4), ("device", 140.0, 2),
              ("device", 160.0, 3), ("device", 240.0, 8), ("rigid", 100.0, 1)]


@pytest.mark.parametrize(("name", "speed", "turns"), ATTRACTING)
def test_what_a_start_settles_to_is_the_orbit_that_newton_finds(name, speed, turns):
    """A48. From the scene's own start."""
    of = scene(name, **{"motor.speed": speed})
    stroboscope = Stroboscope(free_cut(of))
    stroboscope.begin_as()
    motion = settle(stroboscope)
    assert motion.turns == turns == len(motion.states)
    orbit = close(stroboscope.turn_map, motion.states[-1], turns)
    assert np.abs(motion.states[-1] - orbit.state).max() <= CLOSE
    assert motion.mean_speed == pytest.approx(vibro_ros.find_orbit(of, turns).mean_speed, abs=1e-6)
    assert vibro_ros.settled_motion(of).is_same(motion)


def test_the_rare_motion_is_found():
    """The paper's robot with losses, eq. (6) as printed, 0.25 kg at 80 degrees: -35 mm/s, and seldom -236 mm/s."""
    of = scene("damped", **{"effects.normal_force": "printed", "mass.inclined": 0.25,
                            "guide.angle": math.radians(80.0)})
    found = sorted((round(motion.mean_speed * 1e3), motion.turns, count) for motion, count in motions(of, 60))
    assert [entry[:2] for entry in found] == [(-237, 1), (-35, 1)]
    assert found[0][2] < 20 and found[0][2] + found[1][2] == 60


@pytest.mark.parametrize(("speed", "restitution", "gap"), [(170.0, 0.5, 0.01), (170.0, 0.8, 0.018), (130.0, 0.8, 0.03)])
def test_an_unstable_orbit_of_closed_form_parts_the_basins_of_two_stable_ones(speed, restitution, gap):
    """A49. The saddle lies on the border of the basins: a blow a thousandth faster or slower decides between the orbit
    with one blow a turn and the steady motion that misses the plate."""
    of = scene("unilateral", **{
        "motor.speed": speed, "effects.inclined_mass": False, "upper.spring.damping": 1.0, "upper.gap": gap,
        "effects.upper_contact": "restitution", "upper.plate.restitution": restitution})
    closed = ImpactOscillator(of)
    phases = closed.phases_where(lambda phase: closed.blow(phase).gap - gap)
    stable, saddle = sorted(phases, key=lambda phase: np.abs(closed.multipliers(phase)).max())
    assert np.abs(closed.multipliers(stable)).max() < 1.0 < closed.multipliers(saddle).real.max()

    def after_blow(phase: float, part: float) -> SettledMotion:
        return settled_motion(of, crank_angle=phase, upper_position=closed.rod + gap,
                              upper_velocity=-restitution * closed.blow(phase).speed * part)

    struck, missed = sorted((after_blow(saddle, part) for part in (0.999, 1.001)),
                            key=lambda motion: not motion.is_same(after_blow(stable, 1.0)))
    assert struck.is_same(after_blow(stable, 1.0)) and not missed.is_same(struck)
    turn_map = free_cut(of)
    steady = np.array(closed.steady(turn_map.phase)[:2]) / turn_map.units
    assert missed.turns == 1 and missed.states[0] == pytest.approx(steady, abs=1e-5)


def test_motions_with_the_same_period_are_told_apart():
    found = motions(scene("device", **{"motor.speed": 160.0}), 8)
    assert sorted((motion.turns, round(motion.mean_speed * 1e3, 2)) for motion, _ in found) == [(3, -79.8), (3, -53.58)]


def test_a_chaotic_motion_is_one_from_all_starts():
    """`device` at 120 rad/s: all of these starts part from each other, and stay on one attractor."""
    found = motions(scene("device", **{"motor.speed": 120.0}), 8)
    chaotic = [motion for motion, _ in found if motion.turns == 0]
    assert len(chaotic) == 1 and chaotic[0].mean_speed == pytest.approx(-0.0455, abs=2e-4)


def test_a_scene_without_losses_does_not_settle():
    with pytest.raises(NotSettledError, match=r"no_impact: at 100 rad/s nothing has settled within 4096 turns"):
        settled_motion(scene("no_impact"))


@pytest.mark.parametrize("multiplier", [0.5, 0.9, -0.9, 0.97, 0.95 * np.exp(1j)])
def test_an_approach_is_not_taken_for_its_end(multiplier):
    """x -> multiplier x, whose one motion is x = 0."""
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
    found = []
    for number in range(1256):
        x, y = 1.0 - a * x * x + y, 0.3 * x
        if number >= 1000:
            found.append((x, y))
    return np.array(found)


def test_a_strange_attractor_is_known_from_any_start_and_told_from_what_is_not_it():
    one, other = henon(0.1, 0.1, 1.4), henon(-0.2, 0.05, 1.4)
    assert Cloud(other).holds(one) and Cloud(one).holds(other)
    assert Cloud(other).holds(np.stack([one + [0.0, 0.1], one, one * [-1.0, 1.0]])).tolist() == [False, True, False]
