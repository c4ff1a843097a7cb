"""Goals sent by another program: the actions of a real controller, which drives a real robot."""

import math
import signal
from types import SimpleNamespace

import pytest
from action_msgs.msg import GoalStatus
from observation import Operator
from rclpy.action import ActionClient

from vibro_ros.ros.controller import controller


@pytest.fixture
def served(start, bench):
    """A robot, a controller with `--serve`, and clients of its actions."""
    types = pytest.importorskip("vibro_ros_interfaces.action")
    served = SimpleNamespace(feedback=[], robot=start("robot", "--ros-args", "-p", "record.enabled:=false"))
    served.controller = start("controller", "--serve")
    clients = {kind: ActionClient(bench.node, getattr(types, kind), name) for kind, name in controller.NAMES.items()}
    served.operator = Operator(bench, topics=("odom", "joint_states"))
    served.operator.wait_for_robot()
    bench.spin_until(lambda: all(client.server_is_ready() for client in clients.values()), "actions")

    def send(kind: str, **goal: float):
        """Send a goal, which must be accepted, and return its handle."""
        future = clients[kind].send_goal_async(getattr(types, kind).Goal(**goal),
                                               feedback_callback=lambda one: served.feedback.append(one.feedback))
        bench.spin_until(future.done, "acceptance")
        assert future.result().accepted
        return future.result()

    def result(handle):
        """Return status, message and position of a goal."""
        future = handle.get_result_async()
        bench.spin_until(future.done, "result")
        return future.result().status, future.result().result.message, future.result().result.position

    served.send, served.result = send, result
    yield served
    for client in clients.values():
        client.destroy()


def test_a_position_is_reached_a_goal_is_cancelled_and_what_cannot_be_is_refused_in_words(served, bench):
    status, words, position = served.result(served.send("GoTo", position=-0.2, timeout=60.0))
    assert status == GoalStatus.STATUS_SUCCEEDED, words
    assert words.startswith("reached after ") and abs(position + 0.2) < 0.006
    bench.spin_until(lambda: abs(served.operator.odom().pose.pose.position.x + 0.2) < 0.006, "the place [m]")
    elapsed = [one.elapsed for one in served.feedback]
    assert len(elapsed) > 20 and elapsed == sorted(elapsed)
    assert max(one.motor_speed for one in served.feedback) > 20.0 and served.feedback[-1].motor_speed == 0.0
    assert abs(served.feedback[-1].position - position) < 0.006

    refusals = {
        "go_to: nan is not finite": ("GoTo", {"position": math.nan, "timeout": 9.0}),
        "timeout: 0 is not above 0": ("GoTo", {"position": -0.5}),
        "0 m is out of reach: the robot is at -0.": ("GoTo", {"position": 0.0, "timeout": 9.0}),
        "hold_speed: 0.05 m/s is out of reach": ("HoldSpeed", {"speed": 0.05, "duration": 9.0}),
        "/motor_speed: 900 is out of range; give a number from -500 to 500 rad/s": (
            "HoldSpeed", {"speed": -0.05, "duration": 9.0, "motor_to": 900.0}),
    }
    for reason, (kind, goal) in refusals.items():
        status, words, _ = served.result(served.send(kind, **goal))
        assert status == GoalStatus.STATUS_ABORTED and words.startswith(reason), words

    handle = served.send("HoldSpeed", speed=-0.05, duration=1000.0)
    bench.spin_until(lambda: served.operator.joint("crank")[1] > 20.0, "motion")
    status, words, _ = served.result(served.send("GoTo", position=-5.0, timeout=900.0))
    assert status == GoalStatus.STATUS_ABORTED
    assert words == "another goal is being pursued; cancel it, or wait for its end"
    cancelled = handle.cancel_goal_async()
    bench.spin_until(cancelled.done, "cancel")
    status, words, _ = served.result(handle)
    assert (status, words) == (GoalStatus.STATUS_CANCELED, "cancelled")
    bench.spin_until(lambda: served.operator.joint("crank")[1] == 0.0, "standstill")

    handle = served.send("HoldSpeed", speed=-0.05, duration=1000.0)
    bench.spin_until(lambda: served.operator.joint("crank")[1] > 20.0, "motion")
    served.controller.send(signal.SIGTERM)
    status, words, _ = served.result(handle)
    assert (status, words) == (GoalStatus.STATUS_ABORTED, "the controller ends")
    assert served.controller.end() == 0, served.controller.text
    assert "Traceback" not in served.controller.text and "please report" not in served.controller.text
    bench.spin_until(lambda: served.operator.joint("crank")[1] == 0.0, "standstill")
    served.robot.send(signal.SIGINT)
    assert served.robot.end() == 0 and " 0 commands refused" in served.robot.lines[-1]


def test_without_types_or_with_a_script_there_are_no_actions_and_one_line_says_so(refusal, monkeypatch):
    monkeypatch.setattr(controller, "OWN_TYPES", "no_such_interfaces")
    assert refusal(controller.main, "--serve").startswith("controller: --serve: no_such_interfaces is not installed, ")
    assert refusal(controller.main, "--serve", "crawl").startswith("controller: --serve: takes goals from other ")
