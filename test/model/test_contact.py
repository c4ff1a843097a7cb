"""One mass against its plate: known answers A7 to A10, plates from soft to rigid, and overdamped
ones.

Mostly the mass of 0.1 kg floats at 0.08 m (no drive spring, motor stopped), and its plate comes down on it, so that no
other force acts.
"""

import numpy as np
import pytest
from commanded_device import assert_balanced

import vibro_ros

MASS, STIFFNESS, SPEED = 0.1, 1e7, 1.0
STOPPED = vibro_ros.load_scene("paper").with_parameters({"motor.speed": 0.0, "effects.inclined_mass": False})
FREE = STOPPED.with_parameters({"upper.spring.stiffness": 0.0, "upper.gap": 0.021, "gap_actuator.speed": SPEED,
                                "solver.accounts": True})


def contacts(events):
    return np.sort(events[events["kind"] == "upper_contact"], order="time")


def hit(changes, end=0.05, way=0.0):
    """State and the only contact after a plate 1 mm above the mass has come down at SPEED.

    `way`: how far [m] the mass goes in contact. Its place, 0.08 m, is rounded to 1.4e-17 m, and the force with it.
    """
    device = vibro_ros.Simulator(FREE.with_parameters(changes))
    device.command(upper_gap=-0.06)
    device.advance_to(end)
    assert_balanced(device, rounding=1e-15 + 2.8e-17 * device.scene["upper.plate.stiffness"] * way)
    return device.state, contacts(device.take_events())


@pytest.mark.parametrize("stiffness", [1e3, 1e7, 1e12])
def test_plates_of_any_stiffness(stiffness):
    """A8. π √(m/k) of contact, peak v √(km), exit speed -v; the places, 0.08 m, are rounded to 1.4e-17 m."""
    state, touched = hit({"upper.plate.stiffness": stiffness}, way=SPEED * np.pi * np.sqrt(MASS / stiffness))
    (contact,) = touched
    assert contact["time"] == pytest.approx(0.001, abs=1e-16)
    assert contact["duration"] == pytest.approx(np.pi * np.sqrt(MASS / stiffness), abs=1e-15)
    rounding = 2e-17 * np.sqrt(stiffness / MASS)  # of the two places that make a penetration, in depths
    assert contact["peak_force"] == pytest.approx(SPEED * np.sqrt(stiffness * MASS), rel=1e-13 + rounding)
    assert state.upper_velocity == pytest.approx(-2.0 * SPEED, rel=1e-13 + rounding)


def test_free_vibration_against_a_plate_at_the_rest_position():
    """A7. Angular frequency 2ω1ω2/(ω1+ω2) = 198.0199 rad/s; half a period is spent on the plate with ω2."""
    scene = STOPPED.with_parameters({"start.state": "zero", "upper.gap": 0.02})
    touched = contacts(vibro_ros.simulate(scene, duration=1.0, rate=10.0).events)
    free, both = np.sqrt(1e3 / MASS), np.sqrt((1e3 + STIFFNESS) / MASS)
    frequency = 2 * free * both / (free + both)
    assert frequency == pytest.approx(198.0199, abs=5e-5)
    assert len(touched) == 32  # from π/2ω1 on, every 2π/198.0199 s, up to 1 s
    # 1e-13 s: thirty turns of a few roundings (1e-16 s) each
    np.testing.assert_allclose(np.diff(touched["time"]), 2 * np.pi / frequency, rtol=0, atol=1e-13)
    assert touched["time"][0] == pytest.approx(np.pi / 2 / free, abs=1e-15)
    np.testing.assert_allclose(touched["duration"], np.pi / both, rtol=0, atol=1e-13)
    np.testing.assert_allclose(touched["speed"], 0.08 * free, rtol=1e-12)
    np.testing.assert_allclose(touched["peak_force"], STIFFNESS * 0.08 * free / both, rtol=1e-12)


def test_contact_under_a_constant_push():
    """A9. Lasts (2/ω_c)(π - atan(m ω_c v0/F)); exact here, with k + k2 for k and F = k2(s-E)."""
    scene = STOPPED.with_parameters({"start.state": "zero"})
    touched = contacts(vibro_ros.simulate(scene, duration=0.3, rate=10.0).events)
    rate, push = np.sqrt((1e3 + STIFFNESS) / MASS), 1e3 * 0.02
    speed = 100.0 * np.sqrt(0.08**2 - 0.02**2)
    duration = 2 / rate * (np.pi - np.arctan(MASS * rate * speed / push))
    depth = push / rate**2 / MASS + np.hypot(push / rate**2 / MASS, speed / rate)
    assert len(touched) > 5
    np.testing.assert_allclose(touched["speed"], speed, rtol=1e-12)
    np.testing.assert_allclose(touched["duration"], duration, rtol=0, atol=1e-14)
    np.testing.assert_allclose(touched["peak_force"], STIFFNESS * depth, rtol=1e-12)


