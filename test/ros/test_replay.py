"""A robot's recording computed again, from a real robot commanded over DDS at random instants."""

import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from vibro_ros.bag.definitions import Topic, defined
from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.recovery import recover
from vibro_ros.bag.stream import BagStream
from vibro_ros.bag.writer import BagWriter, Storage
from vibro_ros.recordings import replay
from vibro_ros.ros import playback
from vibro_ros.solver.methods import SCHEMES

SECONDS = 2.0
FASTER = 2.5  # than the clock, so that a recording of 5 s takes 2 s
LONG = 60.0  # the run that the issue is judged by; VIBRO_ROS_LONG_REPLAY=1 makes it
PLAIN = Storage()
LAST_POSITION = -8 * (1 + 1 + 5 + 1 + 5)  # of joint_states: then lengths and numbers of velocity, effort
RANGES = {"motor_speed": (-20.0, 200.0), "upper_gap": (-1e-3, 2e-3), "inclined_gap": (-1e-3, 2e-3)}


def command_at_random(bench, seconds: float, seed: int, topics: dict[str, str]) -> None:
    """Send commands at random instants, some of them within one sample, some refused."""
    chance = random.Random(seed)
    publishers = {name: bench.node.create_publisher(Float64, topics.get(name, name), 10) for name in RANGES}
    bench.spin_until(lambda: all(one.get_subscription_count() for one in publishers.values()), "robot listens")
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for _ in range(chance.choice((1, 1, 3))):
            name = chance.choice(list(RANGES))
            publishers[name].publish(Float64(data=chance.uniform(*RANGES[name])))
        due = time.monotonic() + chance.expovariate(50.0)
        bench.spin_until(lambda due=due: time.monotonic() >= due, "the next command", patience=10.0)


def record(start, bench, folder: Path, *parameters: str, seconds: float = SECONDS, end=signal.SIGINT, names=(),
           topics: dict[str, str] = MappingProxyType({}), then=None) -> Path:
    """The bag of a robot that was commanded at random."""
    words = [word for parameter in (f"record.directory:={folder}", *parameters) for word in ("-p", parameter)]
    robot = start("robot", "--ros-args", *words, *names)
    robot.wait_for("ready")
    command_at_random(bench, seconds, len(parameters), topics)
    if then:
        then(bench)
        command_at_random(bench, seconds, 1 + len(parameters), topics)
    robot.send(end)
    assert robot.end() == (0 if end == signal.SIGINT else -end), robot.text
    (bag,) = folder.glob("vibro_robot_*")
    return bag


@pytest.fixture(scope="module")
def shelf(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("recorded")


@pytest.fixture
def recorded(request, shelf, tmp_path) -> Path:
    """A copy of one recording, which the first test that asks makes."""
    if not list(shelf.glob("vibro_robot_*")):
        record(request.getfixturevalue("start"), request.getfixturevalue("bench"), shelf,
               f"rate.real_time_factor:={FASTER}")
    (bag,) = shelf.glob("vibro_robot_*")
    return Path(shutil.copytree(bag, tmp_path / bag.name))


def rewritten(bag: Path, folder: Path, change=lambda messages: messages, storage: Storage = PLAIN,
              **metadata: str | None) -> Path:
    """The same bag with its list of (topic, stamp, data) changed, stored in another way, or with other custom data."""
    with BagStream(bag) as stream:
        topics = [Topic(name, one.type_name, one.qos_depth) for name, one in stream.topics.items()]
        custom = {key: text for key, text in (stream.metadata | metadata).items() if text is not None}
        writer = BagWriter(folder, defined(topics), custom, storage)
        numbers = {topic.name: number for number, topic in enumerate(topics, start=1)}
        for topic, stamp, data in change(list(stream.messages())):
            writer.write(numbers[topic], stamp, bytes(data))
        writer.flush()
        writer.close({})
    return folder


def test_a_recording_is_simulated_again_to_the_last_bit(recorded, capsys):
    assert replay.main([str(recorded)]) == 0
    bag = read_bag(recorded)
    commands = sum(bag.topics[f"/{name}"].messages for name in RANGES)
    states = sum(one.messages for one in bag.topics.values()) - commands
    assert commands > 50
    assert states > 4 * 200 * SECONDS  # a busy machine may not keep FASTER
    assert len(bag["impacts"]["time"]) > 20
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"identical: {states} messages to ")
    assert line.endswith(f"{commands} commands")


