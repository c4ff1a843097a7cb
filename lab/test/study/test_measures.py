"""Measures: each against an independent method or a known answer, and none infinite."""

import math

import numpy as np
import pytest

import vibro_ros
from vibro_lab.study.measures import MEASURES, device_at_start, measure, window

SETTLING, DURATION = 1.5, 2.0


def running(name, **changes):
    """Return a shipped scene whose motor turns."""
    scene = vibro_ros.load_scene(name)
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return scene.with_parameters({"motor.speed": 100.0, **dotted})


def dense_samples(scene, start, rate=100_000.0):
    """Return samples over the measuring time, and its `Window`."""
    device, measured = device_at_start(scene, start), window(scene, SETTLING, DURATION)
    device.advance_to(measured.begin)
    device.take_events()
    return device.sample(np.linspace(measured.begin, measured.end, int(rate * measured.duration) + 1)), measured, device


SCENES = [("paper", 3), ("unilateral", 1), ("damped", 2), ("device", None), ("rigid", 0)]


@pytest.mark.parametrize(("name", "start"), SCENES)
def test_measures_are_those_of_dense_samples(name, start):
    """Power and shares to what 1e5 samples a second tell; speed and counts to rounding."""
    scene = running(name)
    samples, measured, device = dense_samples(scene, start)
    measured_values = measure(scene, list(MEASURES), SETTLING, DURATION, start)
    speed = np.ptp(samples.body_position[[0, -1]]) * np.sign(samples.body_position[-1] - samples.body_position[0])
    assert measured_values["mean_speed"] == pytest.approx(speed / measured.duration, rel=1e-12)
    power = np.trapezoid(samples.motor_power, samples.time) / measured.duration
    delivered = np.trapezoid(np.maximum(samples.motor_power, 0.0), samples.time) / measured.duration
    assert measured_values["mean_power"] == pytest.approx(power, abs=1e-4 * delivered)
    assert measured_values["delivered_power"] == pytest.approx(delivered, rel=1e-4)
    stands = (samples.body_velocity == 0.0) & (samples.body_height == 0.0)
    assert measured_values["stick_share"] == pytest.approx(stands.mean(), abs=2e-3)
    assert measured_values["air_share"] == pytest.approx((samples.body_height > 0.0).mean(), abs=2e-3)
    weight, changed = scene.total_mass * scene["gravity"], 5e-2
    if scene["effects.normal_force"] == "unilateral":
        mean = np.trapezoid(samples.normal_force, samples.time) / measured.duration / weight
        assert mean > 1.5 and measured_values["mean_load"] == pytest.approx(mean, rel=5e-3)
    else:  # the balance of momentum; the masses' own momentum is another at the end
        assert measured_values["mean_load"] == pytest.approx(1.0, abs=changed)
    assert measured_values["unloaded_share"] == pytest.approx((samples.normal_force <= 0.0).mean(), abs=2e-3)
    events = device.take_events()
    for side in ("upper", "inclined"):
        contacts = events[events["kind"] == f"{side}_contact"]
        assert measured_values[f"{side}_impacts"] * measured.turns == pytest.approx(len(contacts), rel=1e-9)
        if name != "rigid":
            assert measured_values[f"{side}_peak_force"] == contacts["peak_force"].max()


@pytest.mark.parametrize(("changes", "period"), [
    ({}, 2.0), ({"motor.control": "voltage", "motor.voltage": 12.0, "motor.speed": 0.0}, 1.0)])
def test_measures_of_a_dc_motor_are_those_of_dense_samples_over_its_whole_turns(changes, period):
    """The turns of its crank, which are in no step with the commanded speed; where a voltage commands it has none."""
    scene = vibro_ros.load_scene("machine").with_parameters({"motor.speed": 100.0, **changes})
    values = measure(scene, list(MEASURES), 4.0, 2.0)
    device = vibro_ros.Simulator(scene)
    device.advance_to(4.0)
    samples = device.sample(np.linspace(4.0, 6.0, 200_001))
    turned = samples.crank_angle - samples.crank_angle[0]
    last = np.searchsorted(turned, math.floor(turned[-1] / (2.0 * math.pi)) * 2.0 * math.pi)
    time, current = samples.time[:last] - 4.0, samples.motor_current[:last]
    speed = (samples.body_position[last] - samples.body_position[0]) / (samples.time[last] - 4.0)
    assert values["mean_speed"] == pytest.approx(speed, rel=1e-4)
    power = np.trapezoid(samples.electrical_power[:last], time) / time[-1]
    assert values["supply_power"] == pytest.approx(power, rel=1e-3) and power > values["mean_power"] > 0.0
    share = math.sqrt(np.trapezoid(current**2, time) / time[-1]) / scene["motor.continuous_current"]
    assert values["current_share"] == pytest.approx(share, rel=1e-3)
    assert measure(scene, ["period"], 8.0, 8.0)["period"] == period
    alone = measure(scene, ["upper_impacts", "inclined_impacts"], 4.0, 2.0)  # events that a motion's cuts do not take
    assert {name: values[name] for name in alone} == alone and alone["upper_impacts"] > 0.5


def test_a_dc_motor_is_measured_backwards_and_from_drawn_starts_of_its_voltage():
    machine = vibro_ros.load_scene("machine")
    backwards = measure(machine.with_parameters({"motor.speed": -100.0}), list(MEASURES), 2.0, 1.0)
    assert backwards["supply_power"] > 0.0 and math.isnan(backwards["period"])
    by_voltage = machine.with_parameters({"motor.control": "voltage", "motor.voltage": 15.0})
    speeds = [measure(by_voltage, ["mean_speed"], 2.0, 1.0, start)["mean_speed"] for start in (0, 1, 0)]
    assert speeds[0] == speeds[2] != speeds[1]


