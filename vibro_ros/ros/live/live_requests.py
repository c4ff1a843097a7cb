"""What a page asks of the robot: commands that are published, services that are called, and their answers in words."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.process.untrusted import one_line
from vibro_ros.ros.node import qos
from vibro_ros.view.protocol import PLAIN_CALLS, SWITCHES, Call, Command

PATIENCE = 5.0
"""Longest time [s] that an answer of the robot is waited for."""
AGAIN = 1.0
"""Time [s] after which a request of `REPEATABLE` is sent once more."""
REPEATABLE = ("pause",)
"""Services that may be called twice: a robot that is paused already does nothing. A second `step` would be another
one, a second `reset` too, and a second `record` would write another snapshot."""
MOST_WAITING = 50
"""Calls that wait for an answer at once."""

Answer = Callable[[bool, str], object]
"""Is told whether it was done, and the words."""


@dataclass(eq=False)
class _Waiting:
    """One call that waits for its answer, and each request that was sent for it."""

    call: Call
    answer: Answer
    client: Client
    begun: float
    sent: list[Future]


class Requests:
    """The publishers and clients of one robot.

    Parameters
    ----------
    node : Node
        Publishes and calls, in its executor's thread.
    robot : str
        Full name of the robot's node.
    """

    def __init__(self, node: Node, robot: str):
        self._robot = robot
        self._publishers = {name: node.create_publisher(Float64, name, qos.COMMANDS) for name in COMMAND_UNITS}
        kinds = {**dict.fromkeys(PLAIN_CALLS, Trigger), **dict.fromkeys(SWITCHES, SetBool)}
        self._clients = {name: node.create_client(kind, f"{robot}/{name}") for name, kind in kinds.items()}
        self._waiting: list[_Waiting] = []

    @property
    def offers(self) -> dict[str, bool]:
        """Which services the robot offers."""
        return {name: client.service_is_ready() for name, client in self._clients.items()}

    def command(self, command: Command, answer: Answer) -> None:
        """Publish a command, as it is: the robot knows its limits, and says when it refuses."""
        publisher = self._publishers[command.name]
        if not publisher.get_subscription_count():
            answer(False, f"nobody listens to {publisher.topic_name}; is the robot running?")
            return
        publisher.publish(Float64(data=command.value))
        answer(True, f"{command.name} {command.value:g} {COMMAND_UNITS[command.name]} sent")

    def call(self, call: Call, answer: Answer) -> None:
        """Call a service."""
        client = self._clients[call.name]
        if not client.service_is_ready():
            answer(False, f"nobody offers {client.srv_name}; is the robot running?")
        elif len(self._waiting) >= MOST_WAITING:
            answer(False, f"{MOST_WAITING} requests wait for the robot's answer already; ask again later")
        else:
            waiting = _Waiting(call, answer, client, time.monotonic(), [])
            self._waiting.append(waiting)
            self._send(waiting)

    def tick(self) -> None:
        """Send once more what may be, and give up what has waited too long; to be called often."""
        now = time.monotonic()
        for one in list(self._waiting):
            if now > one.begun + PATIENCE:
                self._end(one, False, f"{one.client.srv_name} has not answered for {PATIENCE:g} s; it may still do "
                                      "what was asked")
            elif one.call.name in REPEATABLE and now > one.begun + AGAIN * len(one.sent):
                self._send(one)

    def _send(self, one: _Waiting) -> None:
        request: Any = Trigger.Request() if one.call.on is None else SetBool.Request(data=one.call.on)
        future = one.client.call_async(request)
        one.sent.append(future)
        future.add_done_callback(lambda done: self._take(one, done))

    def _take(self, one: _Waiting, future: Future) -> None:
        if one in self._waiting and not future.cancelled():
            self._end(one, bool(future.result().success), one_line(future.result().message, 500))

    def _end(self, one: _Waiting, done: bool, words: str) -> None:
        self._waiting.remove(one)
        for future in one.sent:
            one.client.remove_pending_request(future)
        one.answer(done, words)
