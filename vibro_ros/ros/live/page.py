"""The live view's node: what of the robot goes to the pages, and what of the pages goes to the robot."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from time import monotonic
from typing import Any, NamedTuple

from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.task import Future
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

from vibro_ros.messages.topics import COMMAND_UNITS, SET
from vibro_ros.process.untrusted import one_line
from vibro_ros.ros.live.robot import LiveRobot
from vibro_ros.ros.live.scene import Settings
from vibro_ros.ros.live.words import Words
from vibro_ros.ros.node import qos
from vibro_ros.ros.node.node import SteadyNode
from vibro_ros.view.machine import machine
from vibro_ros.view.motion import Document
from vibro_ros.view.protocol import COLUMNS, PLAIN_CALLS, SWITCHES, Call, Command, Request, SlowMotion, text_frame
from vibro_ros.view.server import Server
from vibro_ros.view.slow_motion import History, SlowMotions

PERIOD = 1.0 / 30.0
"""Time [s] between two batches of samples."""
LOOKS = 0.5
"""Time [s] between two looks who publishes and who offers services."""
MOST_ORDERS = 400
"""Requests of pages that wait for the node."""
AROUND = 1.0
"""Time [s] by which an impact may lie outside of the samples that were seen."""
PATIENCE = 5.0
"""Longest time [s] that an answer of the robot is waited for."""
AGAIN = 1.0
"""Time [s] after which a request of `REPEATABLE` is sent once more."""
REPEATABLE = ("pause",)
"""Services that may be called twice: a robot that is paused already does nothing. A second `step` would be another
one, a second `reset` too, and a second `record` would write another snapshot."""
MOST_WAITING = 50
"""Calls that wait for an answer at once."""
STATUS = {"real_time_factor": 0.0, "dropped_share": 0.0, "refused": 0, "paused": False, "recording": ""}
_TIME = COLUMNS.index("time")

Answer = Callable[[bool, str], object]
"""Is given whether the request was done, and the words."""


class Standing(NamedTuple):
    """How things stand: why there is no robot, or which one, since when, and the services that it offers."""

    absence: str
    settings: Settings | None
    origin: int | None
    offers: Mapping[str, bool]


class LivePage:
    """Stands between the robot, whose node has the full name `robot`, and the server of its pages."""

    def __init__(self, node: SteadyNode, executor: Executor, robot: str):
        self._node, self._executor, self._name = node, executor, robot
        self._requests, self._words = Requests(node, robot), Words(node, robot)
        self._robot = LiveRobot(node, robot)  # last, so that a robot which has told its parameters knows all clients
        self._slow_motions = SlowMotions(node.get_logger().info)
        self._history, self._orders = History(), deque[tuple[int, Request]](maxlen=MOST_ORDERS)
        self._standing = Standing("the view is starting", None, None, {})
        self._looked = float("-inf")
        self._server: Server | None = None

    def begin(self, server: Server) -> None:
        """Begin to serve the server's pages."""
        self._server = server
        self._node.create_timer(PERIOD, partial(self._poll, server), clock=Clock(clock_type=ClockType.STEADY_TIME))

    def ask(self, page: int, request: Request) -> None:
        """Take a page's request; for the server's thread."""
        self._orders.append((page, request))
        self._executor.create_task(self._obey)

    def greeting(self) -> list[tuple[str, str]]:
        """What a page that has just opened is told; for the server's thread."""
        frames = [self._frame(self._standing)]
        return [*frames, ("status", self._status())] if self._words.status else frames

    def _poll(self, server: Server) -> None:
        origin = self._robot.origin
        rows = self._robot.poll()
        if self._robot.origin != origin:
            self._history.clear()
        if self._words.diagnostics():
            self._robot.hear()
            server.send("status", self._status())
        if (now := monotonic()) > self._looked + LOOKS:
            self._looked = now
            self._robot.look()
        self._stand(server)
        if len(rows):
            self._history.add(rows)
            server.send_samples(rows.tobytes())
        self._tell(server)
        self._requests.tick()
        self._slow_motions.watch()

    def _stand(self, server: Server) -> None:
        """Tell the pages how things stand, if that has changed."""
        robot = self._robot
        absence = robot.absence
        standing = (Standing(absence, None, None, {}) if absence
                    else Standing("", robot.settings, robot.origin, self._requests.offers))
        before, self._standing = self._standing, standing
        if standing == before:
            return
        if standing.settings and standing.settings != before.settings:
            self._words.begin(standing.settings.prefix)
            self._slow_motions.prepare(standing.settings.scene["solver.method"])
        server.send(*self._frame(standing))

    def _tell(self, server: Server) -> None:
        """Hand on what the robot says beside its samples."""
        operations = self._words.operations()
        if any(one.name == SET for one in operations):
            self._robot.reader.read()
        if operations and self._words.status:
            server.send("status", self._status())
        last, origin = self._history.last(), self._standing.origin
        impacts = [((one.stamp - origin) * 1e-9, one) for one in self._words.impacts() if origin is not None]
        if last is not None and (near := [{"time": time, "side": one.side, "peak_force": one.peak_force}
                                          for time, one in impacts if -AROUND < time < last[_TIME] + AROUND]):
            server.send("impacts", text_frame("impacts", list=near))
        for level, words in self._words.log():
            server.send("log", text_frame("log", level=level, words=words))

    def _obey(self) -> None:
        while self._orders and self._server:
            page, request = self._orders.popleft()
            answer = partial(self._server.answer, page, request.id)
            if isinstance(request, Command):
                self._requests.command(request, answer)
            elif isinstance(request, Call):
                self._requests.call(request, answer)
            else:
                self._slow_motion(page, request, self._server)

    def _slow_motion(self, page: int, request: SlowMotion, server: Server) -> None:
        def done(found: Document | str) -> None:
            if isinstance(found, str):
                server.answer(page, request.id, False, found)
            else:
                server.send_motion(page, request.id, found)

        if self._standing.settings is None:
            done(f"there is no robot: {self._standing.absence}")
        else:
            self._slow_motions.ask(self._standing.settings.scene, self._history.samples(request.seconds), done)

    def _status(self) -> str:
        return text_frame("status", **{**STATUS, **self._words.status})

    def _frame(self, standing: Standing) -> tuple[str, str]:
        """Kind and text of the frame that says how things stand; a knob shows what the robot does now."""
        if standing.settings is None:
            return "absent", text_frame("absent", words=standing.absence)
        scene, last = standing.settings.scene, self._history.last()
        drawn = machine(scene)
        if last is not None:
            now = dict(zip(COLUMNS, last.tolist(), strict=True))
            for knob in drawn["knobs"]:
                side = knob["name"].removesuffix("_gap")
                knob["value"] = now["motor_speed"] if side == "motor_speed" else (
                    now[f"{side}_plate_position"] - scene[f"crank.{side}_rod"])
        return "robot", text_frame("robot", name=self._name, machine=drawn, columns=list(COLUMNS),
                                   origin=str(standing.origin or 0), offers=dict(standing.offers))


@dataclass(eq=False)
class _Waiting:
    """One call that waits for its answer, and each request that was sent for it."""

    call: Call
    answer: Answer
    client: Client
    begun: float
    sent: list[Future]


class Requests:
    """The publishers and clients of one robot; all that follows is for the executor's thread."""

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
            waiting = _Waiting(call, answer, client, monotonic(), [])
            self._waiting.append(waiting)
            self._send(waiting)

    def tick(self) -> None:
        """Send once more what may be, and give up what has waited too long; to be called often."""
        now = monotonic()
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
