"""A live robot and peers that send unexpected messages: the robot runs on, answers and counts, and its bag has what
arrived.
"""

import array
import math
import os
import random
import signal
import struct
from pathlib import Path

import pytest
from asking import wait_until_known
from nav_msgs.msg import Odometry
from observation import bags, check_end, stop, value_of
from random_requests import UNTOUCHED, random_request, service_class
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters, SetParametersAtomically
from rclpy.qos import QoSProfile, ReliabilityPolicy
from recorded_bag import by_rosbags
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32, Float64
from std_srvs.srv import SetBool

import vibro_ros
from vibro_ros.messages.codec import deserialised
from vibro_ros.ros.node.node import LONGEST_NAME, SENTENCES
from vibro_ros.ros.node.refusals import LONGEST_SENTENCE

COMMANDS = ("motor_speed", "upper_gap", "inclined_gap")
ROUNDS, ROUNDS_OF_REQUESTS = (20_000, 4000) if "VIBRO_ROS_HOSTILE" in os.environ else (300, 40)
"""How often random commands and requests are sent; the larger numbers take some minutes."""
AT_ONCE = 25
"""Requests that wait together: fewer than a service of another node may queue."""
DEEP = QoSProfile(depth=100)
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


def test_invalid_and_random_commands_are_refused_counted_logged_and_recorded(
        start, listener, bench, tmp_path):
    """What is refused is what an offline device refuses of the recorded messages; what was dropped is not recorded.
    """
    chance = random.Random(12)
    robot = start("robot", "--ros-args", "-p", "rate.publish:=100.0", "-p", "motor.acceleration:=1000000.0")
    publishers = bench.publishers(dict.fromkeys(COMMANDS, Float64))
    for count, data in enumerate(MALFORMED.values(), start=1):
        publishers["motor_speed"].publish(data)
        _, values = listener.wait_for_status(
            "simulation", lambda status, count=count: value_of(status, "rejected commands") == count)
    for data in GOOD.values():
        publishers["motor_speed"].publish(data)
        listener.spin_for_samples(1)
    assert values["refused requests"] == values["failed callbacks"] == "0"
    assert "Warning" not in robot.text  # of Python or numpy
    assert robot.wait_for("command refused: /motor_speed: a message of 4 bytes is no std_msgs/msg/Float64")
    for _ in range(ROUNDS):
        for _ in range(5):
            publishers[chance.choice(COMMANDS)].publish(any_command(chance))
        listener.spin_for_samples(1)
    publishers["motor_speed"].publish(LITTLE + struct.pack("<d", 33.0))
    robot_state = {}
    bench.node.create_subscription(Float64, "motor_power", lambda message: robot_state.update(power=message.data), 10)
    listener.spin_for_samples(30)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):  # of an impatient user
        robot.send(number)
    check_end(robot)
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


@pytest.fixture
def clients(bench):
    """Return a client of each of the robot's services by name, without those of actions and that of rcl itself."""
    def robots() -> list:
        services = bench.node.get_service_names_and_types()
        return [(name, kind) for name, (kind,) in services if name.startswith("/vibro_robot/")
                and "/_action/" not in name and not name.endswith("/get_type_description")]

    bench.spin_until(lambda: len(robots()) > 8, "the robot's services")
    made = {name: bench.node.create_client(service_class(kind), name, qos_profile=DEEP) for name, kind in robots()}
    bench.spin_until(lambda: all(client.service_is_ready() for client in made.values()), "services ready")
    wait_until_known(bench)
    return made


def refused(request, response) -> bool:
    """Whether an answer is a refusal; services that read parameters cannot refuse and return nothing."""
    if any(len(name) > LONGEST_NAME for field in ("names", "prefixes") for name in getattr(request, field, ())):
        return True
    if isinstance(response, SetParameters.Response):
        return not all(result.successful for result in response.results)
    if isinstance(response, SetParametersAtomically.Response):
        return not response.result.successful
    if hasattr(response, "success"):  # of std_srvs and of the project's own
        return not response.success
    return bool(getattr(getattr(response, "result", None), "error_message", ""))  # of simulation_interfaces


