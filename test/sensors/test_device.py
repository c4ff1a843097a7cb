"""Sensors on the moving device: instants, delays, dropouts, faults, and bits that depend on nothing else."""

import math

import numpy as np
import pytest

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.topics import SENSOR_TOPICS
from vibro_ros.model import faults
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.sensors.device import FAULTS, KINDS, SensedSimulator, new_device
from vibro_ros.simulation.simulator import Simulator

ALL = {"motor.speed": 100.0, "sensors.preset": "bmi270", "sensors.imu.rate": 800.0, "sensors.imu.delay": 0.003,
       "sensors.encoder.rate": 500.0, "sensors.tracking.rate": 120.0, "sensors.tracking.latency": 0.05,
       "sensors.tracking.dropout_probability": 0.05, "effects.motor": "dc", "sensors.current.rate": 300.0,
       "sensors.current.noise": 0.05}


def device_with(changes: dict, scene: str = "device") -> SensedSimulator:
    return SensedSimulator(load_scene(scene).with_parameters(changes))


def released_by(device: SensedSimulator, until: float, step: float) -> dict[str, list]:
    """Return the measurements up to `until` when the device is advanced in steps of about `step` [s]."""
    begin, released = device.time, {}
    for time in np.linspace(begin, until, 1 + math.ceil((until - begin) / step))[1:]:
        device.advance_to(time)
        for sensor, at, values in device.take_measurements():
            released.setdefault(sensor, []).append((at, *values.tolist()))
    return released


def test_bits_depend_on_the_seed_and_neither_on_cuts_nor_on_other_sensors():
    coarse = released_by(device_with(ALL), 1.0, 0.1)
    assert {name: len(rows) > 50 for name, rows in coarse.items()} == dict.fromkeys(
        ("imu", "encoder", "current", "tracking"), True)
    assert released_by(device_with(ALL), 1.0, 0.00037) == coarse
    other, plain = device_with({**ALL, "sensors.seed": 1.0}), new_device(load_scene("device").with_parameters(
        {"motor.speed": 100.0, "effects.motor": "dc"}))
    noisy = released_by(other, 1.0, 0.1)
    plain.advance_to(1.0)
    assert type(plain) is Simulator and other.state == plain.state  # noise is none of the motion's
    assert noisy["encoder"] == coarse["encoder"] and noisy["imu"] != coarse["imu"]
    for name, rows in coarse.items():
        others = {f"sensors.{other}.rate": 0.0 for other in coarse if other != name}
        assert released_by(device_with({**ALL, **others}), 1.0, 0.013) == {name: rows}


def test_a_device_goes_on_from_a_checkpoint_with_the_same_bits():
    device, other = device_with(ALL), device_with(ALL)
    released_by(device, 0.3, 0.1)
    device.fail("sensor_freeze", 0.05, "encoder")
    device.fail("sensor_offset", 0.2, "tracking", 0.5)
    checkpoint = device.checkpoint()
    other.restore(checkpoint)
    assert released_by(device, 0.6, 0.01) == released_by(other, 0.6, 0.1)
    device.reset()
    other.restore(device_with(ALL).checkpoint())
    assert np.array_equal(device.checkpoint(), other.checkpoint(), equal_nan=True)


def test_a_forged_memory_is_refused_and_changes_nothing():
    device = device_with(ALL)
    released_by(device, 0.2, 0.1)
    good = device.checkpoint()
    motion = len(Simulator.checkpoint(device))
    for place in range(motion, motion + 5):  # count, ends of faults, offset of the imu
        forged = good.copy()
        forged[place] = np.nan
        with pytest.raises(ValueError, match="no state that the sensor imu"):
            device.restore(forged)
    for forged in (good[:-1], good[:motion], np.zeros((2, 2))):
        with pytest.raises(ValueError, match="the checkpoint"):
            device.restore(forged)
    assert np.array_equal(device.checkpoint(), good, equal_nan=True)


