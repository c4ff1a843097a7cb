"""The dc motor: known answers A64 to A69, by the public interface."""

import math

import numpy as np
import pytest
from commanded_device import changed, refused

import vibro_ros

DC = {"effects.motor": "dc", "motor.acceleration": 0.0, "solver.accounts": True}
BY_VOLTAGE = {"motor.control": "speed_by_voltage", "motor.proportional_gain": 0.3, "motor.integral_gain": 10.0,
              "motor.feed_forward": 0.147}
BY_CURRENT = {"motor.control": "speed_by_current", "motor.proportional_gain": 0.1, "motor.integral_gain": 3.0}
CONSTANT = {"motor.control": "voltage", "motor.voltage": 12.0}
LINKAGE = {"mass.upper_slider": 0.01, "mass.inclined_slider": 0.02, "mass.crank_pin": 0.05}
WINDING = {"motor.winding_inductance": 2.81e-4}
ALONE = {"effects.upper_mass": False, "effects.inclined_mass": False}
WITHOUT_PLATES = {"effects.upper_contact": "none", "effects.inclined_contact": "none",
                  "effects.normal_force": "weight"}


def dc(name, *changes):
    return changed(name, DC, *changes)


def motor_numbers(scene):
    """K, J, R, L, b and T_c."""
    ratio = scene["motor.gear_ratio"]
    return (ratio * scene["motor.torque_constant"], ratio**2 * scene["motor.rotor_inertia"]
            + scene["motor.crank_inertia"], scene["motor.winding_resistance"], scene["motor.winding_inductance"],
            scene["motor.damping"], scene["motor.friction"])


def test_a_motor_without_load_and_a_motor_that_is_stalled():
    """A64. θ' = (K V/R - T_c)/(b + K²/R), and i = V/R while the bearing is seized."""
    scene = dc("paper", ALONE, CONSTANT, {"motor.speed": 0.0})
    constant, _, resistance, _, b, friction = motor_numbers(scene)
    run = vibro_ros.simulate(scene, times=[0.0, 2.0])
    assert run.motor_speed[1] == pytest.approx(
        (constant * 12.0 / resistance - friction) / (b + constant**2 / resistance), rel=1e-14)
    device = vibro_ros.Simulator(scene.with_parameters(WINDING))
    device.fail("motor_stall", duration=1.0)
    device.advance_to(0.5)
    assert device.state.motor_speed == 0.0
    assert device.state.motor_current == pytest.approx(12.0 / resistance, rel=1e-14)
    assert device.state.electrical_power == pytest.approx(144.0 / resistance, rel=1e-14)
    assert device.state.crank_speed == device.state.motor_speed


def test_a_mass_far_from_its_rigid_plate_does_not_rest_on_it_at_the_start():
    """The scenes with other motors start like this; the mass accelerates at k s / m, and no contact is reported."""
    scene = dc("rigid", CONSTANT, {"start.state": "zero", "motor.speed": 60.0, "upper.spring.damping": 0.0})
    run = vibro_ros.simulate(scene, times=[0.0, 1e-6])
    stretch = scene["crank.radius"] + scene["crank.upper_rod"]
    assert run.upper_plate_force[0] == 0.0
    assert run.upper_velocity[1] == pytest.approx(
        1e-6 * scene["upper.spring.stiffness"] * stretch / scene["mass.upper"], rel=1e-6)
    assert "upper_contact" not in run.events["kind"]


