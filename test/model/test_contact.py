"""One mass against its plate: known answers A7 to A11, through the public interface.

A free mass is hit by a moving plate (no drive spring, motor stopped), so that no other force acts.
"""

import numpy as np
import pytest

import vibro_ros

MASS, STIFFNESS, SPEED = 0.1, 1e7, 1.0
STOPPED = {"motor.speed": 0.0, "effects.inclined_contact": "none"}
FREE_MASS = STOPPED | {"upper.spring.stiffness": 0.0, "upper.gap": 0.03, "gap_actuator.speed": SPEED}


def hit_by_plate(changes, end=0.02):
    """The plate starts 0.01 m above the mass, which rests at 0.08 m, and comes down at SPEED."""
    device = vibro_ros.Simulator(vibro_ros.load_scene("paper").with_parameters(FREE_MASS | changes))
    device.command(upper_gap=0.0)
    device.advance_to(end)
    return device.state, contacts(device.take_events())


def contacts(events, kind="upper_contact"):
    return np.sort(events[events["kind"] == kind], order="time")


def test_free_vibration_against_a_plate_at_the_rest_position():
    """A7. Angular frequency 2ω1ω2/(ω1+ω2) = 198.0199 rad/s; half a period is spent on the plate with ω2."""
    scene = vibro_ros.load_scene("paper").with_parameters(STOPPED | {"start.state": "zero", "upper.gap": 0.02})
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
    scene = vibro_ros.load_scene("paper").with_parameters(STOPPED | {"start.state": "zero"})
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
    state, (contact,) = hit_by_plate({"upper.plate.damping": damping, "effects.adhesion": adhesion})
    expected, phase = restitution(damping_ratio, adhesion)
    assert expected == pytest.approx(printed, abs=5e-5)
    assert -(state.upper_velocity + SPEED) / SPEED == pytest.approx(expected, rel=1e-12)
    assert contact["duration"] == pytest.approx(phase / np.sqrt(STIFFNESS / MASS), abs=1e-14)


@pytest.mark.parametrize("damping_ratio", [0.05, 0.2, 0.5, 0.9])
def test_peak_force_of_a_damped_contact(damping_ratio):
    """The greatest k δ + c δ' of m δ'' + c δ' + k δ = 0 over a fine grid; the force at entry is c v0 already."""
    damping = 2 * damping_ratio * np.sqrt(STIFFNESS * MASS)
    _, (contact,) = hit_by_plate({"upper.plate.damping": damping, "effects.adhesion": False})
    rate, decay = np.sqrt(STIFFNESS / MASS), damping_ratio * np.sqrt(STIFFNESS / MASS)
    damped = rate * np.sqrt(1 - damping_ratio**2)
    times = np.linspace(0.0, np.pi / damped, 200001)
    depth = SPEED / damped * np.exp(-decay * times) * np.sin(damped * times)
    speed = SPEED * np.exp(-decay * times) * (np.cos(damped * times) - decay / damped * np.sin(damped * times))
    assert contact["peak_force"] == pytest.approx((STIFFNESS * depth + damping * speed).max(), rel=1e-9)
