"""The command map in the controller: whether it belongs to the robot, and its messages about commands that change the
motion.
"""

import json

import pytest
from known_map import known_map
from observation import stop, write

from vibro_ros.bag.reader import read_bag
from vibro_ros.configuration.command_map import written
from vibro_ros.configuration.shipped import find_file
from vibro_ros.ros.controller import controller
from vibro_ros.ros.controller.map_adviser import MotionWatch

FASTER = 4.0
"""Robot seconds per second."""
SHARE = 0.05
"""Within which a speed over ground is met."""


def test_a_speed_over_ground_is_met(start, tmp_path):
    asked, hold = (-0.05, -0.02, -0.3), 4.0
    entries = "\n".join(f"  - {{speed_over_ground: {speed}, for: {hold}}}" for speed in asked)
    robot = start("robot", "--ros-args", "-p", f"rate.real_time_factor:={FASTER}")
    controller = start("controller", write(tmp_path, f"entries:\n{entries}\n  - {{for: 0.1, motor_speed: 0.0}}\n"))
    assert controller.end() == 0, controller.text
    stop(robot)
    (bag,) = (read_bag(folder) for folder in tmp_path.glob("vibro_robot_*"))
    time, position = bag["odom"]["time"], bag["odom"]["position"][:, 0]
    begins = bag["motor_speed"]["time"][bag["motor_speed"]["value"] > 0.0]
    ends = bag["motor_speed"]["time"][1:][-len(asked):]
    for speed, begin, end in zip(asked, begins, ends, strict=True):
        second_half = (time >= begin + (end - begin) / 2.0) & (time <= end)
        gone = position[second_half]
        mean = (gone[-1] - gone[0]) / (time[second_half][-1] - time[second_half][0])
        assert abs(mean / speed - 1.0) < SHARE, (speed, mean)


def test_a_crossing_is_said_before_the_command_is_sent_and_is_no_warning(start, tmp_path):
    (tmp_path / "known.json").write_text(written(known_map(), "a test"))
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false")
    controller = start("controller", write(tmp_path, """
entries:
  - {for: 2.0, motor_speed: 50.0, upper_gap: 0.0, inclined_gap: 0.0}
  - {for: 1.5, motor_speed: 70.0}
  - {for: 1.5, motor_speed: 75.0}
  - {for: 0.1, motor_speed: 0.0}
"""), "--ros-args", "-p", "map:=known.json")
    assert controller.end() == 0, controller.text
    stop(robot)
    assert "[WARN]" not in controller.text  # the script asked for it, and only one motion is possible there
    assert [line.split("]: ")[1] for line in controller.lines if " leads " in line] == [
        "entry 2 leads at motor_speed 70 rad/s and gap 0 mm from the motion of -50 mm/s (period 1 turn, 1 landing) to "
        "that of -90 mm/s (period 2 turns, 2 landings)"]
    assert controller.lines[-1].endswith("script done; /motor_speed is at 0 rad/s, so that the motor stops")


def test_the_map_of_another_machine_gives_no_commands(start, tmp_path):
    robot = start("robot", "--ros-args", "-p", "record.enabled:=false", "-p", "mass.body:=1.25")
    controller = start("controller", write(tmp_path, "entries: [{for: 5.0, speed_over_ground: -0.05}]\n"))
    assert controller.end() == 1
    assert controller.lines[-1] == (
        f"controller: speed_over_ground: {find_file('map', 'device')} is the map of another machine than /vibro_robot: "
        "mass.body is 1 there, 1.25 here; make one with `study map` and give it as the parameter `map`")
    entries = "entries: [{for: 1, motor_speed: 20}, {for: 1, motor_speed: 0}]\n"
    plain = start("controller", write(tmp_path, entries))
    assert plain.end() == 0, plain.text
    assert "nothing is said of other motions: " in plain.text
    stop(robot)
    assert "Traceback" not in controller.text + plain.text