@pytest.mark.skipif(not os.environ.get("VIBRO_ROS_LONG_REPLAY"), reason="a minute; VIBRO_ROS_LONG_REPLAY=1 asks for it")
def test_a_minute_of_random_commands_is_identical(start, bench, tmp_path, capsys):
    assert replay.main([str(record(start, bench, tmp_path, seconds=LONG))]) == 0
    assert capsys.readouterr().out.startswith("identical: ")


@pytest.mark.parametrize("bit", [0, 51, 63])
def test_one_flipped_bit_of_a_state_is_named(recorded, tmp_path, capsys, bit):
    chosen = []

    def flip(messages):
        number = [i for i, (topic, _, _) in enumerate(messages) if topic == "/joint_states"][333]
        topic, stamp, data = messages[number]
        changed = bytearray(data)
        changed[LAST_POSITION + bit // 8] ^= 1 << bit % 8
        chosen.append(stamp)
        return [*messages[:number], (topic, stamp, bytes(changed)), *messages[number + 1:]]

    assert replay.main([str(rewritten(recorded, tmp_path / "flipped", flip))]) == 1
    out = capsys.readouterr().out
    assert "different after " in out
    assert f"first difference: /joint_states message 333 at 1.665 s (stamp {chosen[0]}): " in out
    assert "position[4] (inclined_plate): recorded " in out
    assert (f"({2**bit} ulp)" in out) == (bit < 63)  # the last one is the sign


def test_a_spoilt_stamp_is_named_at_once(recorded, tmp_path, capsys):
    def spoil(messages):
        topic, stamp, data = messages[-1]
        return [*messages[:-1], (topic, stamp + 10**18, data)]  # 32 years later

    assert replay.main([str(rewritten(recorded, tmp_path / "spoilt", spoil))]) == 1
    assert "recorded stamp: recorded " in capsys.readouterr().out


@pytest.mark.parametrize("storage", [PLAIN, Storage("sqlite3")], ids=["mcap", "sqlite3"])
def test_one_flipped_bit_in_the_file_is_caught(recorded, tmp_path, capsys, storage):
    """MCAP's checksums find it before the comparison does: the chunk is named, and the rest compared."""
    folder = rewritten(recorded, tmp_path / "flipped", storage=storage)
    with BagStream(folder) as stream:
        data = [bytes(data) for _, _, data in stream.messages(frozenset({"/odom"}))][321]
    (file,) = folder.glob("flipped_0.*")
    content = bytearray(file.read_bytes())
    assert content.count(data) == 1
    content[content.index(data) + data.index(b"base_link") + 16] ^= 1  # in the position
    file.write_bytes(content)
    code = replay.main([str(folder)])
    captured = capsys.readouterr()
    if storage is PLAIN:
        assert code in (0, 1)  # 1 where the chunk had commands
        assert "\nnot read: flipped_0.mcap: " in captured.out and "another checksum than it says" in captured.out
    else:
        assert code == 1 and "/odom message 321 at 1.605 s" in captured.out and "pose.pose.position." in captured.out


@pytest.mark.parametrize("way", ["dropped", "untold"])
def test_a_message_that_lacks_is_told(recorded, tmp_path, capsys, way):
    def lose(messages):
        (lost,) = [i for i, (topic, _, _) in enumerate(messages) if topic == "/odom"][100:101]
        return messages[:lost] + messages[lost + 1:]

    folder = rewritten(recorded, tmp_path / "lossy", lose, dropped="1" if way == "dropped" else "0")
    assert replay.main([str(folder)]) == (0 if way == "dropped" else 1)
    out = capsys.readouterr().out
    if way == "dropped":
        assert "not recorded: 1 messages" in out
    else:
        assert "/odom message 100 at 0.5 s" in out and "recorded 'no message'" in out


@pytest.mark.parametrize("topic", ["/odom", "/impacts"])
def test_a_message_too_many_is_told(recorded, tmp_path, capsys, topic):
    def add(messages):
        twice = [i for i, (name, _, _) in enumerate(messages) if name == topic][10]
        return messages[:twice] + [messages[twice]] + messages[twice:]

    assert replay.main([str(rewritten(recorded, tmp_path / "more", add))]) == 1
    assert f"{topic} message 11 at " in capsys.readouterr().out


def test_a_lost_command_is_found(recorded, tmp_path, capsys):
    def lose(messages):
        first = [i for i, (topic, _, _) in enumerate(messages) if topic == "/motor_speed"][3]
        return messages[:first] + messages[first + 1:]

    assert replay.main([str(rewritten(recorded, tmp_path / "lossy", lose, dropped="1"))]) == 1
    assert "note: 1 messages dropped; a command may be among them" in capsys.readouterr().out


@pytest.mark.parametrize("storage", [Storage("sqlite3"), Storage("mcap", "zstd", max_size=200_000),
                                     Storage("sqlite3", max_size=400_000)], ids=["sqlite3", "zstd-split", "both"])
def test_the_storage_makes_no_difference(recorded, tmp_path, capsys, storage):
    folder = rewritten(recorded, tmp_path / "stored", storage=storage)
    assert len(list(folder.glob("stored_*"))) > 3 or not storage.max_size
    assert replay.main([str(folder)]) == 0
    again = capsys.readouterr().out
    assert replay.main([str(recorded)]) == 0
    assert again == capsys.readouterr().out


def test_a_killed_robots_bag_is_replayed_as_far_as_it_goes(udp_only, start, bench, tmp_path, capsys):
    """Samples not at whole nanoseconds, three times as fast as the clock, topics renamed, files of half a second."""
    bag = record(start, bench, tmp_path, "rate.publish:=333.0", "rate.real_time_factor:=3.0", "scene:=unilateral",
                 "record.max_duration:=0.5", seconds=1.0, end=signal.SIGKILL,
                 names=("-r", "__ns:=/lab", "-r", "motor_speed:=speed", "-r", "odom:=body/odom"),
                 topics={name: f"/lab/{name.replace('motor_', '')}" for name in RANGES})
    assert len(list(bag.glob("*.mcap"))) > 4
    assert replay.main([str(bag)]) == 2
    assert "not sealed" in capsys.readouterr().err
    recover(bag)
    assert replay.main([str(bag)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("identical: ")
    assert float(out.split(" messages to ")[1].split()[0]) > 2.0  # [s]


def test_other_parameters_are_written_to_a_new_bag(recorded, capsys):
    before = {path.name: path.read_bytes() for path in recorded.iterdir()}
    folders = [recorded.with_name(f"{recorded.name}_replay{suffix}") for suffix in ("", "_2")]
    for folder in folders:
        assert replay.main([str(recorded), "--set", "guide.angle=1.2", "--set", "effects.adhesion=true"]) == 0
        out = capsys.readouterr().out
        assert out.splitlines()[-1] == str(folder)
        assert out.count("mean speed") == 2
    assert {path.name: path.read_bytes() for path in recorded.iterdir()} == before
    first, second = (read_bag(folder) for folder in folders)
    original = read_bag(recorded)
    for name in RANGES:
        for column in ("time", "value"):
            assert original[name][column].tolist() == first[name][column].tolist()
    assert first["odom"]["position"].tolist() == second["odom"]["position"].tolist()
    assert len(first["odom"]["time"]) == len(original["odom"]["time"])
    assert first["odom"]["position"][-1, 0] != original["odom"]["position"][-1, 0]
    assert json.loads(first.metadata["parameters"])["guide.angle"] == 1.2
    assert json.loads(first.metadata["changes"]) == {"guide.angle": 1.2, "effects.adhesion": True}
    assert replay.main([str(folders[0])]) == 0  # a whole bag, which can be replayed itself


def test_what_auto_has_picked_is_recorded(recorded):
    """It measures, and might pick another method the next time."""
    assert replay.main([str(recorded), "--set", "solver.method=auto", "--set", "solver.tolerance=1e-3"]) == 0
    folder = recorded.with_name(f"{recorded.name}_replay")
    assert json.loads(read_bag(folder).metadata["parameters"])["solver.method"] in ("exact", *SCHEMES)
    assert replay.main([str(folder)]) == 0


@pytest.mark.parametrize(("words", "reason"), [
    (["--set", "guide.angel=1.2"], "guide.angel: unknown parameter; did you mean guide.angle?"),
    (["--set", "guide.angle"], "--set guide.angle: not a change; write name=value"),
    (["--set", "guide.angle=steep"], "guide.angle: 'steep' is not a number"),
    (["--set", "rate.publish=100"], "rate.publish=100: is a parameter of the node, which the recording fixes; change"),
    (["--set", "scene=paper"], "scene=paper: is a parameter of the node, which the recording fixes; change"),
    (["--set", "gravity=1.6", "--set", "gravity=2"], "--set gravity=2: gravity is set already, to 1.6; give one"),
    (["--set", "=2"], "--set =2: not a change; write name=value"),
    (["--clock"], "--clock: is for playing the bag to ROS; add --publish, or leave --clock out"),
    (["--rate=2"], "--rate=2: is for playing the bag to ROS; add --publish"),
    (["--set", "gravity=2", "--wait", "3"], "--wait: is for playing the bag to ROS"),
    (["--ros-args", "-r", "a:=b"], "--ros-args: is for playing the bag to ROS"),
    (["--publish", "--set", "gravity=2"], "--set: simulates the run again, and --publish plays what was recorded"),
    (["another"], "unrecognized arguments: another; `replay --help` shows what there is"),
])
def test_a_bad_change_is_refused(recorded, capsys, words, reason):
    assert replay.main([str(recorded), *words]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"replay: {reason}") and captured.err.count("\n") == 1
    assert list(recorded.parent.iterdir()) == [recorded]


def test_a_bag_that_says_nothing_of_its_scene_is_refused(recorded, tmp_path, capsys):
    folder = rewritten(recorded, tmp_path / "foreign", scene=None)
    assert replay.main([str(folder)]) == 2
    assert "says nothing of scene" in capsys.readouterr().err


@pytest.mark.quiet
def test_commands_are_played_to_a_live_robot(recorded, start, tmp_path):
    """At three times the speed, by the installed name's own code: what arrives is what was sent, in order."""
    robot = start("robot", "--ros-args", "-p", "record.directory:=live")
    player = start("playback", str(recorded), "--rate", "3.0")
    assert player.end() == 0, player.text
    robot.send(signal.SIGINT)
    assert robot.end() == 0, robot.text
    (live,) = (tmp_path / "live").iterdir()
    played, original = read_bag(live), read_bag(recorded)
    for name in RANGES:
        assert played[name]["value"].tolist() == original[name]["value"].tolist()
    sent = original["motor_speed"]["time"] / 3.0
    came = played["motor_speed"]["time"]
    # [s] at 3 times the speed; a busy machine may be late, by much less than a replay in real time would be
    assert np.abs((came - came[0]) - (sent - sent[0])).max() < 0.5


def test_all_topics_are_played_with_the_clock_and_a_signal_ends_it(recorded, start, bench):
    heard, clock = [], []
    bench.node.create_subscription(Odometry, "/odom", heard.append, QoSProfile(depth=1000), raw=True)
    bench.node.create_subscription(Clock, "/clock", clock.append, 1000)
    player = start("playback", str(recorded), "--all-topics", "--clock")
    bench.spin_until(lambda: len(heard) > 200 and len(clock) > 200, "a second of it")
    player.send(signal.SIGINT)
    assert player.end() == 130, player.text
    assert "Traceback" not in player.text
    with BagStream(recorded) as stream:
        sent = [bytes(data) for _, _, data in stream.messages(frozenset({"/odom"}))]
        first = sent.index(heard[0])
        assert heard == sent[first:first + len(heard)]
        times = [message.clock.sec * 10**9 + message.clock.nanosec for message in clock]
        assert times == sorted(times)
        assert stream.start <= times[0] < times[-1] <= stream.end


def test_an_abort_stops_the_motor(recorded, start, bench):
    heard = []

    def ignore(message):
        pass

    for name in RANGES:
        bench.node.create_subscription(Float64, name, heard.append if name == "motor_speed" else ignore, 100)
    player = start("playback", str(recorded))
    bench.spin_until(lambda: len(heard) > 3, "some commands")
    player.send(signal.SIGTERM)
    assert player.end() == 143, player.text
    bench.spin_until(lambda: heard[-1].data == 0.0, "the motor's stop")


def test_a_playback_ends_when_the_robot_is_gone(recorded, start, bench):
    heard = []
    listening = [bench.node.create_subscription(Float64, name, heard.append, 100) for name in RANGES]
    player = start("playback", str(recorded), "--rate", "0.2")
    bench.spin_until(lambda: len(heard) > 3, "some commands")
    for subscription in listening:
        bench.node.destroy_subscription(subscription)
    bench.spin_until(lambda: player.ended, "the end")
    assert player.end() == 1
    assert "the robot is gone: nobody listens to" in player.lines[-1]


@pytest.mark.parametrize(("words", "reason"), [
    (["--rate", "0"], "argument --rate: 0 is not above 0"),
    (["--rate", "fast"], "argument --rate: fast is not a number; give one above 0"),
    (["--all-topics", "--wait", "2"], "--wait 2: --all-topics waits for nobody; leave one of the two out"),
    (["--nonsense"], "unrecognized arguments: --nonsense; `replay --publish --help` shows what there is"),
    (["--ros-args", "-p", "speed"], "-p speed: not a parameter"),
])
def test_bad_arguments_of_a_playback_are_refused(recorded, words, reason):
    with pytest.raises(ValueError, match=re.escape(reason)):
        playback._run([str(recorded), *words])


def test_the_executable_plays_with_publish(recorded, domain_id):
    command = [sys.executable, "-m", "vibro_ros.recordings.replay", str(recorded), "--publish", "--wait", "0.2"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "replay: no robot listens to /motor_speed" in done.stderr


def switch_on(bench) -> None:
    """Call ~/record with true."""
    client = bench.node.create_client(SetBool, "/vibro_robot/record")
    bench.spin_until(client.service_is_ready, "~/record")
    future = client.call_async(SetBool.Request(data=True))
    bench.spin_until(future.done, "answer of ~/record")
    assert future.result().success, future.result().message


LATE = {"begun late": ("record.enabled:=false",), "snapshot": ("record.snapshot:=0.8",),
        "beginning deleted": ("record.max_bytes:=2e6", "rate.publish:=500.0")}


@pytest.mark.parametrize("name", LATE)
def test_a_bag_without_the_runs_beginning_is_replayed(start, bench, tmp_path, capsys, name):
    def wait_for_deletion(bench):
        (folder,) = tmp_path.glob("vibro_robot_*")
        bench.spin_until(lambda: not (folder / f"{folder.name}_0.mcap").exists(), "deletion of the first file")

    then = wait_for_deletion if name == "beginning deleted" else switch_on
    bag = record(start, bench, tmp_path, *LATE[name], f"rate.real_time_factor:={FASTER}", seconds=0.5, then=then)
    with BagStream(bag) as stream:
        assert stream.start - int(stream.metadata["start"]) > 0
        assert stream.topics["/vibro_robot/checkpoint"].messages > 0
    assert replay.main([str(bag)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("identical: ") and "not recorded" not in out
    assert int(out.split()[1]) > 100  # messages
    assert int(out.split()[-2]) > 0  # commands
    assert replay.main([str(bag), "--set", "guide.angle=1.0"]) == 2
    assert "after the robot started" in capsys.readouterr().err