def test_measurements_have_their_instants_and_come_out_after_the_delay():
    device = device_with({"sensors.tracking.rate": 50.0, "sensors.tracking.latency": 0.05,
                          "sensors.tracking.noise": 0.0, "motor.speed": 80.0})
    truth = Simulator(load_scene("device").with_parameters({"motor.speed": 80.0}))
    device.advance_to(0.0499)
    assert device.take_measurements() == []
    device.advance_to(0.5)
    taken = device.take_measurements()
    assert [measurement.time for measurement in taken] == [k / 50.0 for k in range(23)]
    for measurement in taken:
        truth.advance_to(measurement.time)
        assert measurement.values.tolist() == [truth.state.body_position, 0.0, truth.state.body_height, 0.0]


def test_an_encoder_counts_ticks():
    ticks, window = 1000.0, 0.02
    rows = np.array(released_by(device_with({"motor.speed": 90.0, "sensors.encoder.rate": 200.0,
                                       "sensors.encoder.ticks": ticks, "sensors.encoder.velocity_window": window},
                                      "damped"), 2.0, 1.0)["encoder"])
    tick = 2.0 * math.pi / ticks
    counts = rows[:, 1] / tick
    assert np.allclose(counts, np.rint(counts), rtol=0.0, atol=1e-9)
    assert np.abs(rows[:, 1] - 90.0 * rows[:, 0]).max() <= 0.5 * tick * (1.0 + 1e-9)
    assert np.abs(rows[1:, 2] - 90.0).max() <= tick * 200.0 and rows[0, 2] == 0.0
    assert np.abs(rows[4:, 2] - 90.0).max() <= tick / window * (1.0 + 1e-9)
    assert np.ptp(rows[4:, 2]) == pytest.approx(tick / window)  # two neighbours of a step: the resolution of the speed


def test_the_supply_s_current_is_what_its_power_says_clipped_noisy_and_in_steps():
    """A stalled motor at V takes V²/R; the supply gives this power at its own voltage, with the errors of the chain."""
    stalled = {"effects.motor": "dc", "motor.control": "voltage", "motor.voltage": 12.0, "motor.friction": 1e3,
               "motor.static_friction": 1e3, "motor.speed": 0.0, "sensors.current.rate": 1000.0}
    true, supply, resistance = 144.0 / 1.43 / 36.0, 36.0, 0.5
    braking = device_with({**stalled, "motor.voltage": 1.0, "motor.speed": 100.0})
    for measurement in braking.take_measurements():
        assert measurement.values[0] == braking.state.electrical_power / 36.0 < 0.0
    exact = device_with({**stalled, "sensors.current.supply_resistance": resistance})
    exact.advance_to(0.5)
    for measurement in exact.take_measurements()[1:]:
        assert measurement.values == pytest.approx([true, supply - resistance * true], rel=1e-13)
    noisy = device_with({**stalled, "sensors.current.noise": 0.1, "sensors.current.resolution": 0.01,
                         "sensors.current.range": 2.0})
    rows = np.array(released_by(noisy, 10.0, 1.0)["current"])
    assert np.abs(rows[:, 1] / 0.01 - np.rint(rows[:, 1] / 0.01)).max() < 1e-9
    spread = math.sqrt(0.1**2 + 0.01**2 / 12.0)
    assert rows[:, 1].mean() == pytest.approx(2.0, abs=4.0 * spread / 100.0)  # of 1e4 samples, clipped at 2 A
    assert rows[:, 1].std() == pytest.approx(spread, rel=4.0 / math.sqrt(2e4))
    assert np.all(rows[:, 2] == supply)


def test_dropouts_take_the_share_that_renewal_theory_gives():
    probability, duration, rate = 0.02, 0.1, 100.0
    rows = released_by(device_with({"sensors.tracking.rate": rate, "sensors.tracking.dropout_duration": duration,
                              "sensors.tracking.dropout_probability": probability}, "no_impact"), 100.0, 10.0)
    # A sample comes out if none of the ten up to it began a dropout.
    share = (1.0 - probability) ** (duration * rate)
    assert len(rows["tracking"]) / 1e4 == pytest.approx(share, abs=0.05)  # its errors last 0.1 s: 4 standard errors


