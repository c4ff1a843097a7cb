"""The computed motion between published samples is the robot's motion, whatever commands came meanwhile."""

import json

import numpy as np
import pytest
from motion_reader import NEAR, Motion, assert_is_run
from robot_bag import offset_times

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.view.slow_motion import motion_between

START = 3.0  # s
COMMANDS = [(0.0, {"motor_speed": 100.0}), (3.2, {"motor_speed": 130.0, "upper_gap": 0.0005}),
            (3.5, {"inclined_gap": -0.0003}), (3.6, {"motor_speed": 90.0}), (3.9, {"motor_speed": 95.0})]


def published(scene, rate=200.0, start=START, duration=1.0, commands=COMMANDS):
    """Return samples as the robot publishes them: before the commands of their instant, with stamps in whole
    nanoseconds.
    """
    device, rows = vibro_ros.Simulator(scene), []
    waiting = list(commands)
    for tick in range(round(start * rate), round((start + duration) * rate) + 1):
        while waiting and waiting[0][0] < tick / rate - 1e-9:
            device.advance_to(waiting[0][0])
            device.command(**waiting.pop(0)[1])
        device.advance_to(tick / rate)
        rows.append(device.values.copy())
    samples = dict(zip(vars(device.state), np.array(rows).T, strict=True))
    return {**samples, "time": np.round(samples["time"], 9)}


def made(scene, samples):
    header, payload = motion_between(scene, samples)
    return Motion(json.loads(json.dumps(header, allow_nan=False)), payload)


def run_of(scene, times, commands=COMMANDS):
    return vibro_ros.simulate(scene, times=times, commands=commands)


@pytest.mark.parametrize("name", [name for name in shipped_scenes() if name != "machine"])
@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_every_scene_under_commands(name, rate):
    """At 50 Hz the crank makes a third of a turn between two samples."""
    scene = vibro_ros.load_scene(name)
    motion = made(scene, published(scene, rate))
    assert (motion.header["exact"], motion.header["why"]) == (True, "")
    assert_is_run(motion, run_of(scene, offset_times(START, START + 1.0, 10_000)))


def test_a_motor_whose_controller_remembers_is_shown_from_sample_to_sample():
    """No sample contains the integral of a dc motor's controller."""
    scene = vibro_ros.load_scene("machine")
    motion = made(scene, published(scene, 200.0))
    assert not motion.header["exact"] and motion.header["why"].endswith("interpolated between the samples")


@pytest.mark.parametrize("name", ["paper", "unilateral"])
def test_chaos_does_not_grow_over_five_seconds(name):
    """Without dampers rounding errors grow; where they have grown too much, the motion is continued from a published
    sample.
    """
    scene = vibro_ros.load_scene(name)
    motion = made(scene, published(scene, start=1.0, duration=5.0, commands=[]))
    assert motion.header["exact"]
    assert_is_run(motion, run_of(scene, offset_times(1.0, 6.0, 20_000), []))


@pytest.mark.parametrize("rate", [120.0, 300.0, 700.0])
def test_stamps_in_whole_nanoseconds_are_no_harm(rate):
    scene = vibro_ros.load_scene("device")
    motion = made(scene, published(scene, rate, commands=COMMANDS[:1]))
    assert motion.header["exact"]
    assert_is_run(motion, run_of(scene, offset_times(START + 1e-8, START + 1.0 - 1e-8, 10_000), COMMANDS[:1]))


BACKWARDS = [(0.0, {"motor_speed": -20.0}), (3.2, {"motor_speed": 50.0}), (3.7, {"motor_speed": -90.0})]


@pytest.mark.parametrize("motor", ["ideal", "ramp", "lag"])
@pytest.mark.parametrize("commands", [COMMANDS, BACKWARDS])
def test_every_motor_on_its_way(motor, commands):
    scene = vibro_ros.load_scene("device").with_parameters({"effects.motor": motor})
    motion = made(scene, published(scene, commands=commands))
    assert motion.header["exact"] and not motion.header["resets"]
    assert_is_run(motion, run_of(scene, offset_times(START, START + 1.0, 5000), commands))


