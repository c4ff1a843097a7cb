"""Slow motion around one impact, live and of the recording of the same run, is where `simulate` says that it was."""

import signal

import numpy as np
import pytest
from page_reading import drawn, exactness, shows_robot, until

import vibro_ros

CLOSE = 1e-9  # m
PICTURE = "time => (vibro.show(time), document.querySelector('#mechanism').toDataURL())"
POSITIONS = ("body_position", "body_height", "upper_position", "inclined_position")
AROUND = np.array([-2e-3, -1e-3, -2e-4, -1e-5, 0.0, 1e-5, 7e-5, 3e-4, 1e-3, 2e-3])  # s from the first contact
HEADER = "JSON.parse(document.querySelector('#motion-header').textContent)"


@pytest.fixture(scope="module")
def scene():
    return vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0})


def compare_frames_around_an_impact(page, scene, begin: float) -> None:
    """Compare ten frames around the second impact from here with `simulate`; at `begin` [s] the robot started."""
    for _ in range(2):
        page.click("#next")
    times = drawn(page)["time"] + AROUND
    run = vibro_ros.simulate(scene, times=times - begin)
    for number, time in enumerate(times):
        shown = page.evaluate("time => vibro.show(time)", float(time))
        assert shown["time"] == pytest.approx(time, abs=1e-12)
        for name in POSITIONS:
            assert abs(shown["quantities"][name] - getattr(run, name)[number]) < CLOSE, (name, time)
        assert exactness(page) == "exact between samples"
    pictures = {page.evaluate(PICTURE, float(time)) for time in times}
    assert len(pictures) == len(times)  # none is like another
    contacts = run.events["time"][np.isin(run.events["kind"], ["upper_contact", "inclined_contact"])]
    assert np.abs(contacts + begin - (times - AROUND)[0]).min() < CLOSE


def test_ten_frames_around_an_impact_live_and_recorded(start, view, page, tmp_path, scene):
    robot = start("robot", "--ros-args", "-p", "motor.speed:=100.0")
    page.emulate_media(reduced_motion="reduce")
    page.goto(view.address.url)
    until(page, lambda page: shows_robot(page) and page.is_enabled("#pause"), "a robot")
    press(page, "#pause", "true")
    page.click("#reset")
    until(page, lambda page: drawn(page)["quantities"]["crank_angle"] == 0.0, "the start")
    begin = drawn(page)["time"]
    press(page, "#pause", "false")
    until(page, lambda page: drawn(page)["time"] > begin + 1.3, "1.3 s of motion")
    press(page, "#pause", "true")
    page.click("#slow")
    until(page, lambda page: page.is_enabled("#timeline"), "slow motion")
    compare_frames_around_an_impact(page, scene, begin)

    robot.send(signal.SIGINT)
    assert robot.end() == 0
    (bag,) = tmp_path.glob("vibro_robot_*")
    made = start("view", str(bag))
    assert made.end() == 0, made.text
    file = bag.with_name(f"{bag.name}_view.html")
    assert made.lines[-1] == str(file)
    page.goto(file.as_uri())
    until(page, lambda page: page.is_enabled("#timeline"), "the recording")
    (begin,) = page.evaluate(HEADER)["resets"]
    page.evaluate("time => vibro.show(time)", begin + 0.5)
    compare_frames_around_an_impact(page, scene, begin)


def press(page, button: str, pressed: str) -> None:
    """Click a button, and wait until the robot has done it."""
    page.click(button)
    until(page, lambda page: page.get_attribute(button, "aria-pressed") == pressed, f"{button} {pressed}")
