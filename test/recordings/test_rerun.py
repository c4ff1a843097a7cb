"""A recorded run is simulated again from its beginning or its first checkpoint, or refused in words."""

import json
import time

import pytest
from robot_bag import START, edit_each, holding, rewritten, robot_bag, without_earlier

import vibro_ros
from vibro_ros.bag.stream import BagStream
from vibro_ros.messages.codec import deserialised, serialised
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, ROBOT_TOPICS, TOPICS
from vibro_ros.recordings import replay

RATE = 50.0
TICKS = 120
TOLD = {tick: {"motor_speed": 60.0 + tick} for tick in range(10, TICKS, 20)}


@pytest.fixture
def recorded(tmp_path):
    return robot_bag(tmp_path / "bag", "device", TICKS, TOLD, RATE)


def late_with(recorded, folder, tick, state):
    """Return the recording from a sample on, with a checkpoint there."""
    checkpoint = f"/{CHECKPOINT}", START + round(tick / RATE * 1e9), holding(TOPICS[CHECKPOINT].type, state)
    return rewritten(recorded, folder, lambda all_of_it: sorted([*without_earlier(tick / RATE)(all_of_it), checkpoint],
                                                                key=lambda one: one[1]))


@pytest.mark.parametrize("forged, code", [(False, 0), (True, 2)])
def test_a_late_bag_is_replayed_from_its_checkpoint_unless_no_robot_made_it(recorded, tmp_path, capsys, forged, code):
    """Forged: each number is beyond every table; a kernel that used it would read foreign memory."""
    begin = 40
    robot = vibro_ros.Simulator(vibro_ros.load_scene("device"))
    for tick, command in TOLD.items():
        if tick < begin:
            robot.advance_to(tick / RATE)
            robot.command(**command)
    robot.advance_to(begin / RATE)
    state = robot.checkpoint()
    if forged:
        state[1:] = 1e9
    assert replay.main([str(late_with(recorded, tmp_path / "late", begin, state))]) == code
    said = capsys.readouterr()
    assert ("no state that this device can be in" in said.err) == forged != said.out.startswith("identical: ")


def test_a_bag_begun_while_the_robot_was_paused_at_its_start_begins_late(tmp_path, capsys):
    """Its first stamp is that of the robot's first sample, which it lacks, as it lacks what was changed before."""
    told = {0: 'set {"ground.friction": 0.1}', 30: {"motor_speed": 90.0}}
    recorded = robot_bag(tmp_path / "bag", "device", TICKS, told, RATE, checkpoints=(1,))
    pushed = f"/{OPERATIONS}", START, holding(TOPICS[OPERATIONS].type,
                                              'push {"duration": 0.0, "force_x": 0.0, "force_z": 0.0}')
    late = rewritten(recorded, tmp_path / "late",
                     lambda messages: [pushed, *without_earlier(1 / RATE)(messages)])
    assert replay.main([str(late)]) == 0
    capsys.readouterr()
    assert replay.main([str(late), "--set", "guide.angle=1.0"]) == 2
    assert "after the robot started" in capsys.readouterr().err


def test_a_late_recording_without_a_checkpoint_cannot_be_replayed(recorded, tmp_path, capsys):
    late = rewritten(recorded, tmp_path / "late", without_earlier(1.0))
    assert replay.main([str(late)]) == 2  # and not 1, different: that cannot be known
    assert "cannot be replayed: it begins 1.000 s after the robot's start and holds no checkpoint" in (
        capsys.readouterr().err)


@pytest.mark.parametrize("custom, code, reason", [
    ({"parameters": "no JSON"}, 2, "cannot be simulated by this version"),
    ({"parameters": '{"ground.wind": 1.0}'}, 2, "ground.wind: unknown parameter"),
    ({"parameters": '{"rate.publish": 1.0, "solver.method": "rk4", "solver.step": 1e-8}'}, 2,
     "solver.step takes 1e+08 steps a sample, more than 1000000"),
    ({"start": "12"}, 2, "cannot be replayed: it begins 1"),
    ({"start": "one"}, 2, "cannot be simulated by this version")])
def test_what_the_bag_says_of_itself_may_be_anything(recorded, tmp_path, capsys, custom, code, reason):
    """With `start` 12 ns after 1970, 56 years of simulation must not be begun."""
    began = time.monotonic()
    assert replay.main([str(rewritten(recorded, tmp_path / "bag2", **custom))]) == code
    said = capsys.readouterr()
    assert reason in said.err and said.err.count("\n") == 1 and time.monotonic() - began < 60.0


@pytest.mark.parametrize("lacks, has", [
    ("ground.stribeck_speed", {}), ("", {"record.storage": "mcap"})], ids=["default", "storage"])
def test_a_bag_of_an_earlier_version_is_understood(recorded, tmp_path, lacks, has):
    """The bag lacks a parameter, which then had its default, or names a parameter that no longer exists."""
    with BagStream(recorded) as stream:
        parameters = json.loads(stream.metadata["parameters"])
    older = {name: value for name, value in parameters.items() if name != lacks} | has
    assert older != parameters
    assert replay.main([str(rewritten(recorded, tmp_path / "older", parameters=json.dumps(older)))]) == 0


def stretched(message):
    """Make robot time run a million times as fast, headers included: 119 of 120 samples are each on another day."""
    topic, stamp, data = message
    stamp = START + (stamp - START) * 1_000_000
    if ROBOT_TOPICS[topic[1:]] in ("nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"):
        message = deserialised(data, ROBOT_TOPICS[topic[1:]])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        data = serialised(message, ROBOT_TOPICS[topic[1:]])
    return topic, stamp, data


def test_a_bag_with_stretched_stamps_is_not_simulated_for_years(recorded, tmp_path, capsys):
    folder = rewritten(recorded, tmp_path / "stretched", edit_each(stretched))
    began = time.process_time()
    assert replay.main([str(folder)]) == 1
    assert "recorded stamp: recorded " in capsys.readouterr().out
    assert replay.main([str(folder), "--set", "guide.angle=1.2"]) == 2
    assert "its messages are of 980 samples at most" in capsys.readouterr().err
    assert time.process_time() - began < 10.0
