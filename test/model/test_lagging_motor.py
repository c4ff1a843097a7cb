"""The motor `lag`: its speed approaches the command exponentially, and the sliders follow the crank exactly."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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


def test_the_masses_feel_the_sliders_of_that_angle():
    """Against DOP853 on the smooth scene, whose own error is about 1e-11 m."""
    scene = vibro_ros.load_scene("damped").with_parameters({**LAG, **FREE, "motor.speed": 20.0})
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=160.0)
    samples = device._motion.sampled(np.linspace(0.0, 0.5, 101))

    def slider(angle, tilt):
        sine, cosine = math.sin(angle - tilt), math.cos(angle - tilt)
        root = math.sqrt(0.06**2 - (0.02 * sine) ** 2)
        return 0.02 * cosine + root, -0.02 * sine * (1.0 + 0.02 * cosine / root)

    def right(time, state):
        speed, angle = approach(time, 20.0, 160.0, 0.07)
        b, db = slider(angle, 0.0)
        c, dc = slider(angle, scene["guide.angle"])
        u, du, w, dw = state
        return [du, -(1e3 * (u - b) + 2.0 * (du - db * speed)) / 0.1,
                dw, -(1e3 * (w - c) + 2.0 * (dw - dc * speed)) / 0.08]

    start = [slider(0.0, 0.0)[0], 0.0, slider(0.0, scene["guide.angle"])[0], 0.0]
    known = solve_ivp(right, (0.0, 0.5), start, "DOP853", t_eval=samples["time"], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(samples["upper_position"], known.y[0], rtol=0, atol=2e-11)
    np.testing.assert_allclose(samples["inclined_position"], known.y[2], rtol=0, atol=2e-11)


def test_the_end_of_the_lag_is_an_event_and_leaves_the_commanded_speed():
    device = vibro_ros.Simulator(vibro_ros.load_scene("damped").with_parameters(LAG))
    device.command(motor_speed=37.0)
    device.advance_to(10.0)
    events = device.take_events()
    ends = events[events["kind"] == "motor_ramp_end"]
    assert len(ends) == 1 and ends["time"][0] == pytest.approx(40 * 0.07, abs=1e-12)
    assert device.state.motor_speed == 37.0


def test_a_lagging_motor_takes_a_few_segments_a_cell():
    """A part of a cell has its own series, which is cut and not economized: it reaches a third as far as a cell."""
    ideal = vibro_ros.load_scene("no_impact").with_parameters({"motor.speed": 70.0})
    steps = {}
    for motor in ("ideal", "lag"):
        device = vibro_ros.Simulator(ideal.with_parameters({"effects.motor": motor}))
        device.command(motor_speed=100.0)
        device.advance_to(4.0)
        steps[motor] = device.statistics["steps"]
    assert steps["lag"] < 3.5 * steps["ideal"]