def test_faults():
    changes = {"sensors.encoder.rate": 100.0, "motor.speed": 50.0}
    healthy = released_by(device_with(changes), 0.6, 0.1)["encoder"]
    device = device_with(changes)
    released_by(device, 0.1, 0.1)
    device.fail("sensor_dropout", 0.1, "encoder")
    assert [row[0] for row in released_by(device, 0.25, 0.1)["encoder"]] == [k / 100.0 for k in range(20, 26)]
    device.fail("sensor_freeze", 0.1, "encoder")
    assert device.disturbances == {"sensor_freeze of encoder": 0.35}
    frozen = released_by(device, 0.345, 0.01)["encoder"]
    assert {row[1:] for row in frozen} == {healthy[25][1:]} and [row[0] for row in frozen] == [
        k / 100.0 for k in range(26, 35)]
    device.fail("sensor_offset", 0.105, "encoder", 0.5)
    offset = released_by(device, 0.6, 0.01)["encoder"]
    added = [row[1] - good[1] for row, good in zip(offset[:10], healthy[35:45], strict=True)]
    assert added == pytest.approx([0.5] * 10)
    assert offset[10:] == healthy[45:]


def test_an_impossible_fault_is_refused():
    device = device_with({"sensors.encoder.rate": 100.0})
    for arguments, words in ((("sensor_dropout", 1.0, "imu"), "the sensor imu is off; give encoder"),
                             (("sensor_dropout", 1.0), "of: "), (("sensor_melt", 1.0, "encoder"), "choose one of"),
                             (("sensor_offset", 1.0, "encoder", math.nan), "not finite"),
                             (("sensor_dropout", math.inf, "encoder"), "not finite")):
        with pytest.raises(ValueError, match=words):
            device.fail(*arguments)
    assert device.disturbances == {}
    device.fail("plate_stuck", 0.5, "upper")
    assert device.disturbances == {"plate_stuck of upper": 0.5}


def test_a_body_at_rest_feels_its_weight_along_the_slope():
    device = device_with({"sensors.imu.rate": 100.0, "ground.slope": 0.1, "ground.friction": 0.5, "motor.speed": 0.0,
                          "effects.upper_mass": False, "effects.inclined_mass": False})
    device.advance_to(0.1)
    for measurement in device.take_measurements():
        assert measurement.values[:3] == pytest.approx([9.81 * math.sin(0.1), 0.0, 9.81 * math.cos(0.1)], rel=1e-12)


def test_hostile_times_and_parameters():
    device = device_with({"sensors.encoder.rate": 1e4})
    for time in (math.nan, math.inf, 1e300, -1.0):
        with pytest.raises(ValueError, match="cannot advance"):
            device.advance_to(time)
    for changes, words in (({"sensors.imu.bandwidth": 0.0}, "lets nothing pass"),
                           ({"sensors.imu.accelerometer.range": -0.5}, "give at least 0, or -1"),
                           ({"sensors.current.rate": 100.0}, "choose dc for effects.motor"),
                           ({"sensors.current.rate": math.nan, "effects.motor": "dc"}, "not finite"),
                           ({"sensors.seed": 0.5}, "no whole number"),
                           ({"sensors.imu.rate": 100.0, "solver.method": "rk4"}, "choose exact")):
        with pytest.raises(ValueError, match=words):
            load_scene("device").with_parameters(changes)


def test_every_sensor_has_a_row_in_every_table():
    of_sensors = {name: fault for name, fault in faults.FAULTS.items() if fault.affects == faults.SENSORS}
    assert set(of_sensors) == set(FAULTS) and {fault.of for fault in of_sensors.values()} == {tuple(KINDS)}
    assert set(SENSOR_TOPICS) == set(KINDS)
    assert {name.split(".")[1] for name in BY_NAME if name.startswith("sensors.") and name.endswith(".rate")} == set(
        KINDS)
