"""Robot, view and browser together: the page shows what the robot publishes, and the page's requests are carried out.
"""

import contextlib
import time
from collections import defaultdict

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from observation import stop
from page_reading import drawn, drawn_frames, enter, robot_message, shows_robot, until
from rcl_interfaces.msg import Log
from rclpy.qos import QoSProfile
from real_processes import CRAWL
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from vibro_ros.messages.frames import JOINTS

QOS = QoSProfile(depth=10_000)


class Published:
    """The robot's samples by their stamps [ns], received by a node of the test."""

    def __init__(self, bench):
        self.samples: dict[int, dict[str, float]] = defaultdict(dict)
        self._bench, self._newest = bench, 0  # stamp of which both messages have come
        bench.node.create_subscription(Odometry, "odom", self._hear_body, QOS)
        bench.node.create_subscription(JointState, "joint_states", self._hear_joints, QOS)

    def hear_until(self, stamp: int) -> None:
        """Receive until a sample later than an instant [ns] has come."""
        self._bench.spin_until(lambda: self._newest > stamp, "samples")

    def _hear_body(self, message: Odometry) -> None:
        position, velocity = message.pose.pose.position, message.twist.twist.linear
        self._take(message, {"body_position": position.x, "body_height": position.z,
                             "body_velocity": velocity.x, "body_vertical_velocity": velocity.z})

    def _hear_joints(self, message: JointState) -> None:
        joints = zip(message.name, message.position, message.velocity, message.effort, strict=True)
        self._take(message, {field: value for name, *values in joints
                             for field, value in zip(JOINTS[name], values, strict=True)})

    def _take(self, message: Odometry | JointState, values: dict[str, float]) -> None:
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        self.samples[stamp] |= values
        if {"body_position", "crank_angle"} <= self.samples[stamp].keys():
            self._newest = max(self._newest, stamp)


@pytest.fixture
def published(bench) -> Published:
    """The robot's published samples; tests must request this fixture before they start the robot."""
    return Published(bench)


def open_robot(page, view) -> None:
    page.goto(view.address.url)
    until(page, shows_robot)


def test_the_page_of_a_running_robot(start, published, view, open_page, bench):
    """The robot is changed only by a pause and a command at the end, so one robot serves all checks."""
    start("robot", *CRAWL)
    published.hear_until(0)  # from here on every sample is heard
    page = open_page()
    for _ in range(9):  # one more than may be open at once: a page that is left makes room
        open_robot(page, view)
    shows_what_was_published(page, view, published)
    shows_words_of_strangers_as_text(page, bench)
    shows_slow_motion_of_the_last_second(page)
    pages = [page, open_page(), open_page()]
    for page in pages[1:]:
        open_robot(page, view)
    pages[0].click("#pause")
    for page in pages:
        until(page, stands_still, "time stands still")
    assert len({str(drawn(page)) for page in pages}) == 1
    enter(pages[1], "motor_speed", "20")
    pages[2].click("#pause")
    for page in pages:
        until(page, lambda page: drawn(page)["quantities"]["motor_speed"] == 20.0, "the command of another page")


def shows_what_was_published(page, view, published) -> None:
    with view.address.visit() as visit:
        origin = int(visit.wait_for("robot")["origin"])
    frames = drawn_frames(page, 120)  # of the browser; the view hears the robot 30 times a second
    assert len({frame["time"] for frame in frames}) >= 20
    published.hear_until(origin + round(frames[-1]["time"] * 1e9))
    for frame in frames:
        sample = published.samples[origin + round(frame["time"] * 1e9)]
        assert {name: frame["quantities"][name] for name in sample} == sample  # bit for bit
    until(page, lambda page: page.inner_text("#real-time-factor").strip("–× ") != "", "real-time factor")
    assert 0.0 < float(page.inner_text("#real-time-factor").replace("×", "")) < 1.5
    assert 0.0 <= float(page.inner_text("#dropped").replace("%", "")) <= 100.0


def shows_words_of_strangers_as_text(page, bench) -> None:
    (publisher,) = bench.publishers({"/rosout": Log}).values()
    evil = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>\u2028"
    deadline = time.monotonic() + 30.0
    while "<img src=x" not in robot_message(page):
        publisher.publish(Log(level=40, name="vibro_robot", msg=evil))
        assert time.monotonic() < deadline
        page.wait_for_timeout(50)
    assert page.locator("#said img, #said script").count() == 0 and page.title() != "owned"


