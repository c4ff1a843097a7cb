"""Commands of the stateful device: ramps of the motor, gaps that move, floods at one instant."""

import numpy as np
import pytest
from commanded_device import RAMP, SWINGING, device, of_kind


def test_an_empty_command_changes_nothing_but_rounding():
    made, untouched = device(scene="damped"), device(scene="damped")
    made.advance_to(0.013)
    made.command()
    for each in (made, untouched):
        each.advance_to(0.1)
    np.testing.assert_allclose(made.state.upper_position, untouched.state.upper_position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(made.state.body_position, untouched.state.body_position, rtol=0, atol=1e-13)


@pytest.mark.parametrize("acceleration", [200.0, 1.0, 1e5])
def test_the_ramp_motor_keeps_to_its_acceleration(acceleration):
    """ω = a t and θ = a t²/2 up to the target, which is reached exactly at v/a; the event has this instant."""
    made = device(RAMP | SWINGING | {"motor.acceleration": acceleration})
    end = 30.0 / acceleration
    made.command(motor_speed=30.0)
    for share in (0.0, 0.1, 0.5, 0.999):
        made.advance_to(share * end)
        assert made.state.motor_speed == pytest.approx(acceleration * share * end, rel=1e-13)
        assert made.state.crank_angle == pytest.approx(acceleration * (share * end) ** 2 / 2, rel=1e-14)
        assert len(of_kind(made.take_events(), "motor_ramp_end")) == 0
    made.advance_to(end + 1.0)
    assert made.state.motor_speed == 30.0
    assert made.state.crank_angle == pytest.approx(30.0 * (end / 2 + 1.0), rel=1e-14)
    (event,) = of_kind(made.take_events(), "motor_ramp_end")
    assert event["time"] == pytest.approx(end, rel=1e-14)


def test_asking_for_the_present_speed_or_gap_is_no_ramp():
    made = device(RAMP | SWINGING)
    made.command(motor_speed=0.0, upper_gap=0.0)
    made.advance_to(0.1)
    assert len(of_kind(made.take_events(), "motor_ramp_end", "gap_reached")) == 0


def test_the_gap_moves_at_its_speed():
    made = device({"gap_actuator.speed": 0.005} | RAMP)
    made.command(upper_gap=0.001, inclined_gap=-0.0005)
    for time in (0.0, 0.05, 0.0999):
        made.advance_to(time)
        assert made.state.upper_plate_position == pytest.approx(0.06 + 0.005 * time, abs=1e-15)
        assert made.state.inclined_plate_position == pytest.approx(0.06 - 0.005 * time, abs=1e-15)
        assert (made.state.upper_plate_velocity, made.state.inclined_plate_velocity) == (0.005, -0.005)
    made.advance_to(0.3)
    assert (made.state.upper_plate_position, made.state.inclined_plate_position) == (0.06 + 0.001, 0.06 - 0.0005)
    assert made.state.upper_plate_velocity == 0.0
    reached = of_kind(made.take_events(), "gap_reached")
    np.testing.assert_allclose(reached["time"], [0.1, 0.2], rtol=1e-12)


@pytest.mark.parametrize("scene", ["paper", "unilateral", "damped"])
def test_a_flood_of_commands_at_one_instant(scene):
    """The last of 1000 commands counts. Each jump of the speed causes a jump of the dampers' force, and none is taken
    for a lack of progress.
    """
    made = device({"upper.spring.damping": 50.0, "inclined.spring.damping": 50.0}, scene)
    made.advance_to(0.0155)
    for index in range(1000):
        made.command(motor_speed=500.0 * (index % 2), upper_gap=0.001 * (index % 3))
    made.command(motor_speed=90.0, upper_gap=0.0)
    made.advance_to(0.1)
    assert made.state.motor_speed == 90.0
