"""Scores: a lucky start does not win, directions must agree, and V/P is refused where it has no bound."""

import numpy as np
import pytest

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.study.optimise.plan import (
    FAILED,
    Reading,
    check_reaction,
    cost_of_transport,
    speed,
    speed_per_power,
)


def values(speeds, net=2.0, delivered=4.0):
    """Values of a robot with these mean speeds [m/s] and one power [W]."""
    return np.array([[one, net, delivered] for one in speeds])


def test_a_lucky_start_does_not_win():
    lucky, steady = values([0.1, 0.1, 0.1, 9.0]), values([0.2, 0.2, 0.2, 0.2])
    assert speed(lucky, Reading()) == pytest.approx(0.1)
    assert speed(steady, Reading()) == pytest.approx(0.2)


def test_either_direction_counts_but_all_starts_must_agree():
    assert speed(values([-0.3, -0.3, -0.2]), Reading()) == pytest.approx(0.25)  # the quartile of 0.2, 0.3, 0.3
    assert speed(values([-0.3, -0.3, 0.1]), Reading()) == pytest.approx(-0.1)
    assert speed_per_power(values([-0.3, -0.3, 0.1]), Reading()) == pytest.approx(-0.1)


def test_direction_asked_for():
    assert speed(values([-0.3, -0.2]), Reading(direction="forward")) == pytest.approx(-0.3)
    assert speed(values([-0.3, -0.2]), Reading(direction="backward")) == pytest.approx(0.225)


def test_both_readings_of_power():
    robot = values([0.2, 0.2])
    assert speed_per_power(robot, Reading()) == pytest.approx(0.1)
    assert speed_per_power(robot, Reading(power="delivered")) == pytest.approx(0.05)
    assert cost_of_transport(robot, Reading(), 10.0) == pytest.approx(2.0 / (10.0 * 0.2))


def test_power_that_is_not_above_zero_is_no_merit():
    robot = values([0.2, 0.2], net=-1e-3)
    assert speed_per_power(robot, Reading()) == 0.0
    assert cost_of_transport(robot, Reading(), 10.0) == np.inf


def test_a_robot_that_cannot_be_simulated_is_last():
    robot = values([0.2, np.nan])
    assert speed(robot, Reading()) == speed_per_power(robot, Reading()) == FAILED
    assert cost_of_transport(robot, Reading(), 10.0) == np.inf


def test_a_robot_that_stands_still_has_no_score():
    robot = values([0.0, 0.0])
    assert speed(robot, Reading()) == speed_per_power(robot, Reading()) == 0.0
    assert cost_of_transport(robot, Reading(), 10.0) == np.inf


def test_needs_reaction():
    check_reaction(load_scene("device"), "V/P")
    with pytest.raises(ValueError, match="--scene paper: has effects.reaction false.*V/P has no bound.*device"):
        check_reaction(load_scene("paper"), "V/P")
