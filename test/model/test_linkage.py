"""Masses of sliders and crank pin: known answers A57 to A59, and the torque that the crank takes."""

import math

import numpy as np
import pytest

import vibro_ros

GRAVITY, RATE, TURN = 9.81, 100.0, 2.0 * math.pi / 100.0
LINKAGE = {"mass.upper_slider": 0.02, "mass.inclined_slider": 0.03, "mass.crank_pin": 0.01}
#: A block on which nothing but a crank pin turns, which shakes it by M x'' = P sin ωt with P/(M ω) = 1 m/s.
SHAKEN = {"effects.upper_mass": False, "effects.inclined_mass": False, "effects.normal_force": "weight",
          "start.state": "given", "mass.crank_pin": 1.0, "mass.body": 1.0}


def paper(changes):
    return vibro_ros.load_scene("paper").with_parameters(changes)


def drift(frictions):
    """Mean speed [m/s] of the shaken block over 200 turns, once it is steady."""
    forward, backward = (rate / GRAVITY for rate in frictions)
    scene = paper(SHAKEN | {"ground.friction": forward, "ground.friction_backward": backward})
    run = vibro_ros.simulate(scene, times=[0.0, 200 * TURN, 400 * TURN])
    return (run.body_position[2] - run.body_position[1]) / (200 * TURN)


def test_a_shaken_block_drifts_where_friction_differs():
    """A57. Δ = 2π g_b/(g_f + g_b), sin τ = g_f Δ/(2aω sin(Δ/2)) with cos τ < 0, and
    V = [a(Δ cos(τ − Δ/2) + (2π − Δ) cos(τ + Δ/2)) − g_f Δ(Δ − π)/ω]/2π: 0.79031190177 m/s for 5 and 20 m/s²."""
    forward, backward = 5.0, 20.0
    part = 2.0 * math.pi * backward / (forward + backward)
    phase = math.pi - math.asin(forward * part / (2.0 * RATE * math.sin(part / 2.0)))
    speed = (part * math.cos(phase - part / 2.0) + (2.0 * math.pi - part) * math.cos(phase + part / 2.0)
             - forward * part * (part - math.pi) / RATE) / (2.0 * math.pi)
    assert speed == pytest.approx(0.79031190177, abs=1e-11)
    assert drift((forward, backward)) == pytest.approx(speed, abs=1e-12)


@pytest.mark.parametrize("forward", [0.0, 10.0])
def test_a_shaken_block_on_one_way_wheels(forward):
    """A57. V = a without friction; with it, from sin τ1 = g_f/aω until cos τ1 − cos τ2 = sin τ1 (τ2 − τ1),
    V = a[Δ cos τ1 − (sin τ2 − sin τ1) − sin τ1 Δ²/2]/2π, Δ = τ2 − τ1."""
    first, last = math.asin(forward / RATE), 2.0 * math.pi
    if forward:
        low, high = first + 1.0, 2.0 * math.pi
        for _ in range(60):
            last = 0.5 * (low + high)
            ahead = math.cos(first) - math.cos(last) - math.sin(first) * (last - first)
            low, high = (last, high) if ahead > 0.0 else (low, last)
    part = last - first
    speed = part * math.cos(first) - math.sin(last) + math.sin(first) - math.sin(first) * part**2 / 2.0
    speed /= 2.0 * math.pi
    assert drift((forward, 1e6 * GRAVITY)) == pytest.approx(speed, abs=1e-12)


def test_momentum_through_every_impact():
    """A58. Without friction M x' − m3 w' sin φ + Σ m e_x s' is constant, of sliders and crank pin."""
    scene = paper(LINKAGE | {"effects.friction": "none", "effects.motor": "lag", "motor.speed": 60.0})
    device, momenta = vibro_ros.Simulator(scene), []
    device.command(motor_speed=120.0)
    angle = scene["guide.angle"]
    for time in np.linspace(0.0, 0.5, 300):
        device.advance_to(time)
        now = device.state
        slope = slope_of_slider(scene, now.crank_angle, "inclined")
        pin = -scene["crank.radius"] * math.cos(now.crank_angle) * now.motor_speed
        momenta.append(scene.total_mass * now.body_velocity - 0.08 * now.inclined_velocity * math.sin(angle)
                     - 0.03 * slope * now.motor_speed * math.sin(angle) + 0.01 * pin)
    assert np.ptp(momenta) < 1e-12
    assert np.count_nonzero(device.take_events()["kind"] == "inclined_contact") > 5


def slope_of_slider(scene, crank_angle, side):
    """ds/dθ [m/rad] of a slider, by the derivative of eqs. (2) and (3)."""
    angle = crank_angle - scene.guide_angle(side)
    radius, rod, sine = scene["crank.radius"], scene[f"crank.{side}_rod"], math.sin(angle)
    return -radius * sine * (1.0 + radius * math.cos(angle) / math.sqrt(rod**2 - (radius * sine) ** 2))


def test_power_is_torque_times_speed_also_where_the_crank_stands():
    scene = vibro_ros.load_scene("device").with_parameters(LINKAGE | {"motor.speed": 50.0})
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=0.0)
    turning = device.state
    assert turning.motor_power == pytest.approx(turning.motor_torque * 50.0, rel=1e-12)
    device.advance_to(2.0)
    hanging = device.state
    assert hanging.motor_speed == 0.0 and hanging.motor_torque != 0.0


def test_the_torque_of_a_crank_that_stands_is_the_limit_of_that_of_one_that_creeps():
    """Power over speed equals the drive forces times the sliders' slopes, at every angle."""
    device = vibro_ros.Simulator(vibro_ros.load_scene("device").with_parameters({"effects.motor": "ideal"}))
    for stop in (0.21, 0.37, 0.52):
        device.command(motor_speed=30.0)
        device.advance_to(stop)
        device.command(motor_speed=0.0)
        device.advance_to(stop + 0.01)
        state, scene = device.state, device.scene
        forces = {"upper": state.upper_drive_force, "inclined": state.inclined_drive_force}
        assert state.motor_speed == 0.0
        assert state.motor_torque == pytest.approx(sum(
            force * slope_of_slider(scene, state.crank_angle, side) for side, force in forces.items()), rel=1e-12)


def test_steps_of_fixed_length_converge_to_the_exact_motion():
    """The accelerations of the signals, by values in place of series, on a ramp."""
    scene = paper(LINKAGE | {"effects.upper_contact": "none", "effects.inclined_contact": "none", "motor.speed": 30.0,
                             "effects.friction": "none", "effects.motor": "ramp", "effects.reaction": True})
    errors = []
    for step in (4e-4, 2e-4):
        runs = []
        for method in ("exact", "rk4"):
            device = vibro_ros.Simulator(scene.with_parameters({"solver.method": method, "solver.step": step}))
            device.command(motor_speed=60.0)
            device.advance_to(0.1)
            runs.append(device.state.body_position)
        errors.append(abs(runs[1] - runs[0]))
    assert 12.0 < errors[0] / errors[1] < 20.0


def test_a_motor_that_jumps_is_refused():
    device = vibro_ros.Simulator(paper(LINKAGE))
    with pytest.raises(ValueError, match="motor_speed: 120 rad/s would be reached at once.*choose ramp or lag"):
        device.command(motor_speed=120.0)
    assert device.commanded_motor_speed == 100.0
    device.command(motor_speed=100.0, upper_gap=0.001)
    for side in ("upper", "inclined"):  # nothing would move the slider of a guide that is left out
        assert paper({f"effects.{side}_mass": False, "mass.crank_pin": 0.5}).linkage == ("crank_pin",)
