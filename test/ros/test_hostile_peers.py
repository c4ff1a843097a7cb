"""A live robot and peers that send unexpected messages: the robot runs on, answers and counts, and its bag has what
arrived.
"""

import array
import math
import os
import random
import struct
from pathlib import Path

import pytest
from asking import answer_of
from observation import bags, stop, value_of
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.qos import QoSProfile, ReliabilityPolicy
from recorded_bag import by_rosbags
from std_msgs.msg import Float32, Float64

import vibro_ros
from vibro_ros.messages.codec import deserialised

COMMANDS = ("motor_speed", "upper_gap", "inclined_gap")
ROUNDS = 20_000 if "VIBRO_ROS_HOSTILE" in os.environ else 300
LITTLE, BIG = b"\0\1\0\0", b"\0\0\0\0"
GOOD = {
    "little endian": LITTLE + struct.pack("<d", 50.0),
    "big endian": BIG + struct.pack(">d", 51.0),
    "options": b"\0\1\0\3" + struct.pack("<d", 52.0),
}
MALFORMED = {
    "one byte": b"\0",
    "header only": LITTLE,
    "unknown header": b"\xff" * 12,
    "four data bytes": LITTLE + bytes(4),
    "eight bytes without header": struct.pack("<d", 50.0),
    "parameter list": b"\0\3\0\0" + struct.pack("<d", 50.0),
    "XCDR2": b"\0\7\0\0" + struct.pack("<d", 50.0),
}
VALUES = (0.0, -0.0, 5e-324, 2.2250738585072014e-308, 1e-300, 500.0, 500.0000000001, -1e-300, 1e300,
          1.7976931348623157e308, math.inf, -math.inf, math.nan, 0.06, -0.06, 0.0600001)


class Attacker:
    """Publishes any bytes on the robot's command topics."""

    def __init__(self, bench):
        self.bench = bench
        self._publishers = {name: bench.node.create_publisher(Float64, name, 10) for name in COMMANDS}

    def wait_for_robot(self) -> None:
        self.bench.spin_until(lambda: all(one.get_subscription_count() for one in self._publishers.values()), "robot")

    def publish(self, name: str, data: bytes) -> None:
        self._publishers[name].publish(data)


@pytest.fixture
def attacker(bench):
    return Attacker(bench)


def padded(data: bytes) -> bytes:
    """Return `data` as it arrives: DDS pads it with zeros to a multiple of 4 bytes."""
    return data + bytes(-len(data) % 4)


def recorded(folder: Path) -> list[tuple[str, bytes]]:
    """Return the messages of the commands' topics in the bag, in order."""
    return [(topic[1:], data) for topic, _, data in by_rosbags(folder) if topic[1:] in COMMANDS]


def any_command(chance: random.Random) -> bytes:
    """Bytes of any kind and length that a publisher of Float64 can send, and doubles of every kind.

    An empty message does not arrive, nor does anything that the same publisher sends after it.
    """
    kind = chance.random()
    if kind < 0.3:
        return chance.randbytes(chance.randrange(1, 13))
    if kind < 0.6:
        return LITTLE + chance.randbytes(8)
    if kind < 0.7:
        return BIG + chance.randbytes(8)
    if kind < 0.8:
        return LITTLE + struct.pack("<d", chance.choice(VALUES))
    return LITTLE + struct.pack("<d", chance.choice((chance.uniform(-10.0, 510.0), chance.uniform(-0.07, 0.07))))


def test_messages_that_are_no_command_and_thousands_at_random_are_refused_counted_said_and_recorded(
        start, attacker, listener, bench, tmp_path):
    """What is refused is what an offline device refuses of the recorded messages; what was dropped is not recorded.

    With VIBRO_ROS_HOSTILE in the environment there are a hundred thousand of them, which takes some minutes.
    """
    chance = random.Random(12)
    robot = start("robot", "--ros-args", "-p", "rate.publish:=100.0", "-p", "motor.acceleration:=1000000.0")
    attacker.wait_for_robot()
    for count, data in enumerate(MALFORMED.values(), start=1):
        attacker.publish("motor_speed", data)
        _, values = listener.wait_for_status(
            "simulation", lambda status, count=count: value_of(status, "rejected commands") == count)
    for data in GOOD.values():
        attacker.publish("motor_speed", data)
        listener.spin_for_samples(1)
    assert values["refused requests"] == values["failed callbacks"] == "0"
    assert "Warning" not in robot.text  # of Python or numpy
    assert robot.wait_for("command refused: /motor_speed: a message of 4 bytes is no std_msgs/msg/Float64")
    for _ in range(ROUNDS):
        for _ in range(5):
            attacker.publish(chance.choice(COMMANDS), any_command(chance))
        listener.spin_for_samples(1)
    attacker.publish("motor_speed", LITTLE + struct.pack("<d", 33.0))
    robot_state = {}
    bench.node.create_subscription(Float64, "motor_power", lambda message: robot_state.update(power=message.data), 10)
    listener.spin_for_samples(30)
    stop(robot)
    messages = recorded(bags(tmp_path)[0])
    sent = [("motor_speed", padded(data)) for data in (*MALFORMED.values(), *GOOD.values())]
    assert messages[:len(sent)] == sent
    assert len(messages) > 500  # DDS keeps the last ten of each topic
    assert messages[-1] == ("motor_speed", LITTLE + struct.pack("<d", 33.0))
    device, refused = vibro_ros.Simulator(vibro_ros.load_scene("device")), 0
    for name, data in messages:
        try:
            device.command(**{name: deserialised(data, "std_msgs/msg/Float64").data})
        except ValueError:
            refused += 1
    assert f"{refused} commands refused" in robot.lines[-1]
    assert math.isfinite(robot_state["power"])