def test_a_dc_motor_that_does_not_get_round_is_measured_for_the_time_given():
    scene = vibro_ros.load_scene("machine").with_parameters({"motor.control": "voltage", "motor.voltage": 0.5})
    values = measure(scene, list(MEASURES), 1.0, 1.0)
    assert values["mean_speed"] == 0.0 and values["current_share"] > 0.0
    assert math.isnan(values["period"]) and math.isnan(values["upper_impacts"])


def test_ratios_are_made_of_power_which_a_method_of_fixed_step_does_not_know():
    scene = running("damped")
    fixed = measure(scene.with_parameters({"solver.method": "rk4"}), list(MEASURES), SETTLING, DURATION)
    assert math.isnan(fixed["mean_power"]) and math.isnan(fixed["speed_per_delivered_power"])
    values = measure(scene, list(MEASURES), SETTLING, DURATION)
    weight = (1.0 + 0.1 + 0.08) * 9.81
    assert values["speed_per_power"] == pytest.approx(values["mean_speed"] / values["mean_power"], rel=1e-15)
    cost = values["mean_power"] / abs(weight * values["mean_speed"])
    assert values["cost_of_transport"] == pytest.approx(cost, rel=1e-15)
    assert values["delivered_cost_of_transport"] > values["cost_of_transport"] > 0.0


def test_the_mean_of_n_as_printed_is_that_of_dense_samples():
    """By the momentum of the masses, against N itself, whose pulls of thousands of newtons last 0.3 ms."""
    scene = running("paper")
    samples, measured, _ = dense_samples(scene, 3, 1e6)
    mean = np.trapezoid(samples.normal_force, samples.time) / measured.duration / (scene.total_mass * scene["gravity"])
    assert measure(scene, ["mean_load"], SETTLING, DURATION, 3)["mean_load"] == pytest.approx(mean, abs=1e-3)


def test_a_measure_does_not_depend_on_the_others():
    scene = running("device")
    together = measure(scene, list(MEASURES), SETTLING, DURATION, 4)
    for name in ("mean_speed", "upper_impacts", "stick_share", "period"):
        np.testing.assert_equal(measure(scene, [name], SETTLING, DURATION, 4)[name], together[name])


def test_a_mean_speed_is_that_of_whole_turns():
    """To what the parts of a turn make of the mean of whole seconds."""
    scene = running("damped")
    for start in (0, 1):
        device = device_at_start(scene, start)
        device.advance_to(4.0)
        begin = device.state.body_position
        device.advance_to(14.0)
        expected = (device.state.body_position - begin) / 10.0
        assert measure(scene, ["mean_speed"], 4.0, 10.0, start)["mean_speed"] == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("name", "changes", "turns"), [
    ("damped", {}, 1.0), ("device", {}, 4.0), ("paper", {}, 0.0), ("no_impact", {}, 0.0)])
def test_period_in_turns(name, changes, turns):
    assert measure(running(name, **changes), ["period"], 8.0, 8.0)["period"] == turns


def test_a_period_needs_turns_that_show_it():
    scene, turn = running("damped"), 2.0 * math.pi / 100.0
    assert measure(scene, ["period"], 8.0, 5.0 * turn, None)["period"] == 1.0
    assert math.isnan(measure(scene, ["period"], 8.0, 4.9 * turn, None)["period"])
    changing = scene.with_parameters({"effects.motor": "lag", "motor.time_constant": 1e3})
    assert math.isnan(measure(changing, ["period"], 1.5, 1.0, 0)["period"])


def test_chaos_is_told_from_order():
    exponents = [measure(running(name), ["lyapunov_exponent"], 4.0, 6.0, 5)["lyapunov_exponent"]
                 for name in ("unilateral", "damped", "no_impact")]
    assert 2.0 < exponents[0] < 9.0
    assert exponents[1:] == [0.0, 0.0]


@pytest.mark.parametrize("changes", [
    {"motor__speed": 0.0}, {"gravity": 0.0}, {"effects__inclined_mass": False}, {"effects__upper_mass": False},
    {"motor__speed": 1e-29}, {"guide__angle": 0.0}, {"ground__friction": 1e3, "effects__normal_force": "weight"}])
def test_no_measure_is_infinite(changes):
    values = measure(running("device", **changes), list(MEASURES), 1.5, 1.0, 0)
    assert list(values) == list(MEASURES)
    assert not any(math.isinf(value) for value in values.values())
    if values["mean_speed"] == 0.0:
        assert math.isnan(values["cost_of_transport"])


def test_a_robot_that_stands_has_speed_and_power_0_and_no_rates():
    values = measure(vibro_ros.load_scene("device"), list(MEASURES), 1.0, 1.0)
    assert (values["mean_speed"], values["mean_power"], values["stick_share"]) == (0.0, 0.0, 1.0)
    assert all(math.isnan(values[name]) for name in ("speed_per_power", "cost_of_transport", "upper_impacts", "period"))


@pytest.mark.parametrize(("names", "settling", "duration", "start", "words"), [
    ([], 1.0, 1.0, None, "none named"), (["mean_sped"], 1.0, 1.0, None, "did you mean mean_speed"),
    (["mean_speed,period"], 1.0, 1.0, None, "separate them by spaces"),
    (["mean_speed"], -1.0, 1.0, None, "from 0"), (["mean_speed"], 0.5, 1.0, 0, "from 1"),
    (["mean_speed"], math.nan, 1.0, None, "settling"), (["mean_speed"], 1.0, 0.0, None, "above 0"),
    (["mean_speed"], 1.0, math.inf, None, "duration")])
def test_what_makes_no_sense_is_refused(names, settling, duration, start, words):
    with pytest.raises(ValueError, match=words):
        measure(running("damped"), names, settling, duration, start)
