"""The live view with real robots: what it shows of them, and what it sends to them."""

import re
import signal
import time

import numpy as np
import pytest
from asking import set_parameter
from observation import stop
from real_processes import CRAWL
from sensor_msgs.msg import JointState

import vibro_ros
from vibro_ros.view.protocol import COLUMNS


def column(rows: np.ndarray, name: str) -> np.ndarray:
    return rows[:, COLUMNS.index(name)]


def test_what_is_sent_is_what_was_published_in_one_row_a_sample(start, view, visit):
    page = visit(view)
    start("robot", *CRAWL, "-p", "scene:=machine")  # with a dc motor, whose voltage and current are shown, too
    robot = page.wait_for_robot(name="/vibro_robot")
    assert robot["columns"] == list(COLUMNS) and robot["machine"]["name"] == "machine"
    rows = page.wait_for_rows(400)
    times = column(rows, "time")
    assert np.allclose(np.diff(times), 0.005, rtol=0.0, atol=1e-9)  # none is missing
    assert np.abs(np.diff(column(rows, "motor_current"))).max() > 0.1 and column(rows, "motor_voltage").max() > 10.0
    device = vibro_ros.Simulator(vibro_ros.load_scene("machine").with_parameters({"motor.speed": 100.0}))
    device_rows = []
    for tick in np.round(times * 200.0):
        device.advance_to(tick / 200.0)
        device_rows.append([getattr(device.state, name) for name in COLUMNS])
    for name in COLUMNS[1:]:
        expected = np.array([row[COLUMNS.index(name)] for row in device_rows])
        assert np.array_equal(column(rows, name), expected), name
    impacts = page.wait(lambda: page.last("impacts"), "impacts")["list"]
    assert all(impact["side"] in ("upper", "inclined") and impact["peak_force"] > 0.0 for impact in impacts)
    status = page.wait(lambda: page.last("status"), "status")
    assert status["recording"] == "" and 0.0 <= status["dropped_share"] < 1.0 and status["refused"] == 0
    stop(view)


def test_commands_services_and_refusals_in_the_robot_s_words(start, view, visit, bench):
    speeds = [float("nan")]  # of the crank
    bench.node.create_subscription(JointState, "joint_states", lambda message: speeds.append(message.velocity[0]), 10)
    start("robot", *CRAWL)
    page = visit(view)
    page.wait_for_robot(offers={"reset": True, "step": True, "pause": True, "record": True})
    assert page.ask(command="motor_speed", value=1e6)["done"]
    refusal = "command refused: /motor_speed: 1e+06 is out of range; give a number from -500 to 500 rad/s"
    page.wait(lambda: any(text["kind"] == "log" and text["words"].startswith(refusal) for text in list(page.texts)),
              "the refusal")
    assert page.ask(call="step") | {"id": 0} == {"kind": "answer", "id": 0, "done": False,
                                                 "words": "the robot is not paused; call ~/pause with true first"}
    paused = page.ask(call="pause", on=True)
    page.wait(lambda: page.last("status").get("paused"), "the pause")
    at = float(re.search(r"paused at (\S+) s", paused["words"])[1])
    page.wait(lambda: column(page.rows[-1], "time")[-1] == pytest.approx(at, rel=1e-8), "the robot's own time")
    assert page.ask(call="step")["words"].startswith("stepped 1 of 1 periods")
    assert page.ask(call="pause", on=False)["done"]
    assert page.ask(command="upper_gap", value=0.0005)["done"]
    page.wait_for_rows(100)
    page.wait(lambda: column(page.rows[-1], "upper_plate_position")[-1] == 0.0605, "the gap")
    late = visit(view)  # its knobs show what is in force, not what the scene began with, nor what was refused
    late.wait(lambda: late.last("commands").get("values") == {"upper_gap": 0.0005}, "what is in force")
    assert page.ask(parameter="ground.friction", value=2e3)["words"].startswith("ground.friction: 2000")
    assert page.ask(parameter="ground.friction", value=0.4)["done"]
    late.wait(lambda: late.last("robot")["machine"]["knobs"][-1]["value"] == 0.4, "the floor")
    robot_before = page.last("robot")
    set_parameter(bench, "motor.max_speed", 150.0)  # by somebody else
    late.wait(lambda: late.last("robot")["machine"]["knobs"][0]["to"] == 150.0, "the new limit")
    assert late.last("robot")["origin"] == robot_before["origin"]
    assert page.ask(command="motor_speed", value=50.0)["done"]
    late.wait(lambda: late.last("commands")["values"].get("motor_speed") == 50.0, "the command of another page")
    stop(view, number=signal.SIGTERM)
    assert any(line.endswith("commanded from a page; sent motor_speed 0") for line in view.lines), view.text
    bench.spin_until(lambda: speeds[-1] == 0.0, "nobody is left who could stop the motor")