@pytest.mark.parametrize("name", ["device", "rigid"])
def test_every_impact_is_marked_and_exact_around_it(name):
    scene = vibro_ros.load_scene(name)
    motion = made(scene, published(scene, commands=COMMANDS[:1]))
    impacts = motion.header["impacts"]
    around = np.unique(np.concatenate([np.linspace(one["time"] - 1e-5, one["end"] + 1e-5, 20) for one in impacts]))
    run = run_of(scene, around[(around > START) & (around < START + 1.0)], COMMANDS[:1])
    assert_is_run(motion, run)
    contacts = run.events[np.char.endswith(run.events["kind"], "contact") & (run.events["time"] > START)]
    np.testing.assert_allclose([one["time"] for one in impacts], contacts["time"], rtol=0, atol=1e-9)
    assert len(impacts) > 20


def test_a_reset_begins_another_motion():
    scene = vibro_ros.load_scene("device")
    first, second = (published(scene, start=start, duration=0.5, commands=COMMANDS[:1]) for start in (3.0, 0.0))
    second = {**second, "time": second["time"] + 3.505}
    motion = made(scene, {name: np.concatenate([first[name], second[name]]) for name in first})
    assert motion.header["exact"] and motion.header["resets"] == [pytest.approx(3.505, abs=1e-9)]
    assert motion.header["exact_spans"] == [pytest.approx([3.0, 3.5]), pytest.approx([3.505, 4.005])]
    assert np.isnan(motion.at(np.array([3.502]))["body_position"]).all()


def test_samples_that_did_not_arrive_are_bridged():
    """The missing half of the samples contains nothing that the other half does not determine."""
    scene, samples = vibro_ros.load_scene("device"), published(vibro_ros.load_scene("device"), commands=COMMANDS[:1])
    kept = np.random.default_rng(1).uniform(size=len(samples["time"])) < 0.5
    kept[[0, -1]] = True
    motion = made(scene, {name: column[kept] for name, column in samples.items()})
    assert motion.header["exact"]
    assert_is_run(motion, run_of(scene, offset_times(START, START + 1.0, 5000), COMMANDS[:1]))


def test_where_the_robot_is_another_one_the_motion_is_interpolated_and_says_so():
    scene = vibro_ros.load_scene("device")
    other = scene.with_parameters({"ground.friction": 0.21})
    samples = published(other)
    motion = made(scene, samples)
    header = motion.header
    assert not header["exact"] and "off at the next sample" in header["why"] and "interpolated" in header["why"]
    found = motion.at(samples["time"])
    for name in ("body_position", "upper_position", "crank_angle"):
        assert np.abs(found[name] - samples[name]).max() <= NEAR
    assert not np.isnan(motion.at(offset_times(START, START + 1.0))["inclined_position"]).any()


def test_one_sample_that_somebody_spoilt_costs_two_intervals():
    scene, samples = vibro_ros.load_scene("device"), published(vibro_ros.load_scene("device"), commands=COMMANDS[:1])
    samples["upper_position"][100] += 1e-6
    header = made(scene, samples).header
    assert not header["exact"]
    assert header["exact_spans"] == [pytest.approx([3.0, 3.495]), pytest.approx([3.505, 4.0])]


@pytest.mark.parametrize("spoilt", [
    {"upper_position": 1e300}, {"upper_position": np.nan}, {"motor_speed": -600.0}, {"motor_speed": 1e9},
    {"upper_plate_position": -1.0}, {"crank_angle": -1e10}, {"body_height": -1.0}, {"inclined_velocity": np.inf}])
def test_samples_that_no_robot_is_in_are_no_error(spoilt):
    scene, samples = vibro_ros.load_scene("device"), published(vibro_ros.load_scene("device"), duration=0.1)
    for name, value in spoilt.items():
        samples[name][5] = value
    motion = made(scene, samples)
    assert (motion.header["begin"], motion.header["end"]) == (pytest.approx(3.0), pytest.approx(3.1))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_hardly_any_samples(count):
    scene = vibro_ros.load_scene("device")
    motion = made(scene, {name: column[:count] for name, column in published(scene).items()})
    assert motion.header["pieces"] >= (count == 2)


def test_a_field_that_nobody_publishes_is_named():
    scene = vibro_ros.load_scene("device")
    samples = {name: column for name, column in published(scene).items() if name != "upper_velocity"}
    header = made(scene, samples).header
    assert not header["exact"] and header["why"].startswith("upper_velocity is not published")
