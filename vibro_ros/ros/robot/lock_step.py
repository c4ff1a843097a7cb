"""Lock-step: each sample waits until the nodes that follow the robot have finished their reactions to the previous one.

ROS has no message for this, but every node of rclpy and rclcpp answers its parameter service, in the thread that runs
its callbacks. The robot publishes a sample and then /clock, and calls that service of each node `ROUNDS` times in a
row. A node handles a request after the messages that arrived before it. So the first answer means that the callbacks of
the sample and of /clock have run, and their messages are published; the second that the timers due at that time have
run; and the third that the callbacks triggered by these have run. What a node publishes before an answer arrives before
the answer.
"""

import re
import time
from collections.abc import Callable, Sequence
from functools import partial

from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future

from vibro_ros.configuration.scene_file import NO_NODES
from vibro_ros.ros.node.refusals import peer_text

ROUNDS = 3
ANSWER_TIMEOUT = 2.0
"""Time [s] without an answer after which the log names the node that the robot waits for, and it is called again."""
_NAME = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")


class LockStep:
    """Calls the nodes with these full `names` after each sample; their answers come in the executor's thread.

    `all_answered` says whether all have answered since the last `ask`; `when_answered` is called when they have.
    """

    def __init__(self, node: Node, names: Sequence[str], when_answered: Callable[[], object]):
        self.all_answered = True
        self._when_answered = when_answered
        self._log = node.get_logger()
        self._clients = {name: node.create_client(GetParameters, f"{name}/get_parameters") for name in names}
        self._awaited: set[str] = set()
        self._tokens = dict.fromkeys(names, 0)  # number of each node's last call: answers to earlier calls are ignored
        self._asked_at = self._reminded_at = time.monotonic()
        node.create_timer(ANSWER_TIMEOUT / 4.0, self._remind, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def ask(self) -> None:
        """Call all nodes, for whose answers the next sample waits; used in the stepping thread."""
        self._asked_at = self._reminded_at = time.monotonic()
        self._awaited, self.all_answered = set(self._clients), False
        for name in self._clients:
            self._call(name, ROUNDS)

    def _call(self, name: str, rounds: int) -> None:
        """Call a node `rounds` times in a row if it is there; else `_remind` calls it later."""
        self._tokens[name] += 1
        client = self._clients[name]
        if client.service_is_ready():
            future = client.call_async(GetParameters.Request())
            future.add_done_callback(partial(self._take_answer, name, self._tokens[name], rounds))

    def _take_answer(self, name: str, token: int, rounds: int, _: Future) -> None:
        if token != self._tokens[name]:
            return
        if rounds > 1:
            self._call(name, rounds - 1)
            return
        self._awaited.discard(name)
        if not self._awaited:
            self.all_answered = True
            self._when_answered()

    def _remind(self) -> None:
        """Log which nodes the robot waits for, and call them again, because a restarted node may lose an answer."""
        now = time.monotonic()
        if self.all_answered or now - self._reminded_at < ANSWER_TIMEOUT:
            return
        self._reminded_at = now
        for name in sorted(self._awaited):
            lack = "does not answer" if self._clients[name].service_is_ready() else "is not there"
            self._log.warning(f"clock.lock_step: waiting for {name} for {now - self._asked_at:.0f} s: it {lack}; robot "
                              "time stands still. Start the node, or start the robot without its name")
            self._call(name, ROUNDS)


def checked_nodes(node: Node, names: Sequence[str]) -> tuple[str, ...]:
    """Return the full names of the nodes in `clock.lock_step` (ValueError for an invalid or the robot's own name)."""
    if tuple(names) == NO_NODES:
        return ()
    full = tuple(name if name.startswith("/") else f"{node.get_namespace().rstrip('/')}/{name}" for name in names)
    for name in full:
        if not _NAME.fullmatch(name):
            raise ValueError(f"clock.lock_step: {peer_text(name)} is no node's name; give one as /vibro_controller")
    if node.get_fully_qualified_name() in full:
        raise ValueError("clock.lock_step: the robot cannot wait for itself; give the nodes that command it")
    return tuple(dict.fromkeys(full))
