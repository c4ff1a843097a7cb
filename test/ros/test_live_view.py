"""The live view: messages of samples and commands of its page, real robots that it shows, strangers who publish
anything, and its start and end.
"""

import random
import re
import signal
import socket
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from asking import set_parameter
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from observation import stop
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from real_processes import CRAWL, takes_signals, wait_until
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, MultiArrayDimension, String
from web_client import address_of

import vibro_ros
from vibro_ros.messages.codec import jazzy_types
from vibro_ros.messages.operations import RESET, TIMEOUT, Operation
from vibro_ros.messages.robot_messages import SAMPLE_LABELS, RobotMessages
from vibro_ros.messages.topics import SAMPLES, TOPICS
from vibro_ros.ros.live import view as live_view
from vibro_ros.ros.live.commands import RETURN_TIMEOUT, PageCommands
from vibro_ros.ros.live.robot import LONGEST, LONGEST_RUN, SECOND, Runs, read_sample
from vibro_ros.simulation.samples import FIELDS, TIME
from vibro_ros.view.protocol import COLUMNS


def column(rows: np.ndarray, name: str) -> np.ndarray:
    return rows[:, COLUMNS.index(name)]


def test_a_page_gets_one_row_for_each_published_sample(start, view, visit):
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


def test_pages_command_the_robot_and_get_its_answers(start, view, visit, bench):
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


