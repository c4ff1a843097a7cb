"""The energy of a recording: that of a run with the same commands; unknown for any bag that is not such a run."""

import json
import time

import numpy as np
import pytest
from robot_bag import START, edit_each, edit_topic, holding, rewritten, robot_bag, without_earlier

import vibro_ros
from vibro_ros.bag.reader import load_bag
from vibro_ros.bag.stream import BagStream
from vibro_ros.messages.codec import deserialised, serialised
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, ROBOT_TOPICS, TOPICS
from vibro_ros.recordings import replay
from vibro_ros.recordings.energy import energy_of
from vibro_ros.recordings.summary import energy_as_lines

RATE = 50.0
TICKS = 120
TOLD = {tick: {"motor_speed": 60.0 + tick} for tick in range(10, TICKS, 20)}
COMMANDS = [(tick / RATE, command) for tick, command in TOLD.items()]


@pytest.fixture
def recorded(tmp_path):
    return robot_bag(tmp_path / "bag", "device", TICKS, TOLD, RATE)


def device():
    return vibro_ros.load_scene("device").with_parameters({"solver.accounts": True})


def late_with(recorded, folder, tick, state):
    """Return the recording from a sample on, with a checkpoint there."""
    checkpoint = f"/{CHECKPOINT}", START + round(tick / RATE * 1e9), holding(TOPICS[CHECKPOINT].type, state)
    return rewritten(recorded, folder, lambda all_of_it: sorted([*without_earlier(tick / RATE)(all_of_it), checkpoint],
                                                                key=lambda message: message[1]))


def test_accounts_are_those_of_the_commanded_run(recorded):
    energy = energy_of(load_bag(recorded))
    run = vibro_ros.simulate(device(), times=np.arange(TICKS) / RATE, commands=COMMANDS)
    expected = run.statistics["energy_accounts"]
    assert energy["accounts"] == pytest.approx(expected, rel=1e-12, abs=1e-12)
    net = expected["motor_delivered"] - expected["motor_taken_back"]
    assert energy["duration"] == (TICKS - 1) / RATE
    assert energy["mean_power"] == pytest.approx(net / energy["duration"], rel=1e-12)
    weight = device().total_mass * 9.81
    assert energy["cost_of_transport"] == pytest.approx(net / weight / abs(run.body_position[-1]), rel=1e-12)


def test_accounts_of_a_late_recording_begin_at_its_checkpoint(recorded, tmp_path):
    """The energy is computed from the checkpoint on, although the robot that wrote it keeps no accounts."""
    begin = 40
    robot, accountant = (vibro_ros.Simulator(scene) for scene in (vibro_ros.load_scene("device"), device()))
    for simulator in (robot, accountant):
        for at, command in COMMANDS:
            if at * RATE < begin:
                simulator.advance_to(at)
                simulator.command(**command)
        simulator.advance_to(begin / RATE)
    accounts_before = accountant.statistics["energy_accounts"]
    energy = energy_of(load_bag(late_with(recorded, tmp_path / "late", begin, robot.checkpoint())))
    whole = energy_of(load_bag(recorded))["accounts"]
    assert energy["duration"] == (TICKS - 1 - begin) / RATE
    assert energy["accounts"] == pytest.approx({name: whole[name] - accounts_before[name] for name in whole}, abs=1e-11)


def test_a_checkpoint_that_no_robot_made_is_unknown(recorded, tmp_path):
    """Each number of the checkpoint in turn is beyond every table; a kernel that used it would read foreign memory and
    end the process.
    """
    robot = vibro_ros.Simulator(device())
    robot.advance_to(40 / RATE)
    whole = robot.checkpoint()
    late = late_with(recorded, tmp_path / "late", 40, np.concatenate([whole[:1], np.full(len(whole) - 1, 1e9)]))
    assert "no state that this device can be in" in energy_of(load_bag(late))["unknown"]


def test_a_bag_begun_while_the_robot_was_paused_at_its_start_begins_late(tmp_path, capsys):
    """Its first stamp is that of the robot's first sample, which it lacks, as it lacks what was changed before."""
    told = {0: 'set {"ground.friction": 0.1}', 30: {"motor_speed": 90.0}}
    recorded = robot_bag(tmp_path / "bag", "device", TICKS, told, RATE, checkpoints=(1,))
    pushed = f"/{OPERATIONS}", START, holding(TOPICS[OPERATIONS].type,
                                              'push {"duration": 0.0, "force_x": 0.0, "force_z": 0.0}')
    late = rewritten(recorded, tmp_path / "late",
                     lambda messages: [pushed, *without_earlier(1 / RATE)(messages)])
    assert replay.main([str(late)]) == 0
    assert "unknown" not in energy_of(load_bag(late))
    capsys.readouterr()
    assert replay.main([str(late), "--set", "guide.angle=1.0"]) == 2
    assert "after the robot started" in capsys.readouterr().err


