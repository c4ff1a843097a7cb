"""Any bag gives either a document that a browser can read or a line with the reason, always within a short time."""

import json
import time

import numpy as np
import pytest
from motion_reader import MotionDocument
from robot_bag import START, edit_each, edit_topic, rewritten, robot_bag, without_topics

import vibro_ros
from vibro_ros.bag.stream import BagError
from vibro_ros.view import motion as motion_document
from vibro_ros.view.view import bag_motion

RATE = 200.0
END = START + 10**9  # ns
DAYS = 10**15  # ns


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return robot_bag(tmp_path_factory.mktemp("recorded") / "bag", "device", 201, {0: {"motor_speed": 100.0}}, RATE)


def read(folder):
    began = time.monotonic()
    setting, header, payload = bag_motion(folder)
    assert time.monotonic() - began < 60.0  # nobody asks for years of simulation
    motion = MotionDocument(json.loads(json.dumps(header, allow_nan=False)), payload)
    json.dumps(setting, allow_nan=False)
    assert "\n" not in header["why"] and (header["why"] == "") == header["exact"]
    borders = motion.borders
    assert (borders[:, 1] > borders[:, 0]).all() and (borders[1:, 0] >= borders[:-1, 1]).all()
    assert header["impacts"] == sorted(header["impacts"], key=lambda impact: impact["time"])
    return motion, setting


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("from_stamp", [END, START + 5 * 10**8])
def test_stamps_of_another_time(recorded, tmp_path, from_stamp, known):
    motion, _ = read(rewritten(recorded, tmp_path / "other", edit_each(lambda message: (
        message[0], message[1] + (DAYS if message[1] >= from_stamp else 0), message[2])), known=known))
    assert not np.isnan(motion.at(np.array([0.1]))["upper_position"]).any()


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("value", [np.nan, -1e300])
def test_a_position_that_is_not_finite(recorded, tmp_path, value, known):
    def spoil(odometry):
        odometry.pose.pose.position.x = value

    motion, _ = read(rewritten(recorded, tmp_path / "other",
                               edit_topic("odom", spoil, lambda stamp: stamp == START + 5 * 10**8), known=known))
    x = motion.at(np.array([0.3, 0.9]))["body_position"]
    assert np.isfinite(x).all() and (np.abs(x) < 1.0).all()


@pytest.mark.parametrize("known", [True, False])
def test_joints_of_another_machine(recorded, tmp_path, known):
    def rename(joints):
        joints.name = [f"joint{number}" for number in range(len(joints.name))]

    other = rewritten(recorded, tmp_path / "other", edit_topic("joint_states", rename), known=known)
    motion, _ = read(other)
    assert not np.isnan(motion.at(np.array([0.5]))["body_position"]).any()
    without = rewritten(other, tmp_path / "without", without_topics("/odom"), known=known)
    with pytest.raises(BagError, match="holds no state to draw"):
        bag_motion(without)


def test_messages_that_cannot_be_read(recorded, tmp_path):
    motion, setting = read(rewritten(recorded, tmp_path / "other", edit_each(lambda message: (
        message[0], message[1], message[2][:20] if message[0] in ("/odom", "/motor_speed") else message[2]))))
    assert any("/odom: 201 unreadable messages" in note for note in setting["notes"])
    assert not np.isnan(motion.at(np.array([0.5]))["upper_position"]).any()


def test_a_reset_at_every_sample(tmp_path):
    motion, _ = read(robot_bag(tmp_path / "bag", "device", 201, dict.fromkeys(range(201), "reset"), RATE))
    assert motion.header["pieces"] == 0 and len(motion.header["resets"]) == 201


@pytest.mark.parametrize("ticks", [1, 2])
def test_hardly_any_samples(tmp_path, ticks):
    motion, _ = read(robot_bag(tmp_path / "bag", "device", ticks, {}, RATE))
    assert motion.header["exact"] and bool(motion.header["pieces"]) == (ticks == 2)


@pytest.mark.parametrize("method, most, is_exact", [
    ("exact", 2000, True), ("rk4", 2000, True), ("rk4_located", 2000, True), ("rk4", 0, False)])
def test_a_note_says_that_a_method_with_many_steps_is_drawn_coarsely(
        tmp_path, monkeypatch, method, most, is_exact):
    monkeypatch.setattr(motion_document, "MOST_OF_STEPS", most)
    scene = vibro_ros.load_scene("device").with_parameters({"solver.method": method})
    motion, _ = read(robot_bag(tmp_path / "bag", scene, 101, {0: {"motor_speed": 100.0}}, RATE))
    header = motion.header
    assert header["exact"] == is_exact and (header["exact_spans"] == [[0.0, 0.5]]) == is_exact
    times = np.sort(np.random.default_rng(0).uniform(0.0, 0.5, 5000))
    run = vibro_ros.simulate(scene, times=times, commands=[(0.0, {"motor_speed": 100.0})])
    values = motion.at(times)
    for name in ("body_position", "upper_position", "inclined_position"):
        assert np.abs(values[name] - getattr(run, name)).max() < (1e-9 if is_exact else 1e-5)


@pytest.mark.filterwarnings("ignore::vibro_ros.simulation.simulator.ToleranceWarning")
@pytest.mark.parametrize("changes", [
    {"upper.plate.stiffness": 1e12, "inclined.plate.stiffness": 1e12}, {"crank.radius": 0.06},
    {"motor.max_speed": 1e4, "motor.acceleration": 1e9}, {"effects.inclined_mass": False},
    {"effects.upper_mass": False, "effects.inclined_mass": False}])
def test_extreme_robots(tmp_path, changes):
    """Forces that are mostly rounding error, kinks without an event, 1600 turns a second, no mass at all."""
    scene = vibro_ros.load_scene("device").with_parameters(changes)
    speed = min(scene["motor.max_speed"], 1e4) if "motor.max_speed" in changes else 100.0
    motion, setting = read(robot_bag(tmp_path / "bag", scene, 41, {0: {"motor_speed": speed}}, RATE))
    assert motion.header["exact"] and setting["machine"]["crank_radius"] == scene["crank.radius"]
    times = np.sort(np.random.default_rng(0).uniform(0.0, 0.2, 3000))
    run = vibro_ros.simulate(scene, times=times, commands=[(0.0, {"motor_speed": speed})])
    for name, values in motion.at(times).items():
        if name.endswith(("position", "height", "angle")):
            assert np.abs(values - getattr(run, name)).max() <= 1e-9, name


def test_stamps_between_the_samples(recorded, tmp_path):
    """Another recorder stores the robot's messages under its own stamps, so that no input belongs to a sample."""
    motion, setting = read(rewritten(recorded, tmp_path / "other", edit_each(
        lambda message: (message[0], message[1] + 3, message[2]))))
    assert "the stamps in the bag are not those of the robot's samples" in motion.header["why"]
    assert setting["robot"] == "device" and not np.isnan(motion.at(np.array([0.5]))["upper_position"]).any()
