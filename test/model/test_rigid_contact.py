"""Rigid plates: Newton's restitution, rest on the plate, and the limit of stiff ones."""

import math

import numpy as np
import pytest

import vibro_ros

RIGID = vibro_ros.load_scene("rigid")
REACTION = {"effects.reaction": True, "effects.mass_weight": True}


@pytest.mark.parametrize("changes", [{}, REACTION], ids=["alone", "with reaction"])
def test_momentum_is_constant_through_every_blow(changes):
    """A29. For blows without duration: M x' - m3 w' sin(phi) to 1e-12 without friction."""
    scene = RIGID.with_parameters({"effects.friction": "none", **changes})
    run = vibro_ros.simulate(scene, duration=2.0, rate=1000.0)
    momentum = scene.total_mass * run.body_velocity - scene["mass.inclined"] * run.inclined_velocity * math.sin(
        scene["guide.angle"])
    np.testing.assert_allclose(momentum, 0.0, rtol=0, atol=1e-12)


def test_rigid_without_loss_is_the_limit_of_stiff_plates():
    """A24. A contact lasts pi sqrt(m/k) and the mass goes on by its depth v sqrt(m/k): first order in 1/sqrt(k)."""
    base = {"upper.gap": 0.01, "inclined.gap": 0.01, "upper.plate.restitution": 1.0, "inclined.plate.restitution": 1.0}
    times = np.linspace(0.0, 0.12, 61)
    rigid = vibro_ros.simulate(RIGID.with_parameters(base), times=times)
    assert np.count_nonzero(np.char.endswith(rigid.events["kind"], "contact")) >= 2
    errors = []
    for stiffness in (1e8, 1e10):
        soft = vibro_ros.simulate(vibro_ros.load_scene("unilateral").with_parameters({
            **base, "upper.plate.stiffness": stiffness, "inclined.plate.stiffness": stiffness}), times=times)
        apart = rigid.upper_position - rigid.upper_plate_position < -1e-3
        errors.append(np.abs(soft.upper_position - rigid.upper_position)[apart].max())
    assert math.log10(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.05)


def test_a_pressed_mass_rests_and_leaves_when_it_is_pulled():
    """At rest on its plate while the spring presses, with its force; released where that vanishes."""
    scene = RIGID.with_parameters({"motor.speed": 5.0, "inclined.gap": 0.05})
    run = vibro_ros.simulate(scene, duration=0.5, rate=2000.0)
    first = run.events[run.events["kind"] == "upper_contact"][0]
    resting = run.time < first["duration"]
    assert first["time"] == 0.0 and 0.1 < first["duration"] < 0.4
    assert not run.upper_velocity[resting].any()
    np.testing.assert_allclose(run.upper_plate_force[resting], run.upper_drive_force[resting], rtol=0, atol=1e-12)
    assert first["peak_force"] == pytest.approx(20.0, rel=1e-12)  # k (s_B(0) - E)
    slider = 0.02 * math.cos(5 * first["duration"]) + math.sqrt(0.06**2 - (0.02 * math.sin(5 * first["duration"]))**2)
    assert slider == pytest.approx(0.06, abs=1e-12)


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


@pytest.mark.parametrize(("changes", "reason"), [
    ({"effects.normal_force": "printed"}, "effects.normal_force: 'printed' makes friction drive the body infinitely"),
    ({"guide.angle": 2.0}, "guide.angle: 2 rad points the inclined guide down"),
    ({"upper.plate.restitution": 1.5}, "upper.plate.restitution: 1.5 is out of range; give a number from 0 to 1")])
def test_rigid_plates_that_contradict_other_parameters_are_refused(changes, reason):
    with pytest.raises(ValueError, match=reason.split(";")[0]):
        RIGID.with_parameters(changes)