def test_a_late_recording_without_a_checkpoint_is_unknown(recorded, tmp_path, capsys):
    late = rewritten(recorded, tmp_path / "late", without_earlier(1.0))
    assert "without a checkpoint" in energy_of(load_bag(late))["unknown"]
    assert replay.main([str(late)]) == 2  # and not 1, different: that cannot be known
    assert "cannot be replayed: it begins 1.000 s after the robot's start and holds no checkpoint" in (
        capsys.readouterr().err)


def test_a_recording_that_ends_as_it_begins_is_unknown(recorded, tmp_path):
    empty = rewritten(recorded, tmp_path / "empty", lambda messages: [message for message in messages
                                                                      if message[0] != "/odom"])
    assert energy_of(load_bag(empty)) == {"unknown": "no odometry is recorded"}


def test_another_run_than_the_commands_give_is_unknown(recorded, tmp_path):
    """A change of the last odometry by one rounding is enough."""
    def move(odometry):
        odometry.pose.pose.position.x = np.nextafter(odometry.pose.pose.position.x, 1.0)

    last = START + round((TICKS - 1) / RATE * 1e9)
    other = rewritten(recorded, tmp_path / "other", edit_topic("odom", move, lambda stamp: stamp == last))
    assert "is not the recorded one" in energy_of(load_bag(other))["unknown"]


@pytest.mark.parametrize("custom, reason", [
    ({"parameters": json.dumps({"solver.method": "rk4"})}, "recorded with rk4"),
    ({"parameters": "no JSON"}, "cannot be simulated by this version"),
    ({"parameters": '{"ground.wind": 1.0}'}, "ground.wind: unknown parameter"),
    ({"parameters": '{"rate.publish": 1.0, "solver.method": "rk4", "solver.step": 1e-8}'},
     "solver.step takes 1e+08 steps a sample, more than 1000000"),
    ({"start": "12"}, "are not those of the robot's samples"),
    ({"start": "one"}, "cannot be simulated by this version")])
def test_any_custom_data_of_a_bag_is_read_or_refused(recorded, tmp_path, custom, reason):
    """With `start` 12 ns after 1970, 56 years of simulation must not be begun."""
    began = time.monotonic()
    unknown = energy_of(load_bag(rewritten(recorded, tmp_path / "bag2", **custom)))["unknown"]
    assert reason in unknown or "only" in unknown
    assert "\n" not in unknown and time.monotonic() - began < 60.0


@pytest.mark.parametrize("lacks, has", [
    ("ground.stribeck_speed", {}), ("", {"record.storage": "mcap"})], ids=["default", "storage"])
def test_a_bag_of_an_earlier_version_is_read(recorded, tmp_path, lacks, has):
    """The bag lacks a parameter, which then had its default, or names a parameter that no longer exists."""
    with BagStream(recorded) as stream:
        parameters = json.loads(stream.metadata["parameters"])
    older = {name: value for name, value in parameters.items() if name != lacks} | has
    assert older != parameters
    older = rewritten(recorded, tmp_path / "older", parameters=json.dumps(older))
    assert energy_of(load_bag(older)) == energy_of(load_bag(recorded))
    assert replay.main([str(older)]) == 0


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
    assert "only 120 of 119000001 samples" in energy_of(load_bag(folder))["unknown"]
    assert replay.main([str(folder)]) == 1
    assert "recorded stamp: recorded " in capsys.readouterr().out
    assert replay.main([str(folder), "--set", "guide.angle=1.2"]) == 2
    assert "its messages are of 980 samples at most" in capsys.readouterr().err
    assert time.process_time() - began < 10.0


def test_a_bag_of_another_program_is_unknown(record_run):
    assert "says nothing of parameters" in energy_of(load_bag(record_run()))["unknown"]


def test_the_lines_have_every_account(recorded):
    energy = energy_of(load_bag(recorded))
    head, *rows, last = energy_as_lines(energy)
    assert "from the run simulated again" in head and "cost of transport" in last
    names = {" ".join(row.split()[:-3]) for row in rows}
    assert names >= {name.replace("_", " ") for name, amount in energy["accounts"].items() if amount}
