"""The diagnostics of a real robot, up to its last message."""

import signal
import time
from types import SimpleNamespace

import pytest
from asking import answer_of
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from observation import bags, stamps_of, stop, value_of
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64
from std_srvs.srv import SetBool
from test_run import run_of

from vibro_ros.ros.node.process import node_running, spin_until
from vibro_ros.ros.robot import diagnostics


def values_of(listener) -> dict[str, str]:
    return {pair.key: pair.value for pair in listener.parts["vibro_robot: simulation"].values}


def test_the_last_diagnostics_of_a_failed_simulation_arrive(start, listener):
    """Steps of 0.01 s are far too long, and diverge after half a second of robot time."""
    robot = start("robot", "--ros-args", "-p", "solver.method:=rk4", "-p", "solver.step:=0.01", "-p",
                  "rate.real_time_factor:=0.1")
    listener.wait_for_status("simulation", lambda status: status.level == DiagnosticStatus.OK)
    status, _ = listener.wait_for_status("simulation", lambda status: status.level == DiagnosticStatus.ERROR)
    assert robot.end() == 1
    assert "a coordinate is no longer finite" in status.message
    assert f"robot: {status.message}" in robot.lines


def test_the_last_diagnostics_of_a_recording_that_failed_at_its_end_arrive(start, listener, tmp_path):
    robot = start("robot")
    listener.wait_for_status("recorder", lambda status: status.level == DiagnosticStatus.OK)
    bags(tmp_path)[0].rename(tmp_path / "away")  # at once; files that go one after the other are told of differently
    robot.send(signal.SIGINT)
    status, values = listener.wait_for_status("recorder", lambda status: status.level == DiagnosticStatus.ERROR)
    assert robot.end() == 1
    assert status.message == values["fault"] and "the folder is gone" in status.message


def test_diagnostics_have_the_state_of_simulation_and_recorder(start, listener, bench, tmp_path):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0", "-p", "solver.accounts:=true",
                  "-p", "qos_overrides./motor_speed.subscription.reliability:=best_effort")
    hasty = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    speed = bench.node.create_publisher(Float64, "motor_speed", hasty)
    status, values = listener.wait_for_status("simulation", lambda status: status.level == DiagnosticStatus.OK)
    assert status.hardware_id == "/vibro_robot"
    assert float(values["real-time factor"]) > 0.2  # on however busy a machine
    assert 0.1 < float(values["cost of a step [us]"]) < 1e5
    assert 0.0 < float(values["share of time spent simulating"]) <= 1.0
    assert values["accuracy in force"].startswith("rounding: 8.6e-13 m for 0.2 s")
    assert float(values["events per second"]) > 10
    assert values["solver method"] == "exact"
    assert abs(float(values["energy residual [J]"])) < 1e-6
    assert int(values["missed deadlines"]) >= 0
    late = [float(values[f"lateness {name} [us]"]) for name in ("median", "p99", "max")]
    assert 0.0 < late[0] and late == sorted(late)
    # rule hop: airborne after a stronger blow, on the ground between them
    status, _ = listener.wait_for_status("simulation", lambda status: value_of(status, "share of time with N<0") > 0.0)
    assert value_of(status, "share of time with N<0") < 1.0
    bench.spin_until(lambda: speed.get_subscription_count() > 0, "robot up")
    speed.publish(Float64(data=-501.0))
    status, values = listener.wait_for_status("simulation", lambda status: "commands refused" in status.message)
    assert (status.level, values["rejected commands"]) == (DiagnosticStatus.WARN, "1")
    status, values = listener.wait_for_status("recorder", lambda status: True)
    assert (status.level, values["dropped"], values["lost"]) == (DiagnosticStatus.OK, "0", "0")
    assert int(values["written"]) > 0 and int(values["backlog"]) >= 0 and values["fault"] == ""
    assert values_of(listener)["nodes of this name"] == "1" and float(values_of(listener)["stamps behind [s]"]) < 1.0
    namesake = Node("vibro_robot", context=bench.node.context)
    status, _ = listener.wait_for_status("simulation", lambda status: "2 nodes are named" in status.message)
    assert status.level == DiagnosticStatus.WARN
    robot.wait_for("2 nodes are named /vibro_robot: all of them take each command")
    namesake.destroy_node()
    for on in (True, False):
        answer = answer_of(bench, SetBool, "/vibro_robot/pause", data=on).message
        if on:
            assert "meanwhile stamps fall behind the wall clock, unless clock.publish" in answer
            bench.spin_until(lambda: float(values_of(listener)["stamps behind [s]"]) > 2.0, "stamps that fall behind")
    status, _ = listener.wait_for_status("simulation", lambda status: "s of pauses or stalls" in status.message)
    assert status.level == DiagnosticStatus.OK and status.message.startswith("running; stamps are ")
    robot.send(signal.SIGSTOP)
    time.sleep(0.5)  # the stall itself
    robot.send(signal.SIGCONT)
    status, values = listener.wait_for_status("simulation", lambda status: "dropped" in status.message)
    assert status.level == DiagnosticStatus.WARN and float(values["dropped time [s]"]) > 0.3
    stop(robot)
    assert "because the computer did not let the robot run in time; " in robot.wait_for("stalled: ")
    stamps = stamps_of(bags(tmp_path)[0])
    assert {after - stamp for stamp, after in zip(stamps, stamps[1:], strict=False)} == {5_000_000}  # [ns]