def test_a_robot_that_is_started_anew_or_killed_is_picked_up_again_and_a_second_one_of_its_name_is_not_drawn(
        udp_only, start, view, visit, domain_id):
    page = visit(view)
    page.wait_for_absence(f"no robot /vibro_robot, nor another one, in ROS domain {domain_id}; start one there")
    view.wait_for("nor another one")
    robot = start("robot", *CRAWL)
    first = page.wait_for_robot()
    assert page.ask(command="upper_gap", value=0.0005)["done"]
    page.wait(lambda: page.last("commands")["values"] == {"upper_gap": 0.0005}, "what is in force")
    stop(robot)
    page.wait_for_absence("no robot")
    robot = start("robot", *CRAWL, "-p", "crank.radius:=0.015")
    second = page.wait_for_robot()
    assert second["machine"]["crank_radius"] == 0.015 and int(second["origin"]) > int(first["origin"])
    page.wait_for_rows(50)
    assert page.last("commands")["values"] == {}  # nobody has commanded this one
    assert page.ask(command="motor_speed", value=50.0)["done"]
    page.wait(lambda: page.last("commands")["values"] == {"motor_speed": 50.0}, "what is in force")
    assert "crank_radius" not in first or first["machine"]["crank_radius"] == 0.02
    robot.kill()
    page.wait_for_absence("has not been heard for 3 s")
    start("robot", *CRAWL)
    begun = time.monotonic()
    third = page.wait_for_robot()  # and not the killed one again, whatever of the new one is heard first
    assert third["machine"]["crank_radius"] == 0.02 and int(third["origin"]) > int(second["origin"])
    assert column(page.wait_for_rows(100), "time")[0] < time.monotonic() - begun + 1.0  # counted from the new origin
    assert page.last("commands")["values"] == {}
    other = start("robot", *CRAWL)
    page.wait_for_absence("two robots publish on /vibro_robot/samples; give one of them a namespace")
    stop(other)
    page.wait_for_robot()
    page.wait_for_rows(100)
    stop(view)


def test_a_robot_in_a_namespace_under_another_name(start, visit, view):
    stranger = visit(view)
    view = start("live_view", "--port", "0", "--robot", "crawler", "--ros-args", "-r", "__ns:=/r1")
    start("robot", *CRAWL, "-r", "__ns:=/r1", "-r", "__node:=crawler", "-r", "odom:=there", "-p", "frame_prefix:=r1/")
    page = visit(view)
    page.wait_for_robot(name="/r1/crawler")
    page.wait_for_rows(50)
    stranger.wait_for_absence("but /r1/crawler; to show the first: view --robot /r1/crawler --ros-args -r __ns:=/r1")
    page.wait(lambda: page.last("impacts"), "impacts")
    assert page.ask(call="reset")["done"]
    page.wait_for_rows(50)  # robot time goes on through a reset
    assert np.allclose(np.diff(column(np.concatenate(page.rows), "time")), 0.005, rtol=0.0, atol=1e-9)
    assert page.ask(command="motor_speed", value=-600.0)["done"]
    page.wait(lambda: any("command refused" in text.get("words", "") for text in list(page.texts)), "the refusal")
    stop(view)
