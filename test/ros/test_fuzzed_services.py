"""Requests at random to every service of a running robot: each is answered, each refusal counted, the robot goes on.

With VIBRO_ROS_HOSTILE in the environment there are a hundred thousand of them, which takes some minutes.
"""

import math
import os
import random

import pytest
from asking import wait_until_known
from observation import stop, value_of
from operated_robot import Operator
from random_requests import UNTOUCHED, random_request, service_class
from rcl_interfaces.srv import ListParameters, SetParameters, SetParametersAtomically
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool

from vibro_ros.ros.node.node import LONGEST_NAME, SENTENCES
from vibro_ros.ros.node.refusals import LONGEST_SENTENCE

ROUNDS = 4000 if "VIBRO_ROS_HOSTILE" in os.environ else 40
AT_ONCE = 25
"""Requests that wait together: fewer than a service of another node may queue."""
DEEP = QoSProfile(depth=100)


@pytest.fixture
def clients(bench):
    """Return a client of each of the robot's services by name, without those of actions and that of rcl itself."""
    def robots() -> list:
        found = bench.node.get_service_names_and_types()
        return [(name, kind) for name, (kind,) in found if name.startswith("/vibro_robot/")
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


def test_every_request_is_answered_every_refusal_counted_and_every_sample_finite(start, bench, request, listener):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0")
    robot.wait_for("ready")
    clients, chance = request.getfixturevalue("clients"), random.Random(7)
    operator = Operator(bench, ("odom", "joint_states", "ground_contact", "motor_power"))
    operator.wait_for_robot()
    answer = ask(bench, [(clients["/vibro_robot/list_parameters"], ListParameters.Request())])[0]
    names = [name for name in answer.result.names if name not in UNTOUCHED]
    refusals = 0
    for _ in range(ROUNDS):
        asked = [(client, random_request(client.srv_type, names, chance))
                 for client in chance.choices([*clients.values()], k=AT_ONCE)]
        for (_, request), response in zip(asked, ask(bench, asked), strict=True):
            refusals += refused(request, response)
            assert all(text.isprintable() and len(text) <= LONGEST_SENTENCE for text in sentences(response)), response
    assert refusals > ROUNDS
    ask(bench, [(clients["/vibro_robot/pause"], SetBool.Request(data=False))])
    status, values = listener.wait_for_status(
        "simulation", lambda status: value_of(status, "refused requests") >= refusals)
    assert (values["refused requests"], values["failed callbacks"]) == (str(refusals), "0"), robot.text
    operator.spin_for_samples(20)
    for topic in ("odom", "joint_states"):
        assert all(math.isfinite(number) for number in numbers_of(operator, topic))
    stop(robot)
    assert "\x1b" not in robot.text and "\ny" not in robot.text  # nothing of a peer's text in the log as it came
    assert max(map(len, robot.lines)) < LONGEST_SENTENCE + 200


def sentences(response) -> list[str]:
    """Return the texts of an answer of any service."""
    parts = [response, getattr(response, "result", None), *getattr(response, "results", ())]
    found = [getattr(part, field, "") for part in parts for field in SENTENCES]
    return [text for text in found if isinstance(text, str)]


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


def numbers_of(operator: Operator, topic: str) -> list[float]:
    """Return the numbers of the latest message of a topic."""
    if topic == "odom":
        message = operator.odom()
        return [message.pose.pose.position.x, message.pose.pose.position.z, message.twist.twist.linear.x]
    return [number for name in ("crank", "upper_mass", "inclined_mass") for number in operator.joint(name)]