@pytest.fixture
def ask(bench):
    """Call one of the robot's services; an answer must come."""
    return lambda kind, name, **fields: answer_of(bench, kind, f"/vibro_robot/{name}", **fields)


def wanted(name: str, kind: int, **value) -> Parameter:
    return Parameter(name=name, value=ParameterValue(type=kind, **value))


FIXED = "read-only while the node runs"
HOSTILE_PARAMETERS = {
    "type that does not exist": (wanted("mass.body", 250), "mass.body: type 250 does not exist"),
    "simulated time": (wanted("use_sim_time", ParameterType.PARAMETER_BOOL, bool_value=True),
                       f"use_sim_time: {FIXED}; start it with -p use_sim_time:=VALUE"),
    "control characters": (wanted("a\x1b[31m\nb", 250), r"a\x1b[31m b: unknown parameter"),
    "long name": (wanted("a" * 100_000, 250), "a name of 100000 characters; give at most 1000"),
    "live, not finite": (wanted("motor.acceleration", ParameterType.PARAMETER_DOUBLE, double_value=float("nan")),
                         "motor.acceleration: nan is not finite"),
    "live, so small that its inverse overflows": (
        wanted("rate.real_time_factor", ParameterType.PARAMETER_DOUBLE, double_value=5e-324),
        "rate.real_time_factor: 4.94066e-324 is out of range; give a number, 0 or from 1e-06 to 1000"),
    "long list": (wanted("record.topics", ParameterType.PARAMETER_DOUBLE_ARRAY,
                         double_array_value=array.array("d", [1.0]) * 100_000), FIXED),
}


def test_every_parameter_request_is_answered_and_changes_nothing_and_peers_of_another_type_are_named(
        start, bench, ask, listener):
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false")
    robot.wait_for("ready")
    before = ask(GetParameters, "get_parameters", names=["mass.body", "use_sim_time", "scene"]).values
    for parameter, reason in HOSTILE_PARAMETERS.values():
        answers = [*ask(SetParameters, "set_parameters", parameters=[parameter]).results,
                   ask(SetParametersAtomically, "set_parameters_atomically", parameters=[parameter]).result]
        for answer in answers:
            assert not answer.successful
            assert reason in answer.reason and "\n" not in answer.reason
    several = [one for one, _ in HOSTILE_PARAMETERS.values() if len(one.name) < 1000]
    answers = ask(SetParameters, "set_parameters", parameters=several).results
    assert [answer.successful for answer in answers] == [False] * len(several)
    answers = ask(SetParameters, "set_parameters", parameters=several * 200).results
    assert {answer.reason for answer in answers} == {f"{len(several) * 200} names in one request; give at most 1000"}
    for names in (["mass.boddy"], [""], ["a" * 100_000], ["mass.body"] * 10_000, []):
        assert not ask(GetParameters, "get_parameters", names=names).values
        assert not ask(DescribeParameters, "describe_parameters", names=names).descriptors
        assert not ask(GetParameterTypes, "get_parameter_types", names=names).types
        assert not ask(ListParameters, "list_parameters", prefixes=names, depth=2**64 - 1).result.names or not names
    assert ask(GetParameters, "get_parameters", names=["mass.body", "use_sim_time", "scene"]).values == before
    listener.wait_for_status("simulation", lambda status: value_of(status, "refused requests") >= 24.0)
    bench.node.create_publisher(Float32, "motor_speed", 10)
    assert "[WARN]" in robot.wait_for("/motor_speed: /bench publishes std_msgs/msg/Float32, which cannot arrive; "
                                      "publish std_msgs/msg/Float64")
    bench.node.create_publisher(Float64, "upper_gap", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    assert "[WARN]" in robot.wait_for(
        "/upper_gap: /bench publishes best effort, which cannot arrive; let it publish reliably, or start the robot "
        "with -p qos_overrides./upper_gap.subscription.reliability:=best_effort")
    stop(robot)
    assert all(line.startswith("[") for line in robot.lines)
