"""Motors with a given speed: the exponential of `lag`, and mirrored and reversed motions of a crank that turns back
and through 0.
"""

import numpy as np
import pytest

import vibro_ros

MOTORS = ("ideal", "ramp", "lag")
LAG = {"effects.motor": "lag", "motor.time_constant": 0.07}
FREE = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.friction": "none",
        "upper.spring.damping": 0.0, "inclined.spring.damping": 0.0}
# At rest, backwards, forwards through 0, and backwards again.
COURSE = ((0.1, -80.0), (0.3, 70.0), (0.7, -40.0))


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


def sampled_run(scene, times, course, sign=1.0):
    """A device's samples at `times` under the commands of `course`, or of its mirror image."""
    return vibro_ros.simulate(scene, times=times, commands=[(at, {"motor_speed": sign * to}) for at, to in course])


@pytest.mark.parametrize("motor", MOTORS)
@pytest.mark.parametrize("name", ["device", "rigid", "damped"])
@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_a_mirrored_crank_drives_a_mass_alike(name, motor, side):
    """A slider's position is even in the angle from its guide, so the mass on it, its plate and the body move in the
    same way whichever way the crank turns. To some hundred roundings of 0.06 m.
    """
    other, tilt = {"upper": "inclined", "inclined": "upper"}[side], 0.0 if side == "upper" else 1.3
    scene = vibro_ros.load_scene(name).with_parameters({
        f"effects.{other}_mass": False, "effects.motor": motor, "guide.angle": 1.3, "motor.speed": 0.0,
        "start.state": "given", "start.crank_angle": tilt, f"start.{side}_position": 0.05})
    run, mirrored = (sampled_run(scene, np.linspace(0.0, 1.2, 1001), COURSE, sign) for sign in (1.0, -1.0))
    for field in (f"{side}_position", "body_position"):
        np.testing.assert_allclose(getattr(mirrored, field), getattr(run, field), rtol=0, atol=1e-13)
    np.testing.assert_allclose(mirrored.crank_angle - tilt, tilt - run.crank_angle, rtol=0, atol=1e-13)
    np.testing.assert_allclose(mirrored.motor_speed, -run.motor_speed, rtol=0, atol=1e-12)
    assert len(mirrored.events) == len(run.events) > 50
    assert run.crank_angle.min() < tilt - 5.0 and run.motor_speed.max() > 30.0


@pytest.mark.parametrize("reaction", [False, True])
def test_a_motion_without_losses_goes_back_the_way_it_came(reaction):
    """If all speeds and the ramp through 0 are reversed, both masses and the body return to their start. To roundings
    of 0.06 m over some hundred segments.
    """
    scene = vibro_ros.load_scene("damped").with_parameters({
        **FREE, "effects.reaction": reaction, "effects.motor": "ramp", "motor.speed": 60.0, "start.state": "given",
        "start.upper_position": 0.07, "start.upper_velocity": 0.3, "start.inclined_position": 0.05,
        "start.crank_angle": 1.0})
    device = vibro_ros.Simulator(scene)
    start = device.state
    device.command(motor_speed=-40.0)
    device.advance_to(0.5)  # of 200 rad/s²: 0 after 0.3 s
    turned = device.state
    assert turned.motor_speed == pytest.approx(-40.0, abs=1e-12)
    device.set_state(motor_speed=40.0, **{f"{side}_velocity": -getattr(turned, f"{side}_velocity")
                                          for side in ("upper", "inclined", "body")})
    device.command(motor_speed=-60.0)
    device.advance_to(1.0)
    for name in ("upper_position", "inclined_position", "body_position", "crank_angle"):
        assert getattr(device.state, name) == pytest.approx(getattr(start, name), abs=1e-12), name
    for name in ("upper_velocity", "inclined_velocity", "body_velocity"):
        assert getattr(device.state, name) == pytest.approx(-getattr(start, name), abs=1e-10), name


@pytest.mark.parametrize("motor", MOTORS)
@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("rk4_located", 4)])
def test_steps_of_fixed_length_pass_0_with_their_order(motor, method, order):
    """No step ends where the speed is 0 or where a ramp ends, so both lie within a step."""
    scene = vibro_ros.load_scene("no_impact").with_parameters({
        "effects.motor": motor, "motor.acceleration": 3000.0, "motor.time_constant": 0.03, "motor.speed": -30.0})
    times = np.array([0.0512, 0.4096])
    exact = sampled_run(scene, times, ((0.0512, 90.0), (0.1024, -40.0)))
    off = []
    for step in (1.6e-3, 0.8e-3, 0.4e-3):
        run = sampled_run(scene.with_parameters({"solver.method": method, "solver.step": step}), times,
                  ((0.0512, 90.0), (0.1024, -40.0)))
        assert run.crank_angle[-1] == pytest.approx(exact.crank_angle[-1], abs=1e-12)
        off.append(abs(run.upper_position[-1] - exact.upper_position[-1]))
    assert off[-1] < 1e-4 and off[-2] / off[-1] > 0.75 * 2.0**order