def test_diagnostics_name_a_clock_that_was_set_and_a_pause(domain_id, monkeypatch):
    """The real node and run, with another clock than the computer's, which the test must not set."""
    monkeypatch.setattr(diagnostics, "NEWS", 0.5)  # s
    clock_shift = 0.0
    with node_running("vibro_robot", []) as node:
        def now() -> int:
            return time.time_ns() + round(1e9 * clock_shift)

        run = run_of(SimpleNamespace(node=node), lambda *_: None, rate_publish=100.0,
                     rate_real_time_factor=1.0, rate_max_catch_up=600.0)
        run.recording.latest, run.recording.destination = None, lambda: "not recording"
        heard: list[DiagnosticArray] = []
        node.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
        run.robot_time.start, begin = now(), time.monotonic()
        with run.start(begin):
            diagnostics.Diagnostics(node, run, now)

            def told(condition) -> DiagnosticStatus:
                """Return the next status that meets the condition."""
                deadline = time.monotonic() + 60.0
                while True:
                    spin_until(node, lambda: heard or time.monotonic() > deadline)
                    assert heard, "no such status within 60 s"
                    if condition(status := heard.pop(0).status[0]):
                        return status

            assert told(lambda status: True).message == "running"
            clock_shift = 3600.0
            status = told(lambda status: status.level == DiagnosticStatus.WARN)
            words = "behind the wall clock, because the wall clock has gone 3600.00 s ahead of the computer's monotonic"
            assert words in status.message and "pauses" not in status.message
            assert value_of(status, "clock set by [s]") == pytest.approx(3600.0, abs=0.1)
            status = told(lambda status: status.level == DiagnosticStatus.OK)
            assert words in status.message  # no warning any more, but still said
            run.pause()
            for _ in range(3):
                told(lambda status: status.message == "paused")
            run.resume()
            status = told(lambda status: "and because robot time stood still for " in status.message)
            assert status.level == DiagnosticStatus.OK and "because the wall clock has gone 3600" in status.message
            run.pause()  # which takes the real-time priority away


def test_diagnostics_warn_where_the_model_is_not_valid(start, listener):
    start("robot", "--ros-args", "-p", "scene:=machine", "-p", "motor.speed:=100.0", "-p", "body.crank_offset:=0.03",
          "-p", "motor.continuous_current:=0.5")
    status, values = listener.wait_for_status("simulation", lambda status: "the pitch index" in status.message
                                              and "rms current" in status.message)
    assert status.level == DiagnosticStatus.WARN
    assert float(values["pitch index"]) > 0.2 and float(values["rms current over continuous"]) > 1.0
