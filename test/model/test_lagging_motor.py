"""The motor `lag`: its speed approaches the command exponentially, and the sliders follow the crank exactly."""


import numpy as np
import pytest

import vibro_ros

LAG = {"effects.motor": "lag", "motor.time_constant": 0.07}
FREE = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.friction": "none"}


def approach(time, start, target, lag):
    """Speed and angle of a speed that approaches its target with a time constant."""
    speed = target + (start - target) * np.exp(-time / lag)
    return speed, target * time - (start - target) * lag * np.expm1(-time / lag)


@pytest.mark.parametrize(("start", "target"), [(0.0, 100.0), (100.0, 0.0), (30.0, 500.0), (100.0, 99.0), (500.0, 0.5),
                                               (100.0, -60.0), (-30.0, 500.0), (-100.0, 0.0), (0.0, -100.0),
                                               (0.5, -500.0)])
@pytest.mark.parametrize("lag", [1e-4, 0.07, 2.0])
def test_speed_and_angle_follow_the_exponential(start, target, lag):
    """A6. To 1e-12 of the angle: roundings of some hundred segments."""
    scene = vibro_ros.load_scene("no_impact").with_parameters({**LAG, "motor.speed": start, "motor.time_constant": lag})
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=target)
    samples = device._motion.sampled(np.linspace(0.0, 3.0, 301))
    speed, angle = approach(samples["time"], start, target, lag)
    np.testing.assert_allclose(samples["motor_speed"], speed, rtol=5e-14, atol=1e-12)  # a rounding a segment
    np.testing.assert_allclose(samples["crank_angle"], angle, rtol=1e-12, atol=1e-12)


def test_the_end_of_the_lag_is_an_event_and_leaves_the_commanded_speed():
    device = vibro_ros.Simulator(vibro_ros.load_scene("damped").with_parameters(LAG))
    device.command(motor_speed=37.0)
    device.advance_to(10.0)
    events = device.take_events()
    ends = events[events["kind"] == "motor_ramp_end"]
    assert len(ends) == 1 and ends["time"][0] == pytest.approx(40 * 0.07, abs=1e-12)
    assert device.state.motor_speed == 37.0