def restitution(damping_ratio, adhesion):
    """The formulas of A10: exit speed over approach, and phase of the contact's vibration at the release."""
    root = np.sqrt(1 - damping_ratio**2)
    angle = np.pi if adhesion else np.pi - np.arctan(2 * damping_ratio * root / (1 - 2 * damping_ratio**2))
    return np.exp(-damping_ratio / root * angle), angle / root


@pytest.mark.parametrize(("damping_ratio", "adhesion", "printed"), [
    (0.05, True, 0.8545), (0.2, True, 0.5266), (0.5, True, 0.1630),
    (0.05, False, 0.8588), (0.2, False, 0.5717), (0.5, False, 0.2984)])
def test_damped_contact(damping_ratio, adhesion, printed):
    """A10. Exit speed, and the instant of release (no penetration, or no force)."""
    damping = 2 * damping_ratio * np.sqrt(STIFFNESS * MASS)
    state, (contact,) = hit({"upper.plate.damping": damping, "effects.adhesion": adhesion})
    expected, phase = restitution(damping_ratio, adhesion)
    assert expected == pytest.approx(printed, abs=5e-5)
    assert -(state.upper_velocity + SPEED) / SPEED == pytest.approx(expected, rel=1e-12)
    assert contact["duration"] == pytest.approx(phase / np.sqrt(STIFFNESS / MASS), abs=1e-14)


@pytest.mark.parametrize("damping_ratio", [0.05, 0.2, 0.5, 0.9])
def test_peak_force_of_a_damped_contact(damping_ratio):
    """The greatest k δ + c δ' of m δ'' + c δ' + k δ = 0 over a fine grid; the force at entry is c v0 already."""
    damping = 2 * damping_ratio * np.sqrt(STIFFNESS * MASS)
    _, (contact,) = hit({"upper.plate.damping": damping, "effects.adhesion": False})
    rate, decay = np.sqrt(STIFFNESS / MASS), damping_ratio * np.sqrt(STIFFNESS / MASS)
    damped = rate * np.sqrt(1 - damping_ratio**2)
    times = np.linspace(0.0, np.pi / damped, 200001)
    depth = SPEED / damped * np.exp(-decay * times) * np.sin(damped * times)
    speed = SPEED * np.exp(-decay * times) * (np.cos(damped * times) - decay / damped * np.sin(damped * times))
    assert contact["peak_force"] == pytest.approx((STIFFNESS * depth + damping * speed).max(), rel=1e-9)


@pytest.mark.parametrize("ratio", [1.0 + 1e-6, 100.0])
def test_an_overdamped_plate_without_tension_lets_go_where_its_force_vanishes(ratio):
    """m δ'' + c δ' + k δ = 0 with roots -a, -b: k δ + c δ' = -m δ'' is 0 where a² exp(-a t) = b² exp(-b t)."""
    rate = np.sqrt(STIFFNESS / MASS)
    a, b = rate * (ratio - np.sqrt(ratio**2 - 1)), rate * (ratio + np.sqrt(ratio**2 - 1))
    end = 2.0 * np.log(b / a) / (b - a)
    exit_speed = SPEED / (b - a) * (b * np.exp(-b * end) - a * np.exp(-a * end))
    assert exit_speed < 0.0
    changes = {"upper.plate.damping": 2.0 * ratio * np.sqrt(STIFFNESS * MASS), "effects.adhesion": False}
    state, touched = hit(changes, way=SPEED * end)
    (contact,) = touched
    assert contact["duration"] == pytest.approx(end, rel=1e-9)  # near ratio 1 the formula's b - a loses 3 digits
    assert state.upper_velocity + SPEED == pytest.approx(exit_speed, rel=1e-9)
    assert contact["peak_force"] == pytest.approx(changes["upper.plate.damping"] * SPEED, rel=1e-12)  # at entry


@pytest.mark.parametrize("ratio", [1.0, 10.0])
def test_an_overdamped_plate_that_may_pull_never_lets_go(ratio):
    """As printed: δ falls towards 0 and never reaches it, so the contact goes on and the mass follows the plate."""
    state, touched = hit({"upper.plate.damping": 2.0 * ratio * np.sqrt(STIFFNESS * MASS)}, way=0.049)
    assert len(touched) == 0  # not ended
    assert state.upper_velocity == pytest.approx(-SPEED, abs=1e-9)
    # Over c/k = 2 ms, about 120 steps for the larger c, roundings of 3.5e-18 m a step add up.
    assert state.upper_position >= state.upper_plate_position - 4e-16


@pytest.mark.parametrize("nothing", [0.0, 5e-324, 9.9e-31])
def test_a_plate_without_stiffness_and_damping_is_no_plate(nothing):
    """Bits, events, modes and guards are those of a scene without the contact."""
    state, touched = hit({"upper.plate.stiffness": nothing})
    assert state.upper_position == vibro_ros.Simulator(FREE).state.upper_position and state.upper_velocity == 0.0
    assert len(touched) == 0
    paper = vibro_ros.load_scene("paper")
    soft = paper.with_parameters({"inclined.plate.stiffness": nothing, "inclined.plate.damping": nothing})
    bare = paper.with_parameters({"effects.inclined_contact": "none"})
    with_soft_plates, without_plates = (vibro_ros.simulate(scene, duration=0.3, rate=1000.0) for scene in (soft, bare))
    for name in vars(with_soft_plates):
        if name not in ("events", "statistics"):
            np.testing.assert_array_equal(getattr(with_soft_plates, name), getattr(without_plates, name), err_msg=name)
    np.testing.assert_array_equal(with_soft_plates.events, without_plates.events)
    assert soft.describe() == bare.describe()
    assert "inclined" in paper.with_parameters({"inclined.plate.stiffness": 0.0, "inclined.plate.damping": 1.0}).plates


