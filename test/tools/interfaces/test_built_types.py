"""The types that `make setup` has built, between two processes over DDS, and as the ament index knows them."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from ament_index_python import get_package_share_directory, get_resource
from official_hashes import OFFICIAL
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from tools.interfaces.command import STAMP
from tools.interfaces.compilation import CompilerError, find_compiler
from tools.interfaces.definitions import interface_packages

PATIENCE = 60.0  # [s] deadline of what takes a second on an idle machine


@pytest.fixture(scope="module", autouse=True)
def built() -> None:
    """The types; only where there is no compiler are the tests without them."""
    try:
        find_compiler()
    except CompilerError as error:
        pytest.skip(str(error))
    assert Path(sys.prefix, STAMP).exists(), "types not built; run make setup"


@pytest.fixture
def spin_until(domain_id: int) -> Iterator[Callable]:
    """Serve a node of the test's own until something is the case; the node is the function's attribute."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node, executor = Node("test", context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin(done: Callable[[], object], what: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not done():
            assert time.monotonic() < deadline, f"{what}: not within {PATIENCE} s"
            executor.spin_once(timeout_sec=0.05)

    spin.node = node
    yield spin
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def peer(domain_id: int) -> Iterator[subprocess.Popen]:
    process = subprocess.Popen([sys.executable, str(Path(__file__).with_name("peer_of_types.py"))])
    yield process
    process.kill()
    process.wait()


def test_another_process_is_heard_and_answers(peer, spin_until):
    from simulation_interfaces.action import SimulateSteps
    from simulation_interfaces.msg import Result
    from simulation_interfaces.srv import StepSimulation
    from tf2_msgs.msg import TFMessage
    node, heard, feedback = spin_until.node, [], []
    node.create_subscription(TFMessage, "/tf", heard.append, 10)
    spin_until(lambda: heard, "/tf")
    assert [one.transform.translation.x for one in heard[0].transforms] == [1.25, 1.25]

    client = node.create_client(StepSimulation, "step")
    spin_until(client.service_is_ready, "service")
    future = client.call_async(StepSimulation.Request(steps=2**64 - 1))
    spin_until(future.done, "answer")
    assert future.result().result == Result(result=Result.RESULT_OK, error_message=f"{2**64 - 1} steps")

    # Not through the client, which drops the feedback of a goal that has ended; and again until publisher and
    # subscription have met.
    node.create_subscription(SimulateSteps.Impl.FeedbackMessage, "simulate/_action/feedback",
                             lambda one: feedback.append(one.feedback), 10)
    action, goals = ActionClient(node, SimulateSteps, "simulate"), []
    spin_until(action.server_is_ready, "action")

    def simulated() -> bool:
        if not goals or goals[-1].done():
            goals.append(action.send_goal_async(SimulateSteps.Goal(steps=3)))
        return bool(feedback)

    spin_until(simulated, "feedback")
    spin_until(goals[0].done, "acceptance")
    done = goals[0].result().get_result_async()
    spin_until(done.done, "result")
    assert feedback[0] == SimulateSteps.Feedback(completed_steps=1, remaining_steps=2)
    assert done.result().result.result == Result(result=Result.RESULT_OPERATION_FAILED, error_message="µ")
    action.destroy()


def test_peers_are_told_the_official_hash(peer, spin_until):
    node = spin_until.node
    spin_until(lambda: node.get_publishers_info_by_topic("/tf"), "publisher of /tf")
    (endpoint,) = node.get_publishers_info_by_topic("/tf")
    told = bytes(endpoint.topic_type_hash.value).hex()
    assert told == OFFICIAL["tf2_msgs/msg/TFMessage"]


@pytest.mark.parametrize("package", interface_packages(), ids=lambda package: package.name)
def test_the_ament_index_knows_the_definitions(package, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    listed = get_resource("rosidl_interfaces", package.name)[0].split()
    assert {path for path in listed if not path.endswith(".idl")} == set(package.texts)
    share = Path(get_package_share_directory(package.name))
    for path, text in package.texts.items():
        assert (share / path).read_text() == text
    assert all((share / path).is_file() for path in listed)