def test_a_restarted_robot_is_shown_again_and_two_robots_of_one_name_are_not(
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


START = 1_763_700_000_123_456_789
KIND = TOPICS[SAMPLES].type
NUMBERS = np.array([(-1) ** i * (i + 1) / 7.0 for i in range(len(FIELDS))])
GOOD = RobotMessages(vibro_ros.load_scene("machine")).whole_sample(NUMBERS, START, 12.5)


def test_samples_are_read_exactly_in_both_byte_orders():
    store, expected = jazzy_types(), NUMBERS.copy()
    expected[TIME] = 12.5  # robot time, not the device's
    other_order = store.serialize_cdr(store.deserialize_cdr(GOOD, KIND), KIND, little_endian=False)
    for data in (GOOD, GOOD + bytes(3), bytes(other_order)):
        start, values = read_sample(data)
        assert start == START and values.tolist() == expected.tolist()


def changed(**fields: object) -> bytes:
    """Return a valid message with other values of a field, given by its name, or of `label`."""
    store = jazzy_types()
    message = store.deserialize_cdr(GOOD, KIND)
    message.layout.dim[0].label = fields.pop("label", message.layout.dim[0].label)
    data, names = message.data.copy(), message.layout.dim[0].label.split(",")
    for name, value in fields.items():
        data[names.index(name)] = value
    message.data = data
    return bytes(store.serialize_cdr(message, KIND))


@pytest.mark.parametrize("bad", [
    b"", b"\0\1\0\0", GOOD[:-1], GOOD[:50], GOOD + bytes(8), b"\0\3" + GOOD[2:], GOOD + bytes(LONGEST),
    np.random.default_rng(5).bytes(len(GOOD)), changed(label="start_seconds,start_nanoseconds,time"),
    changed(body_position=np.nan), changed(electrical_power=np.inf), changed(time=-1.0), changed(time=LONGEST_RUN),
    changed(start_seconds=-1.0), changed(start_seconds=2.0**31), changed(start_nanoseconds=float(SECOND)),
    changed(start_seconds=np.nan)])
def test_invalid_samples_are_left_out(bad):
    assert read_sample(bad) is None


def test_one_change_of_the_start_time_is_a_restart_and_two_are_two_robots():
    now = [0.0]
    runs = Runs(lambda: now[0])
    assert not runs.restarted([7, 7, 7], [40.0, 41.0, 42.0])
    assert not runs.restarted([], [])
    assert not runs.restarted([7, 7], [43.0, 47.0])  # some were lost
    now[0] = 10.0
    assert runs.restarted([8, 8], [50.0, 51.0]) and not runs.rivals
    now[0] = 13.0
    assert runs.restarted([8], [0.0]) and not runs.rivals  # robot time drives ROS time: each start is at 0
    now[0] = 13.5
    assert not runs.restarted([8], [200.0]) and not runs.rivals
    assert runs.restarted([8], [2.0]) and runs.rivals
    now[0] = 15.4
    assert runs.rivals
    now[0] = 15.6
    assert not runs.rivals
    assert runs.restarted([8, 9, 8, 9, 8], [3.0, 201.0, 4.0, 202.0, 5.0]) and runs.rivals


SCENE = vibro_ros.load_scene("device")


class TwoCommanders:
    """The view's commands, a robot that subscribes to them, and another node that commands."""

    def __init__(self, bench):
        self.received: list[float] = []
        self.now = 100.0
        self.commands, self._bench = PageCommands(bench.node, lambda: self.now), bench
        bench.node.create_subscription(Float64, "motor_speed", lambda message: self.received.append(message.data), 10)
        self._other = bench.node.create_publisher(Float64, "motor_speed", 10)
        bench.spin_until(lambda: self._other.get_subscription_count() >= 2, "both listen")

    def page(self, *speeds: float) -> None:
        """Send commands of a page, and wait until the last one is in force."""
        answers: list[bool] = []
        for speed in speeds:
            self.commands.send("motor_speed", speed, lambda done, words: answers.append(done))
        assert answers == [True] * len(speeds)
        self.wait_for(speeds[-1])

    def other(self, speed: float) -> None:
        self._other.publish(Float64(data=speed))
        self.wait_for(speed)

    def wait_for(self, speed: float) -> None:
        def received() -> bool:
            self.commands.take(SCENE, [])
            return self.received[-1:] == [speed] and self.commands.in_force.get("motor_speed") == speed
        self._bench.spin_until(received, f"{speed} rad/s")


@pytest.fixture
def commanders(bench):
    return TwoCommanders(bench)


def test_a_motor_stops_when_the_pages_that_commanded_it_are_closed(commanders):
    device = commanders.commands
    commanders.page(50.0)
    assert device.of_page and not device.stop_if_alone(1, 0.0)
    commanders.page(1e6, 55.0)
    assert device.of_page and device.in_force == {"motor_speed": 55.0}
    commanders.now += 0.9 * RETURN_TIMEOUT
    assert not device.stop_if_alone(0, 0.0)  # a page that is loaded again comes back in time
    commanders.now += 0.2 * RETURN_TIMEOUT
    assert device.stop_if_alone(0, 0.0) and not device.stop_if_alone(0, 0.0)
    commanders.wait_for(0.0)
    commanders.page(60.0)
    commanders.other(80.0)
    assert device.in_force == {"motor_speed": 80.0} and not device.of_page
    commanders.now += 2.0 * RETURN_TIMEOUT
    assert not device.stop_if_alone(0, 0.0) and not device.end()
    for operation in (TIMEOUT, RESET):
        commanders.page(70.0)
        device.take(SCENE, [Operation(operation)])
        assert not device.of_page and device.in_force == {}
    commanders.page(90.0)
    assert device.end() == "sent motor_speed 0"
    commanders.wait_for(0.0)


def test_a_pages_command_is_repeated_for_a_robot_with_a_timeout(commanders, bench):
    commanders.page(50.0)
    for number in range(3):
        commanders.now += 0.2
        assert not commanders.commands.stop_if_alone(1, 0.5)
        bench.spin_until(lambda number=number: len(commanders.received) == number + 2, "the command again")


KINDS = {"/vibro_robot/samples": Float64MultiArray, "impacts": WrenchStamped, "/diagnostics": DiagnosticArray,
         "/rosout": Log, "/vibro_robot/operations": String}
ROUNDS = 150


def strange_messages(chance: random.Random) -> list[tuple[str, bytes]]:
    """Yield random bytes, and well-formed messages with contents that no robot sends."""
    sample = Float64MultiArray(data=[chance.choice((float("nan"), float("inf"), -5.0, 1e300)) for _ in SAMPLE_LABELS])
    sample.layout.dim = [MultiArrayDimension(label=chance.choice((",".join(SAMPLE_LABELS), "x", "\n" * 900)))]
    impact = WrenchStamped()
    impact.header.frame_id, impact.wrench.force.z = chance.choice(("upper_plate", "x" * 3000)), chance.choice(
        (float("nan"), 1e9))
    boast = DiagnosticArray(status=[DiagnosticStatus(
        name="vibro_robot: simulation", hardware_id=chance.choice(("/other", "")), message="\n" * 50,
        values=[KeyValue(key="real-time factor", value=chance.choice(("nan", "9" * 400, "")))])])
    log_line = Log(level=50, name="somebody.else", msg="\x1b[31mhaha\n" * 30)
    operation = String(data=chance.choice(("set {", "reset reset", "step x", "set " + "[" * 2000, "fly")))
    whole = {"/vibro_robot/samples": sample, "impacts": impact, "/diagnostics": boast, "/rosout": log_line,
             "/vibro_robot/operations": operation}
    messages = [(topic, bytes(serialize_message(message))) for topic, message in whole.items()]
    messages += [(topic, chance.randbytes(chance.randrange(1, 1200))) for topic in KINDS]
    messages += [(topic, b"\0\1\0\0" + struct.pack("<iI", 2**31 - 1, 999_999_999) + b"\xff" * 50) for topic in KINDS]
    return messages


def test_messages_of_other_programs_change_nothing(start, bench, view, visit):
    chance, page = random.Random(17), visit(view)
    start("robot", *CRAWL)
    page.wait_for_robot()
    publishers = bench.publishers(KINDS)
    begin = len(page.rows)
    page.wait_for_rows(50)
    for _ in range(ROUNDS):
        for topic, data in strange_messages(chance):
            publishers[topic].publish(data)
        bench.spin_once()
    page.wait_for_rows(100)
    rows = np.concatenate(page.rows[begin:])
    assert np.isfinite(rows).all()
    assert np.allclose(np.diff(rows[:, 0]), 0.005, rtol=0.0, atol=1e-9)  # none is missing, none too many
    angle = rows[:, COLUMNS.index("crank_angle")]
    assert np.allclose(np.diff(angle), 0.5, rtol=0.0, atol=1e-9)
    logs = [text["words"] for text in page.texts if text["kind"] == "log"]
    assert not any("haha" in words or "\n" in words for words in logs)
    assert all(impact["peak_force"] < 1e8
               for text in page.texts if text["kind"] == "impacts" for impact in text["list"])
    view.wait_for("/vibro_robot/samples: refused: ")
    page.wait_for_robot()
    stop(view)
    assert "Traceback" not in view.text and "please report" not in view.text, view.text
    assert len(view.lines) < 200  # a flood does not fill the log


def test_a_node_with_the_robots_name_that_is_no_robot_is_not_shown(start, bench, visit):
    """A node with the robot's name whose parameters are not a robot's is not drawn, and the page says why."""
    view = start("live_view", "--port", "0", "--robot", "bench")
    page = visit(view)
    bench.node.create_publisher(Float64MultiArray, "bench/samples", 10)
    bench.spin_until(lambda: page.last("absent").get("words", "").startswith("/bench cannot be shown: it answers 0 "
                                                                             "values"), "the words")
    stop(view)


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def test_a_signal_at_any_instant_of_the_start_ends_the_view_cleanly(start):
    view, number = start("view", "--port", "0"), random.choice(SIGNALS)
    wait_until(lambda: takes_signals(view.pid), "the start's signal handlers")
    time.sleep(random.uniform(0.0, 1.5))  # the instant is by chance
    view.send(number)
    assert view.end() == 0 and "Traceback" not in view.text, view.text


def test_many_signals_end_the_view_cleanly_with_pages_open(start, view, visit):
    pages = [visit(view) for _ in range(3)]
    start("robot", *CRAWL)
    for page in pages:
        page.wait_for_rows(10)
    for number in SIGNALS:
        view.send(number)
    assert view.end() == 0 and "Traceback" not in view.text, view.text
    for page in pages:
        page.wait(lambda page=page: page.closed, "the connection's end")


@pytest.mark.parametrize(("words", "line"), [
    ([], "--port {port}: something listens there already, perhaps another view; give another port, or --port 0 for any "
     "that is free"),
    (["--port", "65536"], "argument --port: 65536 is no port; give a number from 0 to 65535, 0 for any that is free"),
    (["--address", "192.0.2.1", "--port", "0"], "--address 192.0.2.1: nothing can listen there"),
    (["--robot", "1bad", "--port", "0"], "--robot 1bad: no node's name; give one such as /r1/vibro_robot"),
])
def test_a_wrong_argument_is_refused_in_one_line(refusal, monkeypatch, words, line):
    monkeypatch.setattr("os.nice", lambda _: None)  # or all tests that follow would be nice
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert refusal(live_view.main, *(words or ["--port", port])).startswith(f"view: {line.format(port=port)}")


def test_a_view_for_other_machines_warns_and_no_command_line_has_the_token(start, visit, tmp_path, monkeypatch):
    browser, received = tmp_path / "browser", tmp_path / "heard"
    browser.write_text(f'#!/bin/sh\necho "$1" > {received}.part; mv {received}.part {received}\n')
    browser.chmod(0o700)
    monkeypatch.setenv("BROWSER", f"{browser} %s")
    view = start("live_view", "--port", "0", "--address", "0.0.0.0", "--open")
    view.wait_for("other machines reach this page, and who has its whole address commands the robot")
    address = address_of(view)
    page = visit(view)
    page.wait_for_absence("no robot")
    page.wait(received.exists, "the browser")
    url = received.read_text().strip()
    redirect = Path(url.removeprefix("file://"))
    assert address.token not in url and f"url={address.url}" in redirect.read_text()
    assert redirect.stat().st_mode & 0o777 == 0o600
    view.send(signal.SIGINT)
    assert view.end() == 0 and not redirect.exists()
