"""The body on the ground: known answers A14, A15, A19, A29, sticking and friction, by the public interface."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from exact_motion import duhamel

import vibro_ros

NO_CONTACT = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}
TOTAL_MASS, GRAVITY = 1.18, 9.81
SINE = np.sin(np.radians(50.0))
FORCE_ROUNDING = 1e-9  # N: a plate of 1e7 N/m times positions of 0.06 m, a few roundings each
FORCES = ("weight", "unilateral", "printed")


def paper(changes):
    return vibro_ros.load_scene("paper").with_parameters(changes)


def greatest_inward_force(duration):
    """Greatest |F_in| = k3 |w - s_C| sin φ of the paper's crank without contact, in [0, duration].

    Duhamel's integral on a grid of 1e-4 s, refined at the peak to 1e-7 s (relative error 1e-10).
    """
    def force(times):
        lag = 0.8726646259971648
        sliders = 0.02 * np.cos(100 * times - lag) + np.sqrt(0.06**2 - (0.02 * np.sin(100 * times - lag)) ** 2)
        start = 0.02 * np.cos(lag) + np.sqrt(0.06**2 - (0.02 * np.sin(lag)) ** 2)
        masses = duhamel(times, 100.0, np.sqrt(1e3 / 0.08), start, 0.02, 0.06, lag)
        return np.abs(1e3 * (masses - sliders)) * SINE

    coarse = np.arange(0.0, duration, 1e-4)
    peak = coarse[np.argmax(force(coarse))]
    return force(np.linspace(peak - 1e-4, peak + 1e-4, 2001)).max()


@pytest.mark.parametrize(("excess", "slips"), [(1e-7, False), (-1e-7, True)])
def test_a_block_slips_only_beyond_the_friction_limit(excess, slips):
    """A14. With μ a ten-millionth above max|F_in|/(M g) the body never moves; below, it starts just at the end."""
    limit = greatest_inward_force(0.2) / (TOTAL_MASS * GRAVITY)
    scene = paper(NO_CONTACT | {"effects.normal_force": "weight", "ground.friction": limit * (1 + excess)})
    run = vibro_ros.simulate(scene, duration=0.2, rate=1000.0)
    assert slips or np.all(run.body_position == 0.0)
    assert bool(np.isin(run.events["kind"], ["slip_forward", "slip_backward"]).any()) is slips


@pytest.mark.parametrize("turns", [2.1, 2.5])  # backwards, forwards
def test_a_block_slides_to_rest_under_friction_alone(turns):
    """A15. Once the motor stands and the stiff, critically damped drive is still, v = v0 - μ g t sign(v0).

    It stops after |v0|/(μ g) in v0²/(2μ g) and stays there at exactly 0. Before it is measured the drive
    has decayed by e⁻⁷⁰ (3500/s for 0.02 s). What it still pulls is 1e6 N/m times the position's rounding,
    1e-11 N: 1e-12 m/s in 0.1 s, and 1e-11 s of the stop at 0.2 m/s².
    """
    damping = 2 * np.sqrt(1e6 * 0.08)
    friction = 0.02
    device = vibro_ros.Simulator(paper(NO_CONTACT | {
        "effects.normal_force": "weight", "ground.friction": friction, "inclined.spring.stiffness": 1e6,
        "inclined.spring.damping": damping, "crank.radius": 0.03, "motor.speed": 20.0}))
    device.advance_to(turns * 2 * np.pi / 20)
    device.command(motor_speed=0.0)
    device.advance_to(device.time + 0.02)
    device.take_events()
    began, position, speed = device.time, device.state.body_position, device.state.body_velocity
    assert abs(speed) > 1e-3
    deceleration = friction * GRAVITY
    stop = abs(speed) / deceleration
    for share in (0.25, 0.5, 0.99):
        device.advance_to(began + share * stop)
        left = device.time - began
        assert device.state.body_velocity == pytest.approx(speed - np.sign(speed) * deceleration * left, abs=1e-12)
        assert device.state.body_position == pytest.approx(
            position + speed * left - np.sign(speed) * deceleration * left**2 / 2, abs=1e-12)
    device.advance_to(began + stop + 0.1)
    assert device.state.body_velocity == 0.0
    assert device.state.body_position == pytest.approx(position + speed * abs(speed) / (2 * deceleration), abs=1e-12)
    (event,) = device.take_events()
    assert event["kind"] == "stick"
    assert event["time"] == pytest.approx(began + stop, abs=1e-11)


TWINS = {"mass.inclined": 0.1, "guide.angle": 0.0, "effects.normal_force": "unilateral"}


def test_twin_masses_move_as_one():
    """A19. φ = 0 and equal masses; both touch in the same instants, and nothing pushes the body.

    To the rounding of a position, 1e-17 m at first, and what chaos (5/s) and 15 impacts make of it.
    """
    run = vibro_ros.simulate(paper(TWINS), duration=0.3, rate=1000.0)
    np.testing.assert_allclose(run.upper_position, run.inclined_position, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(run.body_position, 0.0)
    upper, inclined = (np.sort(run.events[run.events["kind"] == kind], order="time")
                       for kind in ("upper_contact", "inclined_contact"))
    assert len(upper) == len(inclined) > 3
    for key in ("time", "speed", "peak_force", "duration"):
        np.testing.assert_allclose(upper[key], inclined[key], rtol=1e-12, atol=0)


def test_normal_force_follows_its_rule():
    """Equation (6), its part above 0, or M g."""
    runs = {force: vibro_ros.simulate(paper({"effects.normal_force": force}), duration=0.5, rate=20000.0)
            for force in FORCES}
    printed = runs["printed"]
    upper = printed.upper_plate_force - printed.upper_drive_force
    inclined = printed.inclined_plate_force - printed.inclined_drive_force
    expected = TOTAL_MASS * GRAVITY - upper - inclined * np.cos(np.radians(50.0))
    np.testing.assert_allclose(printed.normal_force, expected, rtol=0, atol=FORCE_ROUNDING)
    assert printed.normal_force.min() < -1000.0
    np.testing.assert_allclose(runs["unilateral"].normal_force, np.maximum(expected, 0.0), rtol=0, atol=FORCE_ROUNDING)
    np.testing.assert_array_equal(runs["weight"].normal_force, runs["weight"].normal_force[0])
    assert runs["weight"].normal_force[0] == pytest.approx(TOTAL_MASS * GRAVITY, rel=1e-15)


def test_friction_drives_a_body_whose_printed_normal_force_is_negative():
    """By the rule `printed` N may be negative; then the body never sticks, and friction pushes it in the direction of
    its motion.
    """
    run = vibro_ros.simulate(paper({}), duration=1.0, rate=20000.0)
    lifted = run.normal_force < 0.0
    assert np.count_nonzero(lifted) > 50
    assert np.all(run.body_velocity[lifted] != 0.0)
    assert np.all(run.friction_force[lifted] * run.body_velocity[lifted] < 0.0)


@pytest.mark.parametrize("changes", [
    *({"guide.angle": 0.0, "effects.normal_force": force} for force in FORCES),
    *({"crank.radius": radius, "guide.angle": angle, "motor.speed": 0.0, "inclined.gap": 0.02}
      for radius, angle in ((0.0599, math.pi / 2), (0.06, 1.126), (0.02, 0.9)))], ids=str)
def test_a_body_without_a_force_along_x_stays_at_rest(changes):
    """F_in is 0 for φ = 0 and of a mass at rest on a standing slider, so eq. (5) gives F_fr = 0 at rest, whatever the
    sign of N, which the upper mass on its plate makes negative again and again by the rule `printed`."""
    run = vibro_ros.simulate(paper(changes), duration=0.5, rate=1000.0)
    assert run.normal_force.min() < 0.0 or "effects.normal_force" in changes
    for name in ("body_position", "body_velocity", "friction_force"):
        np.testing.assert_array_equal(getattr(run, name), 0.0)


SCENES = ("paper", "unilateral", "damped", "rigid")


@pytest.mark.parametrize(("name", "law"), itertools.product([*SCENES, "device"], ["coulomb", "static", "stribeck"]))
def test_a_coefficient_of_zero_gives_the_bits_of_no_friction(name, law):
    """Every sample, event and count agrees, because the scene compiles to the same modes, terms and guards."""
    scene = vibro_ros.load_scene(name).with_parameters({"motor.speed": 100.0})
    smooth = scene.with_parameters({"effects.friction": law, "ground.friction": 0.0, "ground.static_friction": 0.0})
    without = scene.with_parameters({"effects.friction": "none"})
    assert smooth.describe() == without.describe()
    smooth_run, expected = (vibro_ros.simulate(scene, duration=1.0, rate=1000.0) for scene in (smooth, without))
    assert len(expected.events) > 20 and np.abs(expected.body_velocity).max() > 0.1
    for field in dataclasses.fields(expected):
        if field.name != "statistics":
            np.testing.assert_array_equal(getattr(smooth_run, field.name), getattr(expected, field.name), field.name)
    assert {**smooth_run.statistics, "wall_time": 0.0} == {**expected.statistics, "wall_time": 0.0}


def test_a_static_coefficient_alone_is_friction():
    """Without kinetic friction, static friction alone may hold a body, so that friction is not left out."""
    scene = vibro_ros.load_scene("unilateral").with_parameters({
        "effects.friction": "static", "ground.friction": 0.0, "ground.static_friction": 0.2})
    events = vibro_ros.simulate(scene, duration=0.2, rate=100.0).events
    assert np.isin(events["kind"], ["slip_forward", "slip_backward"]).any()
