"""When a course of commands crosses into another motion, and when there is nothing to say."""

import pytest
from known_map import known_map

from vibro_ros.ros.controller.map_adviser import MotionWatch

STANDING = {"motor_speed": 0.0, "upper_gap": 0.0, "inclined_gap": 0.0}


def said(*courses, initial=None):
    """What the watch says of motor speeds that follow each other; a pair is a speed and the one that follows later."""
    watch, words = MotionWatch(known_map(), initial or STANDING), []
    for course in courses:
        speed, later = course if isinstance(course, tuple) else (course, course)
        words.append(watch.warning({"motor_speed": speed}, {"motor_speed": later}))
    return words


def test_a_crossing_is_said_once_with_both_motions():
    assert said(50.0, 60.0, 70.0, 80.0) == ["", "", (
        "motor_speed 70 rad/s at gap 0 mm crosses into another motion: from -60 mm/s, period 1 turn, 1 landing to -90 "
        "mm/s, period 2 turns, 2 landings"), ""]


def test_a_motion_goes_on_where_it_still_exists():
    assert said(70.0, 60.0, 50.0)[:2] == ["", ""]
    assert "crosses" in said(70.0, 60.0, 50.0)[2]
    assert said(50.0, 60.0, 50.0, 60.0) == [""] * 4


def test_a_start_from_standing_crosses_nothing_but_where_two_motions_exist_it_says_so():
    assert said(50.0) == said(70.0) == said(100.0) == [""]
    assert said(60.0) == ["motor_speed 60 rad/s at gap 0 mm has more than one motion, and the way there decides: -60 "
                          "mm/s, period 1 turn, 1 landing or -80 mm/s, period 2 turns, 2 landings"]
    assert said(50.0, 0.0, 70.0) == [""] * 3  # it stood meanwhile


def test_what_is_only_passed_through_is_no_crossing():
    assert said(50.0, (70.0, 100.0), 100.0)[:2] == ["", ""]
    words = said(50.0, (70.0, 100.0), 100.0)[2]
    assert "from -50 mm/s, period 1 turn, 1 landing to -100 mm/s, without a period" in words
    assert said(50.0, (70.0, 50.0), 50.0) == [""] * 3
    assert "crosses" in said(50.0, (100.0, 60.0), 60.0)[2]  # after another motion it may come back in either


def test_nothing_is_said_of_what_is_not_known():
    assert said(50.0, float("nan"), 70.0) == [""] * 3
    assert said(50.0, 1e6, 70.0) == [""] * 3
    watch = MotionWatch(known_map(), STANDING)
    apart = {"motor_speed": 50.0, "upper_gap": 0.0, "inclined_gap": 0.004}
    assert watch.warning(apart, apart) == ""


def test_a_robot_that_turned_before_is_in_its_motion():
    turning = {"motor_speed": 50.0, "upper_gap": 0.001, "inclined_gap": 0.001}
    assert said(50.0, initial=turning) == [""]
    assert said(70.0, initial=turning)[0].startswith("motor_speed 70 rad/s at gap 1 mm crosses")


@pytest.mark.parametrize("gap", [0.0, 0.004])
def test_gaps_lead_into_another_motion_as_the_motor_does(gap):
    watch = MotionWatch(known_map(), STANDING)
    command = {"motor_speed": 70.0, "upper_gap": gap, "inclined_gap": gap}
    assert watch.warning(command, command) == ""
    assert "crosses" in watch.warning({**command, "motor_speed": 110.0}, {**command, "motor_speed": 110.0})