def test_a_stalled_motor_draws_what_a_sagging_supply_has():
    """The current is V/R, V_sag/R during the sag, and V/R again, also in the current sensor; a voltage above the
    supply's is refused.
    """
    scene = dc("paper", ALONE, CONSTANT, {"motor.speed": 0.0, "sensors.current.rate": 1000.0})
    device, resistance = vibro_ros.SensedSimulator(scene), scene["motor.winding_resistance"]
    device.fail("motor_stall", duration=10.0)
    for voltage, meter in ((12.0, 12.0 / 36.0), (5.0, 1.0), (12.0, 12.0 / 36.0)):
        device.advance_to(device.time + 0.0995)
        device.take_measurements()
        if voltage == 5.0:
            device.fail("supply_sag", duration=0.1, value=5.0)
        device.advance_to(device.time + 0.0125)
        assert device.state.motor_voltage == voltage
        assert device.state.motor_current == pytest.approx(voltage / resistance, rel=1e-14)
        for measurement in device.take_measurements():
            assert measurement.values == pytest.approx([meter * voltage / resistance, device.supply_voltage], rel=1e-14)
    with refused(device, "value: 40 V is above motor.supply_voltage, .*give at most 36 V"):
        device.fail("supply_sag", duration=1.0, value=40.0)


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["forwards", "backwards"])
def test_no_supply_gives_more_than_it_has_to_a_crank_that_turns_too_fast(sign):
    """If |Kθ'| > V_s + R I_max, current limit and supply limit contradict each other: V = ±V_s, in both directions."""
    scene = vibro_ros.load_scene("machine").with_parameters({
        "motor.control": "speed_by_voltage", "motor.supply_voltage": 12.0, "motor.current_limit": 1.0,
        "motor.speed": sign * 100.0})
    constant, _, resistance, *_ = motor_numbers(scene)
    device = vibro_ros.Simulator(scene)
    assert device.state.motor_voltage == sign * 12.0
    assert (device.state.motor_voltage - constant * sign * 100.0) / resistance * sign < -1.0  # more than the limit
    device.advance_to(0.0203)
    device.fail("supply_sag", duration=0.1, value=2.0)
    assert device.state.motor_voltage == sign * 2.0
    voltages = device.sample(np.linspace(0.0203, 0.12, 300)).motor_voltage
    assert np.abs(voltages).max() == 2.0


def test_a_held_voltage_changes_at_samples_alone():
    """Neither a command, not even another speed, nor a parameter changes it before the next sample."""
    device = vibro_ros.Simulator(dc("damped", BY_VOLTAGE, WINDING, {
        "motor.supply_voltage": 12.0, "motor.current_limit": 1.0, "motor.speed": -100.0, "motor.control_rate": 100.0}))
    device.fail("supply_sag", duration=1.0, value=2.0)
    device.advance_to(0.0213)
    held = device.state.motor_voltage
    assert abs(held) <= 2.0
    for change in (lambda: device.command(motor_speed=-100.0), lambda: device.command(motor_speed=60.0),
                   lambda: device.set_parameters({"motor.current_limit": 1.0}),
                   lambda: device.set_parameters({"motor.current_limit": 30.0})):
        change()
        assert device.state.motor_voltage == held
        device.advance_to(device.time + 1e-3)
        assert device.state.motor_voltage == held
    device.advance_to(0.0301)
    assert device.state.motor_voltage == 2.0


@pytest.mark.parametrize("inductance", [0.0, 2.81e-4, 5e-3])
def test_a_run_up_is_a_sum_of_exponentials(inductance):
    """A64. J/(b + K²/R) is the time constant without inductance; with it there are the two roots of
    L J p² + (R J + L b) p + R b + K² = 0, real for a small L, complex for a large one."""
    scene = dc("paper", ALONE, CONSTANT, {"motor.speed": 0.0, "motor.winding_inductance": inductance,
                                          "motor.friction": 0.0, "motor.static_friction": 0.0})
    constant, inertia, resistance, _, b, _ = motor_numbers(scene)
    times, damping = np.linspace(0.0, 0.05, 60), resistance * b + constant**2
    last = constant * 12.0 / damping
    if inductance:
        first, second = np.roots([inductance * inertia, resistance * inertia + inductance * b, damping]).astype(complex)
        speed = last * (1.0 - (second * np.exp(first * times) - first * np.exp(second * times)) / (second - first)).real
    else:
        speed = last * -np.expm1(-times * damping / (resistance * inertia))
    run = vibro_ros.simulate(scene, times=times)
    np.testing.assert_allclose(run.motor_speed, speed, rtol=0.0, atol=1e-12)


