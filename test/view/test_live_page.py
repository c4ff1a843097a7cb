"""Robot, view and browser together: what the page shows is what the robot publishes, and what it asks is done."""

import contextlib
import signal
import time

import pytest
from live_view import LiveView
from page_reading import drawn, drawn_frames, said, shows_robot, until
from published_samples import Published
from rcl_interfaces.msg import Log
from std_msgs.msg import Float64

CRAWL = ("--ros-args", "-p", "motor.speed:=100.0", "-p", "record.enabled:=false")


@pytest.fixture
def published(bench) -> Published:
    """What the robot publishes, heard by a node of the test's own; to be asked for before the robot starts."""
    return Published(bench)


def open_robot(page, view) -> None:
    page.goto(view.address.url)
    until(page, shows_robot)


def test_what_is_drawn_is_what_was_published(start, published, view, page):
    start("robot", *CRAWL)
    published.hear_until(0)  # from here on every sample is heard
    open_robot(page, view)
    with view.address.visit() as visit:
        origin = int(visit.wait_for("robot")["origin"])
    frames = drawn_frames(page, 40)
    assert len({frame["time"] for frame in frames}) >= 20
    published.hear_until(origin + round(frames[-1]["time"] * 1e9))
    for frame in frames:
        sample = published.samples[origin + round(frame["time"] * 1e9)]
        assert {name: frame["quantities"][name] for name in sample} == sample  # bit for bit


def test_a_knob_s_command_reaches_the_robot_and_a_refusal_is_shown_in_its_words(start, published, view, page, bench):
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false")
    heard: list[float] = []
    bench.node.create_subscription(Float64, "motor_speed", lambda message: heard.append(message.data), 10)
    open_robot(page, view)
    speed = commanded_speed(page, bench, heard)
    page.fill("#upper_gap", "0.0005")
    page.press("#upper_gap", "Tab")
    until(page, lambda page: abs(drawn(page)["quantities"]["upper_plate_position"] - 0.0605) < 1e-12, "the gap")
    page.fill("#motor_speed", "1e6")
    page.press("#motor_speed", "Enter")
    refusal = robot.wait_for("1e+06").split("]: ", 1)[1]
    until(page, lambda page: refusal in said(page), refusal)
    bench.spin_until(lambda: heard[-1] == 1e6, "what was refused")
    assert drawn(page)["quantities"]["motor_speed"] == speed


def commanded_speed(page, bench, heard: list[float]) -> float:
    """A speed of the knob that robot and test have heard: DDS drops what only one side is ready for."""
    for speed in map(float, range(50, 60)):
        page.fill("#motor_speed", f"{speed:g}")
        page.press("#motor_speed", "Enter")
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
    until(page, lambda page: page.get_attribute("#pause", "aria-pressed") == "true", "paused")
    until(page, stands_still, "time stands still")
    before = drawn(page)["time"]
    until(page, lambda page: page.is_enabled("#step"), "step offered")
    page.click("#step")
    until(page, lambda page: drawn(page)["time"] > before, "one sample more")
    assert drawn(page)["time"] - before == pytest.approx(0.005, abs=1e-9)  # one period of 200 Hz
    page.click("#reset")
    until(page, lambda page: drawn(page)["quantities"]["crank_angle"] == 0.0, "the start")
    assert drawn(page)["quantities"]["body_position"] == 0.0
    page.click("#pause")
    until(page, lambda page: drawn(page)["quantities"]["crank_angle"] > 1.0, "time goes on")
    page.click("#record")
    robot.wait_for("recording to")
    until(page, lambda page: page.get_attribute("#record", "aria-pressed") == "true", "recording")
    (bag,) = tmp_path.glob("vibro_robot_*")
    assert bag.name in page.inner_text("#recording")
    page.click("#record")
    until(page, lambda page: page.get_attribute("#record", "aria-pressed") == "false", "sealed")


def stands_still(page) -> bool:
    before = drawn(page)["time"]
    page.wait_for_timeout(300)
    return drawn(page)["time"] == before


def test_the_numbers_above_are_those_of_the_robot(start, view, page):
    start("robot", *CRAWL)
    open_robot(page, view)
    until(page, lambda page: page.inner_text("#real-time-factor").strip("–× ") != "", "real-time factor")
    factor = float(page.inner_text("#real-time-factor").replace("×", ""))
    assert 0.0 < factor < 1.5
    assert 0.0 <= float(page.inner_text("#dropped").replace("%", "")) <= 100.0
    clock = float(page.inner_text("#clock").replace("s", ""))
    assert clock == pytest.approx(drawn(page)["time"], abs=1.0)


