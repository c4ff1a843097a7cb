"""The controller with `use_sim_time`: a script is played in the time of /clock, whatever the wall clock does."""

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
BARRIER = 3  # calls of a service after each time, because a request may overtake a message


class SteppedClock:
    """Publishes /clock in lock-step with the controller, and receives its commands to the motor."""

    def __init__(self, bench):
        self.bench, self.received = bench, []
        bench.node.create_subscription(Float64, "motor_speed", lambda message: self.received.append(message.data), 100)
        self._clock = bench.node.create_publisher(Clock, "/clock", 10)
        self._client = bench.node.create_client(GetParameters, "/vibro_controller/get_parameters")

    def wait_for_controller(self) -> None:
        self.bench.spin_until(lambda: self._clock.get_subscription_count() and self._client.service_is_ready()
                              and self.bench.node.count_publishers("motor_speed"), "controller up")

    def begin_at(self, nanoseconds: int) -> None:
        """Publish the first time until it is received: the subscriber may discover the publisher late."""
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
        return self.received


@pytest.fixture
def clock(bench):
    return SteppedClock(bench)


def until_received(clock: SteppedClock, count: int) -> None:
    clock.bench.spin_until(lambda: len(clock.received) >= count, f"{count} commands")


def test_commands_count_in_ros_time_from_the_first_time_received(start, clock, tmp_path):
    begin = 1_700_000_000 * 1000 * MILLISECOND + 7
    controller = start("controller", write(tmp_path, """
entries:
  - {for: 0.1, motor_speed: 10.0}
  - {for: 0.2, motor_speed: {to: 30.0}}
  - {for: 1000.0, motor_speed: 40.0}
"""), *SIMULATED, "-p", "rate:=20.0")
    clock.wait_for_controller()
    clock.begin_at(begin)
    until_received(clock, 1)  # nothing has to move for the commands of instant 0
    for milliseconds, commands in ((0, 1), (99, 1), (100, 2), (149, 2), (150, 3), (300, 6), (1_000_299, 6)):
        clock.step_to(begin + milliseconds * MILLISECOND)
        until_received(clock, commands)
        assert len(clock.received) == commands, f"at {milliseconds} ms: {clock.received}"
    assert not controller.ended
    clock.publish(begin + 1_000_300 * MILLISECOND)
    assert controller.end() == 0, controller.text
    assert clock.received == [10.0, 10.0, 15.0, 20.0, 25.0, 40.0]


def test_invalid_times_and_a_pause_are_no_error_and_an_abort_stops_the_motor(start, clock, tmp_path):
    controller = start("controller", write(tmp_path, "entries: [{for: 0.1, motor_speed: 10.0}]\n"), *SIMULATED)
    controller.wait_for("use_sim_time: ")  # nothing is sent before there is a time
    clock.wait_for_controller()
    for nanoseconds in (-5, -2**31 * 1000 * MILLISECOND, (2**31 - 1) * 1000 * MILLISECOND):
        assert clock.step_to(nanoseconds) == []
    controller.wait_for("/clock: refused: ")
    clock.begin_at(5)
    until_received(clock, 1)
    controller.wait_for("the script waits for /clock")
    assert clock.received == [10.0]
    controller.send(signal.SIGINT)
    clock.bench.spin_until(lambda: controller.ended, "the end")
    assert controller.end() == 128 + signal.SIGINT
    until_received(clock, 2)
    assert clock.received == [10.0, 0.0]


def test_a_clock_that_jumps_back_is_an_error_and_stops_the_motor(start, clock, tmp_path):
    controller = start("controller", write(tmp_path, "entries: [{for: 100.0, motor_speed: 10.0}]\n"), *SIMULATED)
    clock.wait_for_controller()
    clock.begin_at(50_000 * MILLISECOND)
    until_received(clock, 1)
    clock.publish(49_999 * MILLISECOND)
    clock.bench.spin_until(lambda: controller.ended, "the end")
    assert controller.end() == 1
    assert controller.lines[-1].startswith("controller: /clock jumped back from 50 to 49.999 s: a reset simulation, or")
    until_received(clock, 2)
    assert clock.received == [10.0, 0.0]


def test_a_due_action_runs_before_the_next_request_is_answered(bench):
    """Player and service share a process, so `done` has the order: a time's action precedes its last answers."""
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
    for tick in range(199):  # the player ends before the answers of the last tick
        assert done.index(tick) < done.index(f"{tick} {BARRIER - 1}"), tick


def test_time_passed_to_meanwhile_never_exceeds_the_next_instant(domain_id):
    """If each wait read the clock twice, one in fifty would report a time after the instant."""
    times: list[float] = []
    schedule = [(5e-4 * k, partial(times.append, 5e-4 * k)) for k in range(3000)]
    with StopRequest() as stop, process.node_running("player", ()) as node:
        assert Player(node, {}, meanwhile=times.append, period=1e-6).run(schedule, 0.0, stop) == 0
    assert len(times) > len(schedule) + 300, "too few waits to tell"
    assert times == sorted(times)
