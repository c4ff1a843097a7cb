"""The stepping thread on real topics, where a process of its own cannot be made to fail."""

from types import SimpleNamespace

import vibro_ros
from vibro_ros.messages.operations import RESET, RESUME, STEP, Operation
from vibro_ros.ros.robot.operations import Operations
from vibro_ros.ros.robot.pacing import Pacing, RobotTime
from vibro_ros.ros.robot.services import SimulationControl, outcome
from vibro_ros.ros.robot.stepping import SUMMARY, Run, StallReport, Stepping
from vibro_ros.ros.topics.publishers import RobotPublishers
from vibro_ros.ros.topics.subscriptions import CommandSubscriptions


def test_an_error_ends_the_thread_and_is_kept_for_the_main_thread(bench):
    scene = vibro_ros.load_scene("device")
    device, stamps = vibro_ros.Simulator(scene), []

    def record(topic: str, stamp: int, data: bytes) -> None:
        stamps.append(stamp)
        if stamp == 1_000 + 10_000_000:
            raise RuntimeError("third sample")

    pacing, robot_time = Pacing(factor=0.0, max_catch_up=0.1), RobotTime(rate=200.0, start=1_000)
    subscriptions = CommandSubscriptions(bench.node, scene)
    operations = Operations(bench.node, device, pacing, robot_time, subscriptions, record)
    recording = SimpleNamespace(record=record, checkpoint=lambda *_: None, crowded=False)
    run = Run(device, robot_time, pacing, subscriptions, RobotPublishers(bench.node, scene), operations, recording,
              SimulationControl(bench.node, operations, robot_time))
    stepping = Stepping(run, bench.node.get_logger())
    with stepping:
        bench.spin_until(lambda: stepping.error is not None, "the error")
    assert str(stepping.error) == "third sample"
    assert sorted(set(stamps)) == [1_000, 1_000 + 5_000_000, 1_000 + 10_000_000]
    assert device.time == 0.01
    assert len(device.take_events()) == 0  # each tick took what had come, so that a long run keeps none


def test_whoever_asked_is_answered_when_the_run_cannot_go_on(bench, monkeypatch):
    """Else a robot that waits for its answers before it seals the bag would wait without end."""
    scene = vibro_ros.load_scene("device")
    device, pacing, robot_time = vibro_ros.Simulator(scene), Pacing(factor=0.0, max_catch_up=0.1), RobotTime(rate=200.0)
    subscriptions = CommandSubscriptions(bench.node, scene)
    operations = Operations(bench.node, device, pacing, robot_time, subscriptions, lambda *_: None, paused=True)

    def fail() -> None:
        raise vibro_ros.SimulationError("no start")

    monkeypatch.setattr(device, "reset", fail)
    given_up = operations.ask(Operation(STEP, steps=1))
    assert outcome(given_up) == (False, "the simulation has not answered in time; nothing was changed")
    failing, behind = (operations.ask(Operation(name)) for name in (RESET, RESUME))
    recording = SimpleNamespace(record=lambda *_: None, checkpoint=lambda *_: None, crowded=False)
    run = Run(device, robot_time, pacing, subscriptions, RobotPublishers(bench.node, scene), operations, recording,
              control=None)
    with Stepping(run, bench.node.get_logger()) as stepping:
        bench.spin_until(behind.done, "the last answer")
    assert str(stepping.error) == "no start" and robot_time.ticks == 0
    assert (outcome(failing), outcome(behind)) == ((False, "no start"), (False, "the simulation has ended"))
    assert outcome(operations.ask(Operation(RESET))) == (False, "the simulation has ended")


def test_stalls_are_told_when_they_begin_and_then_once_a_minute_with_their_cause():
    clock, lines = [100.0], []
    report = StallReport(lines.append, lambda: clock[0])
    clock[0] += 10.0
    report.add(0.2, 0.2, busy=0.1, ticks=2000)
    for _ in range(60):
        clock[0] += 1.01
        report.add(0.5, 30.2, busy=0.1 + 58.0, ticks=3000)
    first, second = lines
    assert first.startswith("stalled: 0.200 s of simulated time dropped, because the computer did not let the robot")
    assert second.startswith(f"stalled 60 times in {SUMMARY * 1.01:.0f} s: 30.000 s of simulated time dropped, 30.200 "
                             "s since the start, because a step takes 19 ms, longer than it lasts; lower rate.real_")
