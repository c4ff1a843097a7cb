"""Goals of feedback on the exact simulator: speeds are held and positions reached; invalid odometry is detected."""

import math
import re
from collections.abc import Callable

import pytest
from goal_trial import Samples, Trial

import vibro_ros
from vibro_ros.ros.controller.feedback import DEFAULT_MOTOR_RANGE, Goal, GoalError, PositionGoal, SpeedGoal, check_reach

RAMP = {"effects.motor": "ramp", "motor.speed": 0.0}  # as the shipped device has it
TURNS = [(0.0, 0.0), (40.0, 0.7), (75.0, 1.3), (110.0, 2.1)]  # motor speeds [rad/s] and times [s] before the goal


def scene(name: str):
    return vibro_ros.load_scene(name).with_parameters(RAMP)


def pursue(scene: vibro_ros.Scene, goal: Goal, duration: float, reach: float = -0.06,
           turn: tuple[float, float] = (0.0, 0.0),
           heard: Callable[[int, float], Samples] = lambda *sample: (sample,)) -> Trial:
    """Turn the motor at `turn[0]` [rad/s] for `turn[1]` [s], then pursue the goal."""
    trial = Trial(scene, heard)
    trial.turn(*turn)
    trial.pursue(goal, duration, reach)
    return trial


def hold(speed: float, within: float = 0.005, motor: tuple[float, float] = DEFAULT_MOTOR_RANGE) -> SpeedGoal:
    return SpeedGoal(speed, within, motor)


def go_to(position: float, within: float = 0.005) -> PositionGoal:
    return PositionGoal(position, within, DEFAULT_MOTOR_RANGE)


@pytest.mark.parametrize(("name", "speed", "turn"), [
    ("device", -0.01, TURNS[0]), ("device", -0.06, TURNS[3]), ("damped", -0.06, TURNS[0]),
    ("damped", -0.01, TURNS[3])], ids=str)
def test_a_mean_speed_is_held(name, speed, turn):
    """The device's own mean speed over the second half counts, not the controller's estimate."""
    trial = pursue(scene(name), hold(speed), 10.0, turn=turn)
    # the tolerance, and what the ends of whole turns differ by
    assert trial.mean_speed == pytest.approx(speed, abs=0.006)
    assert 0.0 <= min(trial.commands) <= max(trial.commands) <= 100.0
    assert trial.words[-1].startswith("held: mean speed ")
    assert any(words.startswith("settled after ") for words in trial.words)


@pytest.mark.parametrize(("name", "way", "within", "turn"), [
    ("device", 0.01, 0.005, TURNS[1]), ("device", 0.5, 0.001, TURNS[3]), ("damped", 0.5, 0.001, TURNS[1]),
    ("damped", 0.01, 0.005, TURNS[3])], ids=str)
def test_a_position_is_reached_and_the_robot_stops_there(name, way, within, turn):
    target = -0.2 - way  # what comes before makes up to 0.13 m
    trial = pursue(scene(name), go_to(target, within), 40.0, turn=turn)
    position = trial.device.state.body_position
    assert abs(position - target) <= within
    assert trial.commands[-1] == 0.0
    assert re.match(r"reached after [0-9.]+ s: [0-9.]+ mm (short of|beyond) -0\.", trial.words[-1])
    trial.device.advance_to(trial.device.time + 2.0)
    assert abs(trial.device.state.body_position - position) < 0.1 * within  # it stands


def test_a_robot_at_its_goal_does_not_move():
    trial = pursue(scene("device"), go_to(0.003), 5.0)
    assert set(trial.commands) == {0.0}
    assert trial.took < 1.0


def test_a_robot_that_goes_forwards_reaches_its_goals():
    """The odometry is mirrored, so that the backward robot appears to go forwards."""
    trial = pursue(scene("device"), go_to(0.1), 20.0, 0.06, heard=lambda stamp, position: ((stamp, -position),))
    assert trial.device.state.body_position == pytest.approx(-0.1, abs=0.005)


@pytest.mark.parametrize("goal, duration, reason", [
    (go_to(0.5), 30.0, "0.5 m is out of reach: the robot is at 0.0000 m and goes backwards only; give one below that"),
    (go_to(-0.5), 5.0, "-0.5 m is out of reach within 5 s: 0.5000 m at 0.06 m/s take 8.3 s; give more time"),
])
def test_a_goal_out_of_reach_is_refused_before_the_motor_turns(goal, duration, reason):
    moved = []

    def heard(stamp, position):
        moved.append(position)
        return ((stamp, position),)

    with pytest.raises(GoalError, match="^" + re.escape(reason)):
        pursue(scene("device"), goal, duration, heard=heard)
    assert set(moved) == {0.0}


