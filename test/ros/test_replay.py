"""A replay repeats a recording to the last bit, from any checkpoint, and finds each changed message or command."""

import json
import random
import signal
import time
from collections import Counter
from pathlib import Path

import pytest
from asking import known_client
from observation import bags
from random_run import FASTER, RANGES, SECONDS, SENSORS, record_run
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from robot_bag import rewritten
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool, Trigger
from test_operations import operations_in

from vibro_ros.bag.reader import load_bag, read_bag
from vibro_ros.bag.recorder import Storage
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings import replay
from vibro_ros.recordings.comparison import compare
from vibro_ros.recordings.energy import energy_of
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


def test_a_killed_robots_bag_is_replayed_to_its_end(udp_only, start, bench, tmp_path, capsys):
    """At three times real time: files of half a second, remapped topics, times between whole nanoseconds."""
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


def flip_bit(bit: int):
    """Return a change of messages: one bit of the last position in message 333 of joint_states is flipped."""
    def change(messages: list) -> list:
        number = index_of(messages, "/joint_states", 333)
        topic, stamp, data = messages[number]
        changed = bytearray(data)
        changed[LAST_POSITION + bit // 8] ^= 1 << bit % 8
        return [*messages[:number], (topic, stamp, bytes(changed)), *messages[number + 1:]]
    return change


def repeat_message(topic: str, number: int, count: int):
    """Return a change of messages: `count` copies replace a message; with 0 it is lost."""
    def change(messages: list) -> list:
        at = index_of(messages, topic, number)
        return messages[:at] + [messages[at]] * count + messages[at + 1:]
    return change


def index_of(messages: list, topic: str, number: int) -> int:
    """Return the index of message `number` of a topic."""
    return [i for i, (name, _, _) in enumerate(messages) if name == topic][number]


def delay_last_message(messages: list) -> list:
    topic, stamp, data = messages[-1]
    return [*messages[:-1], (topic, stamp + 10**18, data)]  # 32 years


CHANGES = {  # a change, how many messages the bag says were dropped, the exit code, and what is said
    "lowest bit": (flip_bit(0), 0, 1, ["first difference: /joint_states message 333 at 1.665 s (stamp ", "(1 ulp)",
                                       "position[4] (inclined_plate): recorded "]),
    "sign": (flip_bit(63), 0, 1, ["/joint_states message 333 at 1.665 s", "position[4] (inclined_plate): recorded "]),
    "stamp": (delay_last_message, 0, 1, ["recorded stamp: recorded "]),
    "dropped": (repeat_message("/odom", 100, 0), 1, 0, ["not recorded: 1 messages"]),
    "lost": (repeat_message("/odom", 100, 0), 0, 1, ["/odom message 100 at 0.5 s", "recorded 'no message'"]),
    "doubled": (repeat_message("/impacts", 10, 2), 0, 1, ["/impacts message 11 at "]),
    "lost command": (repeat_message("/motor_speed", 3, 0), 1, 1,
                     ["note: 1 messages dropped; a command may be among them"]),
}


@pytest.mark.parametrize("change, dropped, code, words", CHANGES.values(), ids=CHANGES)
def test_the_changed_message_is_named(recorded, tmp_path, capsys, change, dropped, code, words):
    assert replay.main([str(rewritten(recorded, tmp_path / "changed", change, dropped=str(dropped)))]) == code
    out = capsys.readouterr().out
    assert not [text for text in words if text not in out], out


LIVE = {"ground.friction": (0.0, 0.4), "ground.friction_backward": (-1.0, 0.4), "motor.max_speed": (100.0, 600.0),
        "motor.acceleration": (50.0, 2000.0), "motor.time_constant": (0.01, 0.5), "gap_actuator.speed": (0.001, 0.05),
        "motor.supply_voltage": (20.0, 48.0), "motor.current_limit": (1.0, 20.0), "motor.integral_gain": (0.0, 2.0),
        "rate.real_time_factor": (0.5 * FASTER, 2.0 * FASTER)}
FAULTS = (("motor_stall", "", (0.0, 0.0)), ("plate_stuck", "upper", (0.0, 0.0)),
          ("plate_stuck", "inclined", (0.0, 0.0)), ("friction_patch", "", (0.0, 0.4)),
          ("supply_sag", "", (5.0, 20.0)), ("late_commands", "", (0.01, 0.1)), ("lost_commands", "", (0.0, 0.0)),
          ("sensor_dropout", "tracking", (0.0, 0.0)), ("sensor_freeze", "encoder", (0.0, 0.0)),
          ("sensor_offset", "imu", (-1.0, 1.0)))


class BagFrom(BagStream):
    """A bag without the messages before a stamp [ns]."""

    def __init__(self, path: Path, start: int):
        super().__init__(path)
        self.start = max(start, self.start)

    def messages(self, topics: frozenset[str] | None = None):
        return (message for message in super().messages(topics) if message[1] >= self.start)


def starts_of(bag: Path) -> list[int]:
    """Return the stamp [ns] of the bag's first message, and of each checkpoint."""
    with BagStream(bag) as stream:
        checkpoints = stream.messages(frozenset(["/vibro_robot/checkpoint"]))
        return sorted({stream.start, *(stamp for _, stamp, _ in checkpoints)})


def random_parameters(chance: random.Random) -> list[str]:
    """Return the parameters of a robot as words of its command line."""
    words = [f"scene:={chance.choice(('device', 'machine', 'unilateral', 'damped'))}", "motor.speed:=90.0",
             f"rate.real_time_factor:={FASTER}", f"rate.publish:={chance.choice((100.0, 200.0, 333.0))}",
             f"record.enabled:={str(chance.random() < 0.5).lower()}",
             f"rate.start_paused:={str(chance.random() < 0.2).lower()}"]
    words += chance.choice(([], ["record.max_bytes:=1e6"], ["record.max_duration:=0.7"], ["record.max_size:=3e5"],
                            ["record.max_bytes:=2e6", "record.compression:=zstd"]))
    words += chance.choice(([], [], ["command.timeout:=0.2"])) + chance.choice(([], ["effects.motor:=lag"], [*SENSORS]))
    return [word for parameter in words for word in ("-p", parameter)]


def actions_on(bench, chance: random.Random) -> list:
    """Return functions that each command the robot, or request something of it without waiting for the answer."""
    types = pytest.importorskip("vibro_ros_interfaces.srv", reason="the project's own types are not built")
    pause, record, reset, step, parameters, state, push, fault = (known_client(bench, kind, name) for kind, name in (
        (SetBool, "pause"), (SetBool, "record"), (Trigger, "reset"), (Trigger, "step"),
        (SetParameters, "set_parameters"), (types.SetState, "set_state"), (types.Push, "push"),
        (types.InjectFault, "inject_fault")))
    publishers = bench.publishers(dict.fromkeys(RANGES, Float64))

    def command():
        name = chance.choice(list(RANGES))
        publishers[name].publish(Float64(data=chance.uniform(*RANGES[name])))

    def change():
        names = chance.sample(list(LIVE), chance.choice((1, 1, 2)))
        values = {name: 0.0 if name == "ground.friction" and chance.random() < 0.2 else chance.uniform(*LIVE[name])
                  for name in names}
        return parameters.call_async(SetParameters.Request(parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]))

    def fail():
        name, of, values = chance.choice(FAULTS)
        span = {"from_x": -0.01, "to_x": 0.01} if name == "friction_patch" else {}
        return fault.call_async(types.InjectFault.Request(fault=name, of=of, value=chance.uniform(*values),
                                                          duration=chance.uniform(0.01, 0.5), **span))

    return [
        command, command, command, change, change, change, fail,
        lambda: record.call_async(SetBool.Request(data=chance.random() < 0.6)),
        lambda: record.call_async(SetBool.Request(data=chance.random() < 0.6)),
        lambda: reset.call_async(Trigger.Request()), lambda: step.call_async(Trigger.Request()),
        lambda: pause.call_async(SetBool.Request(data=chance.random() < 0.3)),
        lambda: state.call_async(types.SetState.Request(names=["body_velocity"], values=[chance.uniform(-0.1, 0.1)])),
        lambda: push.call_async(types.Push.Request(duration=chance.uniform(0.001, 0.3),
                                                   force_x=chance.uniform(-3.0, 3.0)))]