def test_a_heavy_flywheel_is_the_ideal_motor():
    """A67. The deviation from the motion at a constant speed is proportional to 1/J."""
    free = {"motor.friction": 0.0, "motor.static_friction": 0.0, "motor.damping": 0.0} | BY_CURRENT
    free |= {"motor.proportional_gain": 0.0, "motor.integral_gain": 0.0}
    ideal = vibro_ros.simulate(vibro_ros.load_scene("damped").with_parameters(WITHOUT_PLATES), times=[0.0, 0.2])
    errors = [vibro_ros.simulate(dc("damped", WITHOUT_PLATES, free, {"motor.crank_inertia": inertia}), times=[0.0, 0.2])
              .upper_position[1] - ideal.upper_position[1] for inertia in (400.0, 800.0)]
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=1e-4)


def test_a_small_inductance_is_none():
    """A67. The deviation from L = 0 is proportional to L."""
    motions = [vibro_ros.simulate(dc("damped", WITHOUT_PLATES, CONSTANT, {"motor.winding_inductance": inductance}),
                                  times=[0.0, 0.1]).crank_angle[1] for inductance in (0.0, 1e-6, 2e-6)]
    assert (motions[2] - motions[0]) / (motions[1] - motions[0]) == pytest.approx(2.0, rel=1e-2)


def test_a_small_ripple_is_linear():
    """A68. ω_n = -τ_n / (jΩ_n J + b + K²/(R + jΩ_n L)), with τ_n the torque's harmonics of the ideal motor."""
    scene = dc("damped", WITHOUT_PLATES, CONSTANT, WINDING, {"motor.crank_inertia": 1e-1, "motor.friction": 0.0,
                                                             "motor.static_friction": 0.0})
    constant, inertia, resistance, inductance, b, _ = motor_numbers(scene)
    turn, count = 2.0 * math.pi / 100.0, 256
    parts = np.arange(count) / count * turn
    ideal = vibro_ros.simulate(vibro_ros.load_scene("damped").with_parameters(WITHOUT_PLATES),
                               times=[0.0, *(100 * turn + parts)])
    torque = np.fft.rfft(ideal.motor_torque[1:]) / count
    voltage = (torque[0].real + b * 100.0) * resistance / constant + constant * 100.0
    samples = vibro_ros.Simulator(scene.with_parameters({"motor.voltage": voltage})).sample(1000 * turn + parts)
    speed, ahead = np.fft.rfft(samples.motor_speed) / count, samples.crank_angle[0] - 1000 * 2.0 * math.pi
    for n in (1, 2):
        rate = 1j * n * 100.0
        expected = -torque[n] / (rate * inertia + b + constant**2 / (resistance + rate * inductance))
        assert abs(speed[n] * np.exp(-1j * n * ahead) - expected) < 0.02 * abs(expected)


def test_a_crank_that_runs_back_counts_its_turns_downwards():
    device = vibro_ros.Simulator(dc("damped", CONSTANT, {"motor.voltage": -12.0, "motor.speed": 0.0}))
    device.advance_to(1.0)
    states = device.sample(np.linspace(1.0, 1.3, 400))
    assert states.crank_angle[0] < -20.0 and np.all(np.abs(np.diff(states.crank_angle)) < 0.2)


def test_another_motors_command_is_refused_and_changes_nothing():
    by_voltage = vibro_ros.Simulator(dc("damped", CONSTANT))
    by_speed = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
    for device, command, message in (
            (by_voltage, {"motor_speed": 10.0}, "motor_speed: 10.0 is no command .*command motor_voltage"),
            (by_voltage, {"motor_voltage": 40.0}, "motor.voltage: 40 is out of range; give a number from -36 to 36 V"),
            (by_voltage, {"motor_voltage": math.nan}, "motor.voltage: nan is not finite"),
            (by_speed, {"motor_voltage": 1.0}, "motor_voltage: 1.0 is no command .*command motor_speed"),
            (by_speed, {"motor_speed": -501.0}, "motor.speed: -501 is out of range")):
        with refused(device, message):
            device.command(**command)
