"""The run behind its lock: its states, and the answer of every waiting caller when the run ends.

`test_late_bags.py` acts on a run at any instant, and replays it.
"""

import signal
import time
from types import SimpleNamespace

import pytest
from asking import known_client

import vibro_ros
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.messages.operations import STATE, Operation
from vibro_ros.ros.robot.pacing import SUMMARY_PERIOD, StallReport
from vibro_ros.ros.robot.run import ENDED, RobotPublishers, RobotRun, RunState


def run_of(bench, record, scene=None, **settings) -> RobotRun:
    """Return a run as fast as it can, with other `settings` of the node; a name has _ for each point."""
    scene = scene or vibro_ros.load_scene("device")
    recording = SimpleNamespace(record=record, checkpoint=lambda *_: None, is_backlogged=False)
    given = {"rate_real_time_factor": 0.0} | settings
    run = RobotRun(bench.node, vibro_ros.Simulator(scene), {
        parameter.name: given.get(parameter.name.replace(".", "_"), parameter.default)
        for parameter in DEVICE_PARAMETERS}, RobotPublishers(bench.node, scene), recording)
    run.robot_time.start = 1_000
    return run


def test_an_error_ends_the_thread_and_is_kept_for_the_main_thread(bench):
    stamps = []

    def record(topic: str, stamp: int, data: bytes) -> None:
        stamps.append(stamp)
        if stamp == 1_000 + 10_000_000:
            raise RuntimeError("third sample")

    run = run_of(bench, record)
    with run:
        bench.spin_until(lambda: run.error is not None, "the error")
    assert str(run.error) == "third sample"
    assert sorted(set(stamps)) == [1_000, 1_000 + 5_000_000, 1_000 + 10_000_000]
    assert run.device.time == 0.01
    assert len(run.device.take_events()) == 0  # each tick took what had come, so that a long run keeps none


def test_requests_are_answered_when_the_run_fails(bench, monkeypatch):
    """Otherwise a robot that waits for these answers before it seals the bag would wait for ever."""
    run = run_of(bench, lambda *_: None, rate_start_paused=True)

    def fail() -> None:
        raise vibro_ros.SimulationError("no start")

    monkeypatch.setattr(run.device, "reset", fail)
    with run:
        run.recording.is_backlogged = True  # so that no step is taken
        waiting = run.begin_steps(3)
        with pytest.raises(ValueError, match="3 steps are being taken, 0 so far"):
            run.begin_steps(1)
        with pytest.raises(RuntimeError, match="no start"):
            run.reset()
        bench.spin_until(waiting.done, "the answer of the steps")
    assert str(waiting.exception()) == ENDED and str(run.error) == "no start"
    for ask in (run.reset, lambda: run.begin_steps(1), run.stamped_state):
        with pytest.raises(RuntimeError, match=ENDED):
            ask()


def test_each_operation_leads_to_the_state_that_the_table_of_transitions_names(bench):
    """The peer of the lock-step never answers, so that the run stays in each state as long as the test needs."""
    run = run_of(bench, lambda *_: None, rate_start_paused=True, clock_publish=True, clock_lock_step=("/nobody",))
    with run:
        run.recording.is_backlogged = True
        assert run.state is RunState.PAUSED
        steps = run.begin_steps(2)
        assert run.state is steps and run.paused
        run.pause()
        assert run.state is steps
        run.resume()
        assert run.state is RunState.RESUMING and run.paused and "stepped 0 of 2" in steps.result()
        with pytest.raises(ValueError, match="not paused"):
            run.begin_steps(1)
        run.pause()
        assert run.state is RunState.PAUSED
        cancelled = run.begin_steps(1)
        run.end_steps()
        assert run.state is RunState.PAUSED and "stepped 0 of 1" in cancelled.result()
        run.resume()
        run._lock_step.all_answered = True
        run._notify()
        bench.spin_until(lambda: run.state is RunState.RUNNING, "robot time goes on")
        run.pause()
        assert run.state is RunState.PAUSED and not run.is_ending
        run.end()
        assert run.is_ending


def test_a_crank_that_spins_too_fast_is_logged_and_signals_are_obeyed(start, bench):
    """The winding keeps the current for a second, because a robot that spins for 20 ms may make good its lateness."""
    types = pytest.importorskip("vibro_ros_interfaces.srv", reason="types are not built: no compiler")
    words = ("scene:=machine", "motor.winding_inductance:=1.0", "motor.crank_inertia:=0.00005", "rate.publish:=100.0",
             "record.enabled:=false")
    robot = start("robot", "--ros-args", *(word for parameter in words for word in ("-p", parameter)))
    robot.wait_for("ready")
    client = known_client(bench, types.SetState, "set_state")
    asked = time.monotonic()
    client.call_async(types.SetState.Request(names=["motor_current"], values=[1e6]))
    robot.wait_for("because the crank spins at ")
    named = time.monotonic()
    robot.send(signal.SIGINT)
    assert robot.end() == 0, robot.text
    assert time.monotonic() - named < named - asked + 1.0  # the interrupted tick has 2.6 times the turns of the first
    bench.node.destroy_client(client)


def test_a_crank_that_spins_within_one_tick_is_logged(bench):
    scene = vibro_ros.load_scene("machine").with_parameters({"motor.winding_inductance": 0.001,
                                                             "motor.crank_inertia": 5e-5})
    run = run_of(bench, lambda *_: None, scene, rate_publish=20.0, rate_real_time_factor=1.0, rate_max_catch_up=0.0)
    lines = []
    run._stalls = StallReport(lines.append)
    with run:
        run.disturb(Operation(STATE, parameters={"motor_current": 1e6}))
        bench.spin_until(lambda: any("because the crank spins at " in line for line in lines), "the cause")


def test_stalls_are_logged_at_first_and_then_once_a_minute_with_their_cause():
    clock, lines = [100.0], []
    report = StallReport(lines.append, lambda: clock[0])
    clock[0] += 10.0
    report.add(0.2, 0.2, busy=0.1, ticks=2000, speed=100.0)
    for _ in range(60):
        clock[0] += 1.01
        report.add(0.5, 30.2, busy=0.1 + 58.0, ticks=3000, speed=100.0)
    report.add(0.5, 30.7, busy=59.0, ticks=3000, speed=-2e6)  # another cause is said at once
    report.add(0.5, 31.2, busy=60.0, ticks=3000, speed=-2e6)
    first, second, third = lines
    assert first.startswith("stalled: 0.200 s of simulated time dropped, because the computer did not let the robot")
    assert second.startswith(f"stalled 60 times in {SUMMARY_PERIOD * 1.01:.0f} s: 30.000 s of simulated time dropped, "
                             "30.200 s since the start, because a step takes 19 ms, longer than it lasts; lower rate.")
    assert "because the crank spins at -2e+06 rad/s" in third