@pytest.mark.parametrize("words, reason", [
    (["-p", "map:=none.json"], "none.json: neither a shipped map nor a file; shipped maps are device, machine"),
    (["-p", "map:=bad.json"], "bad.json: no command map: type: 'x' is not 'vibro_ros command map, version 1'; make one "
     "with `study map`")])
def test_a_bad_map_is_one_line_and_nothing_is_sent(refusal, tmp_path, words, reason):
    document = json.loads(written(known_map(), "a test"))
    (tmp_path / "bad.json").write_text(json.dumps(document | {"type": "x"}))
    assert refusal(controller.main, "crawl", "--ros-args", *words) == f"controller: {reason}"


STANDING = {"motor_speed": 0.0, "upper_gap": 0.0, "inclined_gap": 0.0}


def remarks(*courses, initial=None):
    """Return the adviser's messages for a sequence of motor speeds; a pair is a speed and the one that follows later.
    """
    watch, words = MotionWatch(known_map(), initial or STANDING), []
    for course in courses:
        speed, later = course if isinstance(course, tuple) else (course, course)
        words.append(watch.remark({"motor_speed": speed}, {"motor_speed": later})[0])
    return words


def test_a_crossing_is_said_once_with_both_motions():
    assert remarks(50.0, 60.0, 70.0, 80.0) == ["", "", (
        "leads at motor_speed 70 rad/s and gap 0 mm from the motion of -60 mm/s (period 1 turn, 1 landing) to that of "
        "-90 mm/s (period 2 turns, 2 landings)"), ""]


def test_a_motion_goes_on_where_it_still_exists():
    assert remarks(70.0, 60.0, 50.0)[:2] == ["", ""]
    assert "leads" in remarks(70.0, 60.0, 50.0)[2]
    assert remarks(50.0, 60.0, 50.0, 60.0) == [""] * 4


def test_a_start_from_standing_crosses_nothing_but_where_two_motions_exist_it_says_so():
    assert remarks(50.0) == remarks(70.0) == remarks(100.0) == [""]
    assert remarks(60.0) == ["allows more than one motion at motor_speed 60 rad/s and gap 0 mm, and the motion before "
                          "decides: -60 mm/s (period 1 turn, 1 landing) or -80 mm/s (period 2 turns, 2 landings)"]
    assert MotionWatch(known_map(), STANDING).remark({"motor_speed": 60.0}, {"motor_speed": 60.0})[1]
    assert remarks(50.0, 0.0, 70.0) == [""] * 3  # it stood meanwhile


def test_what_is_only_passed_through_is_no_crossing():
    assert remarks(50.0, (70.0, 100.0), 100.0)[:2] == ["", ""]
    words = remarks(50.0, (70.0, 100.0), 100.0)[2]
    assert "of -50 mm/s (period 1 turn, 1 landing) to that of -100 mm/s (without a period)" in words
    assert remarks(50.0, (70.0, 50.0), 50.0) == [""] * 3
    assert "more than one" in remarks(50.0, (100.0, 60.0), 60.0)[2]  # after another motion it may come back in either


def test_nothing_is_said_of_what_is_not_known():
    assert remarks(50.0, float("nan"), 70.0) == [""] * 3
    assert remarks(50.0, 1e6, 70.0) == [""] * 3
    watch = MotionWatch(known_map(), STANDING)
    apart = {"motor_speed": 50.0, "upper_gap": 0.0, "inclined_gap": 0.004}
    assert watch.remark(apart, apart)[0] == ""


def test_a_robot_that_turned_before_is_in_its_motion():
    turning = {"motor_speed": 50.0, "upper_gap": 0.001, "inclined_gap": 0.001}
    assert remarks(50.0, initial=turning) == [""]
    assert remarks(70.0, initial=turning)[0].startswith("leads at motor_speed 70 rad/s and gap 1 mm from")