@pytest.mark.parametrize("goals, reason", [
    ([hold(0.05)], "entry 1: hold_speed: 0.05 m/s is out of reach of a robot that goes backwards; give one between"),
    ([hold(-0.07)], "entry 1: hold_speed: -0.07 m/s is out of reach"),
    ([hold(0.0)], "entry 1: hold_speed: 0 m/s is out of reach"),
    ([hold(-0.05), go_to(-0.5), go_to(-0.3)],
     "entry 3: go_to: -0.3 m is out of reach after entry 2 went to -0.5 m: the robot goes backwards only; give"),
])
def test_goals_against_the_robots_direction_are_refused_with_the_script(goals, reason):
    with pytest.raises(ValueError, match=re.escape(reason)):
        check_reach([(str(number), goal) for number, goal in enumerate(goals, 1)], -0.06)
    forwards = [hold(0.05), go_to(0.5), go_to(0.5), go_to(0.7)]
    check_reach([("1", goal) for goal in forwards], 0.06)


def test_the_error_names_a_limit_of_the_motor_that_is_too_low():
    with pytest.raises(GoalError, match=r"-0\.05 m/s not held within 0\.005 m/s: mean speed -0\.00.*; the motor was at "
                                        r"30 rad/s for [0-9.]+ s: the robot goes no faster backwards; give a smaller"):
        pursue(scene("device"), hold(-0.05, motor=(0.0, 30.0)), 10.0)


def test_a_robot_that_moves_while_its_motor_stands_ends_the_goal():
    """Without damping the masses keep swinging while the motor stands, and the body crawls on."""
    with pytest.raises(GoalError, match="the motor was at 0 rad/s for .* the robot goes no slower"):
        pursue(scene("unilateral"), hold(-0.01), 10.0, turn=(100.0, 2.0))
    with pytest.raises(GoalError, match=r"-0\.3 m was passed by 0\.00"):
        pursue(scene("unilateral"), go_to(-0.3), 30.0, turn=(100.0, 2.0))


def test_a_robot_that_does_not_move_gets_a_faster_motor_and_then_an_error():
    trial = []
    with pytest.raises(GoalError, match="-0.1 m not reached within 8 s: 0.1000 m are left"):
        pursue(scene("device"), go_to(-0.1), 8.0, heard=lambda stamp, position: trial.append(stamp) or ((stamp, 0.0),))
    assert trial[-1] == pytest.approx(8e9, abs=1e8)


def silent_after(instant: int):
    return lambda stamp, position: () if stamp > instant else ((stamp, position),)


HOSTILE = {
    "silence later": (silent_after(3_000_000_000), r"no odometry for 2\.[01] s; is there"),
    "NaN": (lambda stamp, position: ((stamp, math.nan),), "samples refused, the last for a position of nan m;"),
    "far beyond": (lambda stamp, position: ((stamp, 1.7e308),), "the last for a position of 1.7e\\+308 m;"),
    "a clock that stands": (lambda stamp, position: ((7, position),), "the last for a stamp 0 s before the latest;"),
    "a clock set back": (lambda stamp, position: ((stamp - (stamp > 10**9) * 10**12, position),), "before the latest;"),
    "two robots": (lambda stamp, position: ((stamp, position), *[(stamp + 1, -5.0)] * (stamp > 10**9)),
                   "the position in odom leapt [0-9]+ times; let one robot alone publish there"),
}


@pytest.mark.parametrize("heard, reason", HOSTILE.values(), ids=HOSTILE)
def test_implausible_odometry_ends_the_entry(heard, reason):
    with pytest.raises(GoalError, match=reason):
        pursue(scene("device"), hold(-0.05), 20.0, heard=heard)


def worst_visitor(stamp: int, position: float):
    """Every sixth sample is unchanged; the samples between are impossible."""
    kind = stamp // 5_000_000 % 6
    return ((stamp, position if kind == 0 else math.nan),
            (stamp - 10**10, position), (stamp, math.inf), (0, 1e300), (-2**63, 0.0))


@pytest.mark.parametrize("goal", [hold(-0.05), go_to(-0.5)], ids=["hold", "go_to"])
def test_a_goal_is_reached_among_bad_samples(goal):
    trial = pursue(scene("device"), goal, 20.0, heard=worst_visitor)
    assert trial.words[-1].startswith(("held", "reached"))


def test_slow_odometry_that_was_reset_is_followed():
    """A robot that was reset reports its start again: speed control goes on, and a position counts in the new frame."""
    def heard(stamp, position):
        return ((stamp, position + 1.0 if stamp < 8 * 10**9 else position),) if stamp % 200_000_000 == 0 else ()

    trial = pursue(scene("device"), hold(-0.05, within=0.01), 20.0, heard=heard)
    assert trial.words[-1].startswith("held: mean speed -0.0")


def test_speeds_are_computed_in_the_time_of_the_stamps():
    """For a robot at half speed the stamps advance half as fast, and the speed is that in the robot's time."""
    trial = pursue(scene("device"), hold(-0.025), 20.0, heard=lambda stamp, position: ((2 * stamp, 2.0 * position),))
    assert trial.words[-1].startswith("held")
    assert all(map(math.isfinite, trial.commands))