def record_at_random(start, bench, folder: Path, seed: int, seconds: float) -> tuple[list[Path], Counter]:
    """Return the bags of a robot with random parameters that is treated at random, and the operations that it did."""
    chance, done, answers = random.Random(seed), [], []
    bench.node.create_subscription(String, "/vibro_robot/operations", lambda message: done.append(message.data),
                                   QoSProfile(depth=1000))
    robot = start("robot", "--ros-args", "-p", f"record.directory:={folder}", *random_parameters(chance))
    robot.wait_for("ready")
    actions = actions_on(bench, chance)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        answers.append(chance.choice(actions)())
        due = time.monotonic() + chance.expovariate(40.0)
        bench.spin_until(lambda due=due: time.monotonic() >= due, "the next", patience=10.0)
    bench.spin_until(lambda: all(answer.done() for answer in answers if answer), "answers")
    robot.send(signal.SIGINT)
    assert robot.end() == 0, robot.text
    return bags(folder), Counter(done)


def differences_in(bag: Path) -> tuple[int, list[str]]:
    """Replay a bag from up to eight of its beginnings; return from how many, and the differences in words."""
    starts, differences = starts_of(bag), []
    starts = starts[::1 + len(starts) // 8]
    for stamp in starts:
        with BagFrom(bag, stamp) as stream:
            if difference := compare(stream).difference:
                differences.append(f"{bag.name} from {stamp}: {difference}")
    return len(starts), differences


@pytest.mark.parametrize("seed", range(2))
def test_every_bag_of_a_random_run_replays_from_its_checkpoints(start, bench, tmp_path, seed):
    recorded, done = record_at_random(start, bench, tmp_path, seed, 3.0)
    replayed = [differences_in(bag) for bag in recorded]
    assert not [difference for _, differences in replayed for difference in differences]
    assert sum(count for count, _ in replayed) > len(recorded)
    for bag in recorded:
        assert Counter(operations_in(bag)) <= done  # none that nobody asked for
        energy = energy_of(load_bag(bag))
        assert "unknown" not in energy or energy["unknown"].startswith("no odometry"), energy