def test_a_preload_beyond_the_stroke_keeps_a_rigid_contact_closed():
    """The plate stands at 0.03 m, below all of the slider's way from 0.04 m on: the mass never leaves it."""
    scene = vibro_ros.load_scene("rigid").with_parameters({"upper.gap": -0.03, "effects.inclined_mass": False})
    run = vibro_ros.simulate(scene, duration=10.0, rate=1000.0)
    assert not run.upper_velocity.any() and (run.upper_position == 0.03).all()
    assert len(run.events) == 0
    slider = 0.02 * np.cos(100.0 * run.time) + np.sqrt(0.06**2 - (0.02 * np.sin(100.0 * run.time)) ** 2)
    np.testing.assert_allclose(run.upper_plate_force, 1e3 * (slider - 0.03), rtol=0, atol=1e-10)  # phase 1e3, rounded


@pytest.mark.parametrize(("kind", "restitution"), [("restitution", 0.5), ("restitution", 1.0), ("compliant", 1.0)])
@pytest.mark.parametrize("phase", [1.0, 2.0])
def test_a_plate_that_closes_onto_a_moving_mass(phase, kind, restitution):
    """u = s (1 - cos Ωt), s = 0.08 m, moves up; a plate that comes down at 10 m/s is timed to meet it at Ωt = phase."""
    meeting, time, plate = 0.08 * (1.0 - np.cos(phase)), phase / 100.0, 10.0
    device = vibro_ros.Simulator(vibro_ros.load_scene("paper").with_parameters({
        "motor.speed": 0.0, "effects.inclined_mass": False, "start.state": "zero", "effects.upper_contact": kind,
        "upper.plate.restitution": restitution, "upper.plate.stiffness": 1e12, "gap_actuator.speed": plate,
        "upper.gap": 0.06, "effects.normal_force": "weight", "solver.accounts": True}))
    device.advance_to(time - (0.12 - meeting) / plate)  # it waits at 0.12 m until then
    device.command(upper_gap=-0.06)
    device.advance_to(time + 2e-6)
    events = device.take_events()
    contact = events[events["kind"] == "upper_contact"][0]
    approach = 8.0 * np.sin(phase) + plate
    assert contact["time"] == pytest.approx(time, abs=1e-16)
    assert contact["speed"] == pytest.approx(approach, rel=1e-14)
    lasts = 0.0 if kind == "restitution" else np.pi * np.sqrt(MASS / 1e12)
    assert contact["duration"] == pytest.approx(lasts, rel=1e-4)
    # the drive spring changes the speed by 1e3 N/m * 0.08 m / 0.1 kg * 2e-6 s at most
    assert device.state.upper_velocity == pytest.approx(-restitution * approach - plate, abs=2e-3)
    # the plate's work among it; 3e6 N times a penetration rounded to 1e-17 m, and 5 J rounded
    assert_balanced(device, 1e-11, rounding=1e-14)


RIGID = vibro_ros.load_scene("rigid")


def test_a_plate_that_moves_takes_its_mass_along_and_lets_it_go():
    device = vibro_ros.Simulator(RIGID.with_parameters({"motor.speed": 0.0}))
    device.advance_to(0.1)
    device.command(upper_gap=-0.002)
    device.advance_to(0.3)
    assert device.state.upper_velocity == -0.005
    assert device.state.upper_position == pytest.approx(0.06 - 0.2 * 0.005, abs=1e-15)
    device.advance_to(1.0)
    assert device.state.upper_velocity == 0.0
    assert device.state.upper_position == pytest.approx(0.058, abs=1e-15)
    device.command(upper_gap=0.03)
    device.advance_to(8.0)
    assert device.state.upper_plate_force == 0.0
    assert abs(device.state.upper_position - 0.08) < 0.01  # swings about its slider at rest


def test_a_contact_that_its_plate_ends_by_moving_is_reported():
    """By a command and by the end of the plate's way: each rest once, up to the instant of the change of speed."""
    device = vibro_ros.Simulator(RIGID.with_parameters({"motor.speed": 0.0}))
    device.advance_to(0.1)
    device.command(upper_gap=-0.002)  # 0.4 s of motion inwards, the mass before the plate
    device.advance_to(1.0)
    device.command(upper_gap=0.03)
    device.advance_to(1.1)
    events = device.take_events()
    rests = events[(events["kind"] == "upper_contact") & (events["duration"] > 0.01)]
    np.testing.assert_allclose(rests["time"] + rests["duration"], [0.1, 0.5, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(rests["time"], [0.0, 0.1, 0.5], rtol=0, atol=1e-3)  # after the bounces of the new blow