def test_every_hostile_request_is_answered_and_every_sample_is_finite(start, bench, request, listener):
    """Known requests that are refused in known words come first, then random ones to every service."""
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0")
    robot.wait_for("ready")
    clients, chance = request.getfixturevalue("clients"), random.Random(7)
    latest: dict[str, list[float]] = {}
    bench.node.create_subscription(Odometry, "odom", lambda message: latest.update(
        body=[message.pose.pose.position.x, message.pose.pose.position.z, message.twist.twist.linear.x]), 10)
    bench.node.create_subscription(JointState, "joint_states", lambda message: latest.update(
        joints=[*message.position, *message.velocity, *message.effort]), 10)
    refusals = 0
    for parameters, reason in (*(([parameter], reason) for parameter, reason in HOSTILE_PARAMETERS.values()),
                               ([HOSTILE_PARAMETERS["simulated time"][0]] * 1200, "1200 names in one request; give")):
        several, atomic = ask(bench, [(clients[f"/vibro_robot/{name}"], kind.Request(parameters=parameters))
                                   for name, kind in (("set_parameters", SetParameters),
                                                      ("set_parameters_atomically", SetParametersAtomically))])
        refusals += 2
        for answer in (*several.results, atomic.result):
            assert not answer.successful and reason in answer.reason and "\n" not in answer.reason
    answer = ask(bench, [(clients["/vibro_robot/list_parameters"], ListParameters.Request())])[0]
    names = [name for name in answer.result.names if name not in UNTOUCHED]
    for _ in range(ROUNDS_OF_REQUESTS):
        asked = [(client, random_request(client.srv_type, names, chance))
                 for client in chance.choices([*clients.values()], k=AT_ONCE)]
        for (_, asked_for), response in zip(asked, ask(bench, asked), strict=True):
            refusals += refused(asked_for, response)
            assert all(text.isprintable() and len(text) <= LONGEST_SENTENCE for text in sentences(response)), response
    assert refusals > ROUNDS_OF_REQUESTS
    ask(bench, [(clients["/vibro_robot/pause"], SetBool.Request(data=False))])
    status, values = listener.wait_for_status(
        "simulation", lambda status: value_of(status, "refused requests") >= refusals)
    assert (values["refused requests"], values["failed callbacks"]) == (str(refusals), "0"), robot.text
    latest.clear()
    bench.spin_until(lambda: len(latest) == 2, "a sample")
    assert all(map(math.isfinite, (*latest["body"], *latest["joints"])))
    bench.node.create_publisher(Float32, "motor_speed", 10)
    assert "[WARN]" in robot.wait_for("/motor_speed: /bench publishes std_msgs/msg/Float32, which cannot arrive; "
                                      "publish std_msgs/msg/Float64")
    bench.node.create_publisher(Float64, "upper_gap", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    assert "[WARN]" in robot.wait_for(
        "/upper_gap: /bench publishes best effort, which cannot arrive; let it publish reliably, or start the robot "
        "with -p qos_overrides./upper_gap.subscription.reliability:=best_effort")
    stop(robot)
    assert all(line.startswith("[") for line in robot.lines)  # nothing of a peer's text in the log as it came
    assert "\x1b" not in robot.text and max(map(len, robot.lines)) < LONGEST_SENTENCE + 200


def sentences(response) -> list[str]:
    """Return the texts of an answer of any service."""
    parts = [response, getattr(response, "result", None), *getattr(response, "results", ())]
    texts = [getattr(part, field, "") for part in parts for field in SENTENCES]
    return [text for text in texts if isinstance(text, str)]


def ask(bench, asked: list) -> list:
    """Send several requests, each to a client, and return the answers."""
    futures = [client.call_async(request) for client, request in asked]

    def waiting() -> list[str]:
        return [str(request) for (_, request), future in zip(asked, futures, strict=True) if not future.done()]

    try:
        bench.spin_until(lambda: not waiting(), "answers")
    except AssertionError as error:
        raise AssertionError(f"no answer to {waiting()}") from error
    return [future.result() for future in futures]
