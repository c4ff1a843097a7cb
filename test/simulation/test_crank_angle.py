"""Angles of a dc motor's crank: passed by the device that runs on, and a controller that continues with an integral."""

import math

import numpy as np
import pytest

import vibro_ros
from vibro_ros.simulation.crank_angle import first_reached

#: As the page on the motor has it: without plates and flywheel, on a winding of 3 ohm.
SOMMERFELD = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "mass.upper_slider": 0.0,
              "mass.inclined_slider": 0.0, "motor.control": "voltage", "motor.winding_resistance": 3.0,
              "motor.supply_voltage": 60.0, "motor.crank_inertia": 3.5e-5}


def machine(**changes):
    return vibro_ros.load_scene("machine").with_parameters({"motor.speed": 100.0} | changes)


def test_the_angle_is_reached_at_the_instant_of_an_uninterrupted_run():
    """The device's bits do not change, and the angle is met to rounding, whatever the crank does before."""
    of = machine(**SOMMERFELD, **{"motor.voltage": 40.0, "motor.speed": 0.0})
    device, other = vibro_ros.Simulator(of), vibro_ros.Simulator(of)
    for turn in (0, 1, 2, 30):
        assert device.advance_to_angle(turn, 2.0)
        assert device.state.crank_angle == pytest.approx(2.0 * math.pi * turn + 2.0, abs=1e-13 * (1 + turn))
        other.advance_to(device.time)
        assert other.state == device.state
    assert device.take_events().tolist() == other.take_events().tolist()
    assert device.statistics == other.statistics
    time = device.time
    assert device.advance_to_angle(3, 1.0) and device.time == time  # gone by already


def test_an_unreached_angle_returns_false_and_impossible_ones_are_refused():
    """2 V turn a crank without load, but not against the pressed masses."""
    device = vibro_ros.Simulator(machine(**{"motor.control": "voltage", "motor.voltage": 2.0, "motor.speed": 0.0}))
    assert not device.advance_to_angle(1, 0.0, latest=1.0) and device.time == 1.0
    with pytest.raises(ValueError, match="latest: 0.5 s is out of range; give a time from 1 to"):
        device.advance_to_angle(1, 0.0, latest=0.5)
    with pytest.raises(ValueError, match="ideal, exact have no angle to advance to; choose dc and exact"):
        vibro_ros.Simulator(vibro_ros.load_scene("paper")).advance_to_angle(1, 0.0)


@pytest.mark.parametrize(("value", "expected"), [(0.1, 0.10050506338833465), (-2.0, -1.0), (5.0, None)])
def test_the_first_of_several_roots_is_found(value, expected):
    """x - x³ from -0.577 on rises to 0.385 at 0.577 and falls again, so it passes a value more than once."""
    place = first_reached(np.array([0.0, 1.0, 0.0, -1.0]), value, -0.55 if value > 0.0 else -1.0, 1.0)
    assert place == (expected if expected is None else pytest.approx(expected, abs=1e-2))
    if expected and value > 0.0:
        assert place - place**3 == pytest.approx(value, abs=1e-15) and place < 0.5


def test_a_controller_continues_with_a_given_integral():
    """i = I + k_p e is held from the sample at this instant on, which is taken again."""
    device = vibro_ros.Simulator(machine())
    device.advance_to(0.05)
    device.set_state(motor_speed=95.0, controller_integral=1.5)
    assert device.state.motor_current == pytest.approx(1.5 + 0.05 * 5.0, abs=1e-14)
    assert device.controller_integral == pytest.approx(1.5 + 0.5 * 5.0 / 1000.0, abs=1e-14)
    wound = vibro_ros.Simulator(machine(**{"motor.control": "voltage", "motor.voltage": 12.0,
                                           "motor.winding_inductance": 0.05}))
    wound.set_state(motor_current=0.75)
    assert wound.state.motor_current == 0.75
    checkpoint = device.checkpoint().tolist()
    with pytest.raises(ValueError, match="motor_current: 1.0 is no part of this motor's state; .*winding_inductance"):
        device.set_state(motor_current=1.0)
    with pytest.raises(ValueError, match="controller_integral: 1.0 is no part of this motor's state; .*motor.control"):
        wound.set_state(controller_integral=1.0)
    with pytest.raises(ValueError, match="controller_integral: nan is not finite"):
        device.set_state(controller_integral=math.nan)
    assert device.checkpoint().tolist() == checkpoint