def test_slow_motion_of_the_last_second_is_one_click_away(start, view, page):
    start("robot", *CRAWL)
    open_robot(page, view)
    until(page, lambda page: drawn(page)["time"] > 1.2, "a second")
    page.click("#slow")
    until(page, lambda page: page.is_enabled("#timeline"), "slow motion")
    begin, end = (float(page.get_attribute("#timeline", name)) for name in ("min", "max"))
    assert end - begin == pytest.approx(1.0, abs=0.011)
    assert page.inner_text("#exactness") == "exact between samples"
    for speed in ("0.1", "0.001"):
        page.select_option("#speed", speed)
    page.click("#next")
    first = drawn_frames(page, 3)[-1]["time"]  # a click shows in the next picture
    page.click("#next")
    assert begin <= first < drawn_frames(page, 3)[-1]["time"] <= end
    page.press("body", "Escape")
    until(page, lambda page: drawn(page)["time"] > end, "live again")


def test_a_robot_that_comes_late_goes_and_comes_back_is_shown(udp_only, start, view, page, watch):
    page.goto(view.address.url)
    until(page, lambda page: page.is_visible("#absent") and "robot" in page.inner_text("#absent"), "no robot yet")
    first = start("robot", *CRAWL)
    until(page, shows_robot)
    first.send(signal.SIGKILL)
    first.end()
    until(page, lambda page: page.is_visible("#absent"), "the robot's absence")
    assert page.is_disabled("#motor_speed")
    second = start("robot", *CRAWL, "-p", "scene:=no_impact")
    until(page, shows_robot)
    until(page, lambda page: page.locator("#upper_gap").count() == 0, "another machine, without plates")
    second.send(signal.SIGINT)
    assert second.end() == 0
    assert "Traceback" not in first.text + second.text
    until(page, lambda page: page.is_visible("#absent"), "the absence of the second")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_view_that_ends_costs_the_robot_nothing_and_the_page_says_so(udp_only, start, page, watch, number):
    robot, view = start("robot", *CRAWL), LiveView(start)
    open_robot(page, view)
    view.executable.send(number)
    assert view.executable.end() == (-number if number == signal.SIGKILL else 0)
    view.check()
    until(page, lambda page: page.is_visible("#absent"), "the view's absence")
    assert not robot.ended and "Traceback" not in robot.text
    until(page, lambda page: any("WebSocket" in one for one in watch.complaints), "the browser's own words")
    page.goto("about:blank")
    watch.complaints = [one for one in watch.complaints if "WebSocket" not in one]


def test_pages_that_are_left_make_room(start, view, page):
    start("robot", *CRAWL)
    for _ in range(9):  # one more than may be open at once
        page.goto(view.address.url)
        until(page, shows_robot)


def test_three_pages_show_the_same_robot(start, view, open_page):
    start("robot", *CRAWL)
    pages = [open_page() for _ in range(3)]
    for page in pages:
        open_robot(page, view)
    pages[0].click("#pause")
    for page in pages:
        until(page, stands_still, "time stands still")
    assert len({str(drawn(page)) for page in pages}) == 1
    pages[1].fill("#motor_speed", "20")
    pages[1].press("#motor_speed", "Enter")
    pages[2].click("#pause")
    for page in pages:
        until(page, lambda page: drawn(page)["quantities"]["motor_speed"] == 20.0, "the command of another page")


def test_words_of_others_are_text(start, view, page, bench):
    """What a stranger publishes as the robot's words is shown as it is, and runs nowhere."""
    start("robot", *CRAWL)
    open_robot(page, view)
    publisher = bench.node.create_publisher(Log, "/rosout", 10)
    bench.spin_until(lambda: publisher.get_subscription_count() > 0, "the view listens to /rosout")
    evil = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>\u2028"
    deadline = time.monotonic() + 30.0
    while "<img src=x" not in said(page):
        publisher.publish(Log(level=40, name="vibro_robot", msg=evil))
        assert time.monotonic() < deadline
        page.wait_for_timeout(50)
    assert page.locator("#said img, #said script").count() == 0
    assert page.title() != "owned"
