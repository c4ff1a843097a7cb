"""A replay computes a recording again to the last bit, and finds any changed bit, stamp, message or command."""

import json
import signal

import pytest
from random_run import RANGES, SECONDS, record_run
from robot_bag import rewritten

from vibro_ros.bag.reader import read_bag
from vibro_ros.bag.recorder import Storage
from vibro_ros.recordings import replay
from vibro_ros.recordings.recover import recover


def test_a_recording_is_simulated_again_to_the_last_bit(recorded, capsys):
    assert replay.main([str(recorded)]) == 0
    bag = read_bag(recorded)
    commands = sum(bag.topics[f"/{name}"].messages for name in RANGES)
    states = sum(topic.messages for topic in bag.topics.values()) - commands
    assert commands > 50
    assert states > 4 * 200 * SECONDS  # a busy machine may not keep FASTER
    assert len(bag["impacts"]["time"]) > 20
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith(f"identical: {states} messages to ")
    assert line.endswith(f"{commands} commands")


def test_the_storage_makes_no_difference(recorded, tmp_path, capsys):
    folder = rewritten(recorded, tmp_path / "stored", storage=Storage("zstd", max_size=200_000))
    assert len(list(folder.glob("stored_*"))) >= 3
    assert replay.main([str(folder)]) == 0
    again = capsys.readouterr().out
    assert replay.main([str(recorded)]) == 0
    assert again == capsys.readouterr().out


def test_a_killed_robots_bag_is_replayed_as_far_as_it_goes(udp_only, start, bench, tmp_path, capsys):
    """Sample times that are no whole nanoseconds, three times real time, remapped topics, and files of half a second.
    """
    bag = record_run(start, bench, tmp_path, "rate.publish:=333.0", "rate.real_time_factor:=3.0", "scene:=unilateral",
                     "record.max_duration:=0.5", seconds=1.0, end=signal.SIGKILL,
                     names=("-r", "__ns:=/lab", "-r", "motor_speed:=speed", "-r", "odom:=body/odom"),
                     topics={name: f"/lab/{name.replace('motor_', '')}" for name in RANGES})
    assert len(list(bag.glob("*.mcap"))) > 4
    assert replay.main([str(bag)]) == 0  # at once
    line_before, _, rest = capsys.readouterr().out.partition("\n")
    assert "it is not sealed, because its recorder still runs or was killed" in rest
    recover(bag)
    assert replay.main([str(bag)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("identical: ") and out.startswith(line_before)
    assert float(out.split(" messages to ")[1].split()[0]) > 2.0  # [s]
    assert {"/lab/speed", "/lab/body/odom", "/lab/vibro_robot/operations", "/lab/robot_description", "/tf"} <= {
        *read_bag(bag).topics}


def test_other_parameters_are_written_to_a_new_bag(recorded, capsys):
    files_before = {path.name: path.read_bytes() for path in recorded.iterdir()}
    folders = [recorded.with_name(f"{recorded.name}_replay{suffix}") for suffix in ("", "_2")]
    for folder in folders:
        assert replay.main([str(recorded), "--set", "guide.angle=1.2", "--set", "effects.adhesion=true"]) == 0
        out = capsys.readouterr().out
        assert out.splitlines()[-1] == str(folder)
        assert out.count("mean speed") == 1  # one table: recorded, replayed, difference
    assert {path.name: path.read_bytes() for path in recorded.iterdir()} == files_before
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


@pytest.mark.parametrize(("words", "reason"), [
    (["--set", "guide.angel=1.2"], "guide.angel: unknown parameter; did you mean guide.angle?"),
    (["--set", "guide.angle=steep"], "guide.angle: 'steep' is not a number"),
    (["--set", "rate.publish=100"], "rate.publish=100: is a parameter of the node, which the recording fixes; change"),
    (["--set", "gravity=1.6", "--set", "gravity=2"], "--set gravity=2: gravity is given twice; keep one"),
    (["--set", "=2"], "--set =2: give NAME=VALUE"),
    (["--publish"], "unrecognized arguments: --publish; `replay --help` shows what there is"),
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


LAST_POSITION = -8 * (1 + 1 + 5 + 1 + 5)  # of joint_states: then lengths and numbers of velocity, effort


def flipped(bit: int):
    """Flip one bit of the last position in message 333 of joint_states."""
    def change(messages: list) -> list:
        number = place(messages, "/joint_states", 333)
        topic, stamp, data = messages[number]
        changed = bytearray(data)
        changed[LAST_POSITION + bit // 8] ^= 1 << bit % 8
        return [*messages[:number], (topic, stamp, bytes(changed)), *messages[number + 1:]]
    return change


def copies(topic: str, number: int, count: int):
    """Put several copies of a message in its place."""
    def change(messages: list) -> list:
        at = place(messages, topic, number)
        return messages[:at] + [messages[at]] * count + messages[at + 1:]
    return change


def place(messages: list, topic: str, number: int) -> int:
    return [i for i, (name, _, _) in enumerate(messages) if name == topic][number]


def late(messages: list) -> list:
    topic, stamp, data = messages[-1]
    return [*messages[:-1], (topic, stamp + 10**18, data)]  # 32 years


CHANGES = {  # a change, how many messages the bag says were dropped, the exit code, and what is said
    "lowest bit": (flipped(0), 0, 1, ["first difference: /joint_states message 333 at 1.665 s (stamp ", "(1 ulp)",
                                      "position[4] (inclined_plate): recorded "]),
    "sign": (flipped(63), 0, 1, ["/joint_states message 333 at 1.665 s", "position[4] (inclined_plate): recorded "]),
    "stamp": (late, 0, 1, ["recorded stamp: recorded "]),
    "dropped": (copies("/odom", 100, 0), 1, 0, ["not recorded: 1 messages"]),
    "lost": (copies("/odom", 100, 0), 0, 1, ["/odom message 100 at 0.5 s", "recorded 'no message'"]),
    "doubled": (copies("/impacts", 10, 2), 0, 1, ["/impacts message 11 at "]),
    "lost command": (copies("/motor_speed", 3, 0), 1, 1, ["note: 1 messages dropped; a command may be among them"]),
}


@pytest.mark.parametrize("change, dropped, code, words", CHANGES.values(), ids=CHANGES)
def test_what_was_changed_is_named(recorded, tmp_path, capsys, change, dropped, code, words):
    assert replay.main([str(rewritten(recorded, tmp_path / "changed", change, dropped=str(dropped)))]) == code
    out = capsys.readouterr().out
    assert not [text for text in words if text not in out], out
