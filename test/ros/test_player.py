"""Playing in time: by /clock with `use_sim_time`, whatever the wall clock does meanwhile."""

import signal
from functools import partial
from itertools import islice

import pytest
from observation import write
from rcl_interfaces.srv import GetParameters
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64

from vibro_ros.process.entry_point import StopRequest
from vibro_ros.ros.controller.player import Player
from vibro_ros.ros.node import process

SIMULATED = ("--ros-args", "-p", "use_sim_time:=true")
MILLISECOND = 1_000_000  # [ns]
BARRIER = 3  # calls of a service after each time: a message and a request travel by roads of their own


class SteppedClock:
    """Listens to the motor's command, publishes /clock, and waits for the controller's answers as in lock-step."""

    def __init__(self, bench):
        self.bench, self.heard = bench, []
        bench.node.create_subscription(Float64, "motor_speed", lambda message: self.heard.append(message.data), 100)
        self._clock = bench.node.create_publisher(Clock, "/clock", 10)
        self._client = bench.node.create_client(GetParameters, "/vibro_controller/get_parameters")

    def wait_for_controller(self) -> None:
        self.bench.spin_until(lambda: self._clock.get_subscription_count() and self._client.service_is_ready()
                              and self.bench.node.count_publishers("motor_speed"), "controller up")

    def begin_at(self, nanoseconds: int) -> None:
        """Publish the first time until it is received, because the publisher discovers the subscriber before the
        subscriber discovers the publisher.
        """
        for _ in range(20):
            self.step_to(nanoseconds)

    def publish(self, nanoseconds: int) -> None:
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(nanoseconds, 1000 * MILLISECOND)
        self._clock.publish(message)

    def step_to(self, nanoseconds: int) -> list[float]:
        """Publish a time, wait until the controller has answered, and return the commands that it has sent by then."""
        self.publish(nanoseconds)
        for _ in range(BARRIER):
            answer = self._client.call_async(GetParameters.Request(names=["rate"]))
            self.bench.spin_until(answer.done, "the controller's answer")
        return self.heard


@pytest.fixture
def clock(bench):
    return SteppedClock(bench)


def until_heard(clock: SteppedClock, count: int) -> None:
    clock.bench.spin_until(lambda: len(clock.heard) >= count, f"{count} commands")


def test_commands_count_in_ros_time_from_the_first_that_is_heard(start, clock, tmp_path):
    begin = 1_700_000_000 * 1000 * MILLISECOND + 7
    controller = start("controller", write(tmp_path, """
entries:
  - {for: 0.1, motor_speed: 10.0}
  - {for: 0.2, motor_speed: {to: 30.0}}
  - {for: 1000.0, motor_speed: 40.0}
"""), *SIMULATED, "-p", "rate:=20.0")
    clock.wait_for_controller()
    clock.begin_at(begin)
    until_heard(clock, 1)  # nothing has to move for the commands of instant 0
    for milliseconds, commands in ((0, 1), (99, 1), (100, 2), (149, 2), (150, 3), (300, 6), (1_000_299, 6)):
        clock.step_to(begin + milliseconds * MILLISECOND)
        until_heard(clock, commands)
        assert len(clock.heard) == commands, f"at {milliseconds} ms: {clock.heard}"
    assert not controller.ended
    clock.publish(begin + 1_000_300 * MILLISECOND)
    assert controller.end() == 0, controller.text
    assert clock.heard == [10.0, 10.0, 15.0, 20.0, 25.0, 40.0]


def test_invalid_times_and_a_pause_are_no_error_and_an_abort_stops_the_motor(start, clock, tmp_path):
    controller = start("controller", write(tmp_path, "entries: [{for: 0.1, motor_speed: 10.0}]\n"), *SIMULATED)
    controller.wait_for("use_sim_time: ")  # nothing is sent before there is a time
    clock.wait_for_controller()
    for nanoseconds in (-5, -2**31 * 1000 * MILLISECOND, (2**31 - 1) * 1000 * MILLISECOND):
        assert clock.step_to(nanoseconds) == []
    controller.wait_for("/clock: refused: ")
    clock.begin_at(5)
    until_heard(clock, 1)
    controller.wait_for("the script waits for /clock")
    assert clock.heard == [10.0]
    controller.send(signal.SIGINT)
    clock.bench.spin_until(lambda: controller.ended, "the end")
    assert controller.end() == 128 + signal.SIGINT
    until_heard(clock, 2)
    assert clock.heard == [10.0, 0.0]


def test_a_clock_that_jumps_back_is_an_error_and_stops_the_motor(start, clock, tmp_path):
    controller = start("controller", write(tmp_path, "entries: [{for: 100.0, motor_speed: 10.0}]\n"), *SIMULATED)
    clock.wait_for_controller()
    clock.begin_at(50_000 * MILLISECOND)
    until_heard(clock, 1)
    clock.publish(49_999 * MILLISECOND)
    clock.bench.spin_until(lambda: controller.ended, "the end")
    assert controller.end() == 1
    assert controller.lines[-1].startswith("controller: /clock jumped back from 50 to 49.999 s: a reset simulation, or")
    until_heard(clock, 2)
    assert clock.heard == [10.0, 0.0]


def test_a_due_action_runs_before_the_next_request_is_answered(bench):
    """Both run in one process, so that the order is visible: at every answer after a new time but the first, the
    commands that are due at that time have been sent.
    """
    done: list[object] = []
    clock = bench.node.create_publisher(Clock, "/clock", 10)
    with StopRequest() as stop, process.node_running("player", SIMULATED) as node:
        client = bench.node.create_client(GetParameters, "asked")
        steps = iter([(tick, call) for tick in range(200) for call in range(BARRIER)])

        def publish(tick: int) -> None:
            message = Clock()
            message.clock.nanosec = tick * MILLISECOND
            clock.publish(message)

        def ask_next() -> None:
            for tick, call in islice(steps, 1):
                if call == 0:
                    publish(tick)
                client.call_async(GetParameters.Request(names=[f"{tick} {call}"]))

        def answer(request: GetParameters.Request, response: GetParameters.Response) -> GetParameters.Response:
            done.append(request.names[0])
            ask_next()
            return response

        node.create_service(GetParameters, "asked", answer)
        process.spin_until(node, lambda: client.service_is_ready() and (publish(0) or node.clock_heard))
        schedule = [(tick * 1e-3, partial(done.append, tick)) for tick in range(200)]
        ask_next()
        assert Player(node, {}).run(schedule, 0.0, stop) == 0
    for tick in range(199):  # the last one's answers are no longer waited for
        assert done.index(tick) < done.index(f"{tick} {BARRIER - 1}"), tick


def test_time_passed_to_meanwhile_never_exceeds_the_next_instant(domain_id):
    """When the clock was read twice, one wait in fifty reported a time after the instant."""
    told: list[float] = []
    schedule = [(5e-4 * k, partial(told.append, 5e-4 * k)) for k in range(3000)]
    with StopRequest() as stop, process.node_running("player", ()) as node:
        assert Player(node, {}, meanwhile=told.append, period=1e-6).run(schedule, 0.0, stop) == 0
    assert len(told) > len(schedule) + 300, "too few waits to tell"
    assert told == sorted(told)
