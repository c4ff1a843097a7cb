"""The recordings of the laboratory: the device's own solver finds their motion, and their noise is what it says."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from vibro_lab.identification.recording import read_recording

pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, is not installed")

from laboratory import FIELD, ROBOTS, Faults, lowpassed, record

#: Seconds that are compared; the other motions are chaotic, and noise of rounding grows.
HORIZON = {"damped": 4.0, "starts": 4.0, "viscous": 4.0, "dragged": 4.0}
CHANNELS = {"body_position", "body_velocity", "upper_position", "upper_velocity", "inclined_position",
            "inclined_velocity", "crank_angle"}


@pytest.mark.parametrize("robot", ROBOTS)
def test_our_own_solver_finds_the_motion_of_a_laboratory_recording(robot, tmp_path):
    """With 250 samples or more, a mean square in standard deviations is within 0.7 and 1.3 (more than 3 sigma)."""
    made = record(tmp_path / "bag", robot)
    recording = read_recording(made.bag, made.truth, {  # as drawn: the differences of neighbours have motion in them
        f"joint_states.{side}_{name}": sigma for side in ("upper", "inclined")
        for name, sigma in (("position", 5e-5), ("velocity", 1e-3))})
    hop = {"body_height", "body_vertical_velocity"} if made.truth.body_hops else set()
    assert {channel.field for channel in recording.channels} == CHANNELS | hop
    horizon = HORIZON.get(robot, 0.5)
    times = recording.channels[0].times
    times = times[times <= horizon]
    run = vibro_ros.simulate(made.truth, times=times, commands=recording.commands)
    for channel in recording.channels:
        residuals = (channel.values[:len(times)] - getattr(run, channel.field)) / channel.sigma
        assert 0.7 < np.mean(residuals**2) < 1.3, channel.field
    assert made.truth != made.scene


def test_field_sensors_measure_what_our_own_sensors_would(tmp_path):
    made = record(tmp_path / "bag", "damped", "field", duration=1.0)
    recording = {channel.field: channel for channel in read_recording(made.bag, made.truth).channels}
    assert set(recording) == {"body_position", "acceleration_x", "crank_angle"}
    assert (recording["body_position"].sigma, recording["body_position"].sigma_from) == (1e-3, "covariance")
    assert recording["crank_angle"].resolution == pytest.approx(math.tau / 4096)
    simulator = vibro_ros.SensedSimulator(made.truth)
    simulator.advance_to(1.0)
    read = np.array([values[0] for sensor, _, values in simulator.take_measurements() if sensor == "imu"])
    measured = recording["acceleration_x"]
    assert np.abs(measured.values).max() > 100.0  # blows are in it
    # The same seed draws the same noise. The low-pass by steps of 50 µs is 1 % off where a blow lasts some of them.
    assert np.abs(measured.values - read).max() < 0.02 * np.abs(read).max()
    assert measured.resolution > 0.0


def test_each_fault_of_a_laboratory_is_in_its_bag(tmp_path):
    """Of 501 messages 10 % are lost and 2 % wild; jitter and stated noise have their size to 15 %, 4 deviations."""
    faults = Faults(rate=100.0, jitter=3e-4, late={"odom": 0.003}, fast={"joint_states": 1e-3}, outliers=0.02, lost=0.1,
                    stated=0.33, begins_in_motion=0.5, camera_scale=1.01)
    made = record(tmp_path / "bag", "damped", duration=5.0, faults=faults)
    recording = read_recording(made.bag, made.truth)
    channels = {channel.field: channel for channel in recording.channels}
    body, mass, crank = channels["body_position"], channels["upper_position"], channels["crank_angle"]
    begin = min(channel.times[0] for channel in recording.channels)
    for channel, late, share in ((body, 0.003, 0.0), (mass, 0.0, 1e-3), (crank, 0.0, 0.0)):
        assert 420 < len(channel.times) < 480
        since = channel.times + (recording.start - 1_763_700_000.0) - begin
        true = np.round((since - late) / (1.0 + share) * 100.0) / 100.0
        away = since - late - true * (1.0 + share)
        assert np.std(away) == pytest.approx(3e-4, rel=0.15)
        assert abs(np.mean(away)) < 1e-4
    assert body.sigma == pytest.approx(0.33 * 5e-5)
    assert not recording.commands  # those of before the recording
    true = vibro_ros.simulate(made.truth, times=0.5 + np.round((body.times + (recording.start - 1_763_700_000.0)
                                                               - 0.003) * 100.0) / 100.0)
    away = np.abs(body.values - 1.01 * true.body_position)
    assert np.median(away) == pytest.approx(0.674 * 5e-5, rel=0.15)
    assert 3 <= (away > 5e-4).sum() <= 18
    camera = record(tmp_path / "camera", "damped", duration=0.5, faults=Faults(rate=100.0, positions_only=True))
    assert {f"{channel.sensor}.{channel.field}" for channel in read_recording(camera.bag, camera.truth).channels} == {
        "tracking.body_position", "joint_states.upper_position", "joint_states.inclined_position",
        "encoder.crank_angle"}


def test_the_low_pass_of_a_step_is_that_of_butterworth():
    """Its impulse response is sqrt(2) r exp(-r t / sqrt(2)) sin(r t / sqrt(2)); a jump is spread over one step."""
    times, rate = np.arange(2001) / 1e5, math.tau * 260.0
    since = (times[1:] - 0.5e-5) * rate / math.sqrt(2.0)
    exact = 2.0 * math.sqrt(2.0) * rate * np.exp(-since) * np.sin(since)
    acceleration = lowpassed(times, np.where(times > 0.0, 2.0, 0.0), 260.0)
    assert np.abs(acceleration[1:] - exact).max() < 1e-3 * exact.max()


def test_the_command_writes_the_bag_and_both_scenes(tmp_path):
    program = Path(__file__).with_name("laboratory.py")
    subprocess.run([sys.executable, program, "stribeck", tmp_path / "bag", "--sensors", "field", "--duration", "0.2"],
                   check=True, timeout=120, stdout=subprocess.DEVNULL)
    truth, scene = (vibro_ros.load_scene(tmp_path / f"bag.{name}.yaml") for name in ("truth", "scene"))
    assert (truth["effects.friction"], scene["effects.friction"]) == ("stribeck", "coulomb")
    assert scene["sensors.preset"] == FIELD["sensors.preset"]
    assert {channel.sensor for channel in read_recording(tmp_path / "bag", scene).channels} == {
        "tracking", "imu/data_raw", "encoder"}