def shows_slow_motion_of_the_last_second(page) -> None:
    until(page, lambda page: drawn(page)["time"] > 1.2, "a second")
    page.click("#slow")
    until(page, lambda page: page.is_enabled("#timeline"), "slow motion")
    begin, end = (float(page.get_attribute("#timeline", name)) for name in ("min", "max"))
    assert end - begin == pytest.approx(1.0, abs=0.011)
    assert page.inner_text("#exactness").startswith("interpolated here: a live robot is drawn between its samples")
    page.select_option("#speed", "0.001")
    page.click("#next")
    first = drawn_frames(page, 3)[-1]["time"]  # a click shows in the next picture
    page.click("#next")
    assert begin <= first < drawn_frames(page, 3)[-1]["time"] <= end
    page.press("body", "Escape")
    until(page, lambda page: drawn(page)["time"] > end, "live again")


@pytest.mark.quiet  # beside three other tests its page falls behind the robot by more than the test waits
def test_the_robot_does_what_a_page_requests_and_the_page_shows_the_commands_in_force(start, view, open_page, bench,
                                                                                  tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false")
    heard: list[float] = []
    bench.node.create_subscription(Float64, "motor_speed", lambda message: heard.append(message.data), 10)
    page = open_page()
    open_robot(page, view)
    speed = commanded_speed(page, bench, heard)
    enter(page, "upper_gap", "0,5", key="Tab")  # a German keyboard's decimal sign; typed in mm, sent in m
    until(page, lambda page: abs(drawn(page)["quantities"]["upper_plate_position"] - 0.0605) < 1e-12, "the gap")
    enter(page, "motor_speed", "1e6")
    robot.wait_for("1e+06")
    bench.spin_until(lambda: heard[-1] == 1e6, "what was refused")
    assert drawn(page)["quantities"]["motor_speed"] == speed
    assert "1000000 is refused; the robot takes -500 to 500" in page.inner_text("#motor_speed_words")
    until(page, lambda page: shown(page, "motor_speed") == [speed] * 3, "the speed in force")
    assert page.inner_text("#motor_speed_words") == ""  # gone with the number that was refused
    assert "refused" not in robot_message(page)  # nor is it said a second time
    enter(page, "motor_speed", "4.5.0")
    assert "“4.5.0” is no number" in page.inner_text("#motor_speed_words")
    until(page, lambda page: page.inner_text("#motor_speed_words") == "", "enough time to read it")
    assert shown(page, "motor_speed") == [speed] * 3  # what is in force
    assert heard[-1] == 1e6  # nothing was sent
    follows_what_is_in_force(page, bench)
    sets_another_floor(page, view)
    keeps_the_last_line_in_view(page)
    saves_samples(page, tmp_path)
    stops_the_motor_that_a_page_has_commanded(page, view, bench, heard)


def shown(page, name: str) -> list[float]:
    """Return the contents of a knob's field, slider and label."""
    return [float(page.input_value(f"#{name}")), float(page.input_value(f".knob:has(#{name}) [type=range]")),
            float(page.inner_text(f"#{name}_now").removeprefix("now "))]


def follows_what_is_in_force(page, bench) -> None:
    publisher = bench.node.create_publisher(Float64, "motor_speed", 10)
    bench.spin_until(lambda: publisher.get_subscription_count() >= 2, "robot and view")
    publisher.publish(Float64(data=110.0))
    until(page, lambda page: shown(page, "motor_speed") == [110.0] * 3, "another node's command")
    page.focus(".knob:has(#motor_speed) [type=range]")
    page.keyboard.press("ArrowUp")
    until(page, lambda page: drawn(page)["quantities"]["motor_speed"] == 110.5, "one step from what is in force")
    enter(page, "motor_speed", "1e6")
    assert "is refused" in page.inner_text("#motor_speed_words")
    page.click("#reset")
    assert page.inner_text("#motor_speed_words") == ""
    until(page, lambda page: shown(page, "motor_speed") == [0.0] * 3, "the start")
    until(page, lambda page: shown(page, "upper_gap") == [0.0] * 3, "the start")


def sets_another_floor(page, view) -> None:
    enter(page, "ground_friction", "0,35")
    with view.address.visit() as visit:
        while visit.wait_for("robot")["machine"]["knobs"][-1]["value"] != 0.35:
            pass
    enter(page, "ground_friction", "-1")
    until(page, lambda page: "-1 is refused" in page.inner_text("#ground_friction_words"), "the refusal")
    until(page, lambda page: page.input_value("#ground_friction") == "0.35", "what is in force")


def keeps_the_last_line_in_view(page) -> None:
    size = page.viewport_size
    for _ in range(4):
        page.click("#pause")
    until(page, lambda page: page.locator("#said p").count() >= 4, "the answers")
    for width in (500, 400, 350, size["width"]):
        page.set_viewport_size({**size, "width": width})
        until(page, lambda page: page.evaluate(
            "(({scrollTop, clientHeight, scrollHeight}) => scrollTop + clientHeight >= scrollHeight - 1)"
            "(document.querySelector('#said'))"), f"the last line at a width of {width}")


def saves_samples(page, folder) -> None:
    samples = np.genfromtxt(saved(page, "#save-samples", folder / "samples.csv"), delimiter=",", names=True)
    assert np.all(np.diff(samples["time"]) > 0.0) and samples["time"][-1] - samples["time"][0] > 1.0
    row = samples[len(samples) // 2]
    shown = page.evaluate("time => vibro.show(time)", row["time"])["quantities"]
    assert {name: row[name] for name in samples.dtype.names if name != "time"} == {
        name: value for name, value in shown.items() if name in samples.dtype.names}  # bit for bit
    assert set(shown) - set(samples.dtype.names) <= {"motor_voltage", "motor_current", "electrical_power"}
    page.click("#slow")
    until(page, lambda page: page.is_enabled("#timeline"), "slow motion")
    page.press("body", "Escape")


def saved(page, button: str, path):
    """Return the file that the browser saves when a button is clicked."""
    with page.expect_download() as download:
        page.click(button)
    download.value.save_as(path)
    return path


def stops_the_motor_that_a_page_has_commanded(page, view, bench, heard) -> None:
    enter(page, "motor_speed", "70")
    until(page, lambda page: shown(page, "motor_speed") == [70.0] * 3, "the motor turns")
    page.click("#stop")
    until(page, lambda page: shown(page, "motor_speed") == [0.0] * 3, "the motor stands")
    enter(page, "motor_speed", "80")
    until(page, lambda page: shown(page, "motor_speed") == [80.0] * 3, "the motor turns")
    page.close()
    bench.spin_until(lambda: heard[-1] == 0.0, "the motor's stop")
    view.executable.wait_for("the motor was commanded from one; sent motor_speed 0")


def commanded_speed(page, bench, heard: list[float]) -> float:
    """Set a speed by the knob that robot and test both receive; DDS drops messages that only one side is ready for."""
    for speed in map(float, range(50, 60)):
        enter(page, "motor_speed", f"{speed:g}")
        with contextlib.suppress(AssertionError):
            bench.spin_until(lambda speed=speed: speed in heard, "the command", patience=5.0)
            bench.spin_until(lambda speed=speed: drawn(page)["quantities"]["motor_speed"] == speed, "the motor's speed",
                             patience=5.0)
            return speed
    raise AssertionError(f"no command of the knob arrived; heard {heard}")


def test_buttons_reset_pause_step_and_record(start, view, page, tmp_path):
    robot = start("robot", *CRAWL)
    open_robot(page, view)
    assert page.is_disabled("#step")
    page.click("#pause")
    until(page, lambda page: page.inner_text("#pause") == "Resume", "paused")
    until(page, stands_still, "time stands still")
    time_before = drawn(page)["time"]
    until(page, lambda page: page.is_enabled("#step"), "step offered")
    page.click("#step")
    until(page, lambda page: drawn(page)["time"] > time_before, "one sample more")
    assert drawn(page)["time"] - time_before == pytest.approx(0.005, abs=1e-9)  # one period of 200 Hz
    page.click("#reset")
    until(page, lambda page: drawn(page)["quantities"]["crank_angle"] == 0.0, "the start")
    assert drawn(page)["quantities"]["body_position"] == 0.0
    page.click("#pause")
    until(page, lambda page: drawn(page)["quantities"]["crank_angle"] > 1.0, "time goes on")
    page.click("#record")
    robot.wait_for("recording to")
    until(page, lambda page: page.inner_text("#record") == "Stop recording", "recording")
    (bag,) = tmp_path.glob("vibro_robot_*")
    assert bag.name in page.inner_text("#recording")
    page.click("#record")
    until(page, lambda page: page.inner_text("#record") == "Record", "sealed")


def stands_still(page) -> bool:
    time_before = drawn(page)["time"]
    page.wait_for_timeout(300)
    return drawn(page)["time"] == time_before


def test_robots_that_start_later_are_shown_and_survive_a_killed_view(
        udp_only, start, view, page, watch):
    page.goto(view.address.url)
    until(page, lambda page: page.is_visible("#absent") and "robot" in page.inner_text("#absent"), "no robot yet")
    first = start("robot", *CRAWL)
    until(page, shows_robot)
    stop(first)
    until(page, lambda page: page.is_visible("#absent"), "the robot's absence")
    assert page.is_disabled("#motor_speed") and page.is_enabled("#stop")
    second = start("robot", *CRAWL, "-p", "scene:=no_impact")
    until(page, shows_robot)
    until(page, lambda page: page.locator("#upper_gap").count() == 0, "another machine, without plates")
    view.executable.kill()
    until(page, lambda page: page.is_visible("#absent"), "the view's absence")
    until(page, lambda page: any("WebSocket" in complaint for complaint in watch.complaints), "the browser's own words")
    page.goto("about:blank")
    watch.complaints = [complaint for complaint in watch.complaints if "WebSocket" not in complaint]
    stop(second)
    assert "Traceback" not in first.text + view.executable.text
