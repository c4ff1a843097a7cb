"""Every point of the unit cube is a robot that can be built, the bounds are those of the table, and scores are computed
as stated.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from vibro_lab.study.optimise import Effort, Plan, on_bounds
from vibro_lab.study.space import VARIABLES, Space, chosen_variables
from vibro_lab.study.trials import FAILED, Reading, cost_of_transport, speed, speed_per_power
from vibro_ros.configuration.scene_file import load_scene

DEVICE = load_scene("device")
PAPERS = {"mass.upper", "mass.inclined", "crank.radius", "crank.upper_rod", "crank.inclined_rod", "guide.angle",
          "motor.speed", "upper.gap", "inclined.gap",
          *(f"{side}.{part}.{kind}" for side in ("upper", "inclined") for part in ("spring", "plate")
            for kind in ("stiffness", "damping"))}


def test_the_variables_are_the_papers_seventeen():
    assert {variable.name for variable in VARIABLES} == PAPERS
    assert len(PAPERS) == 17
    assert all(variable.reason and variable.low < variable.high for variable in VARIABLES)


def test_every_point_is_a_robot_within_the_bounds():
    space, draw = Space(DEVICE), np.random.default_rng(0)
    points = np.concatenate([draw.random((300, 17)), draw.integers(0, 2, (300, 17))])
    for point in points:
        robot = space.robot(point)
        for variable in VARIABLES:
            assert variable.low <= robot[variable.name] <= variable.high
        assert robot["crank.radius"] <= min(robot["crank.upper_rod"], robot["crank.inclined_rod"])
        assert max(abs(robot["upper.gap"]), abs(robot["inclined.gap"])) <= robot["crank.radius"]


def test_point_and_parameters_are_inverse():
    space = Space(DEVICE)
    for point in np.random.default_rng(1).random((50, 17)):
        assert space.point(space.parameters(point)) == pytest.approx(point, abs=1e-9)


def test_the_papers_robots_lie_within_the_bounds():
    space = Space(DEVICE)
    for changes in ({}, {"guide.angle": math.radians(80.0), "mass.inclined": 0.02, "crank.radius": 0.06}):
        point = space.point(load_scene("paper").with_parameters({
            **{name: DEVICE[name] for name in PAPERS if name.endswith("damping")}, **changes}).parameters)
        assert ((point >= -1e-12) & (point <= 1.0 + 1e-12)).all()


def test_marks_what_is_on_a_bound():
    space = Space(DEVICE, VARIABLES[:3])
    assert space.on_bound([0.0, 0.5, 1.0]) == ["low", "", "high"]
    assert space.on_bound([0.02, 0.98, 0.995]) == ["", "", "high"]
    found = SimpleNamespace(plan=SimpleNamespace(space=space), on_bound=("low", "", "high"))
    assert on_bounds(found) == ("the best score is at the end of the range of mass.upper (lower), crank.upper_rod "
                                "(upper): it may still rise beyond")


def test_fixed_and_varied():
    chosen = chosen_variables(("guide.angle",), {"crank.radius": (0.01, 0.02)})
    names = [variable.name for variable in chosen]
    assert len(names) == 16 and "guide.angle" not in names
    radius = chosen[names.index("crank.radius")]
    assert (radius.low, radius.high, radius.reason) == (0.01, 0.02, "as asked for")
    assert Space(DEVICE, chosen).robot([1.0] * 16)["guide.angle"] == DEVICE["guide.angle"]


@pytest.mark.parametrize(("fixed", "varied", "said"), [
    (("guide.angel",), {}, "did you mean guide.angle"),
    (("mass.body",), {}, "--fix mass.body: is not among the paper's"),
    (("guide.angle",), {"guide.angle": (0.5, 1.0)}, "is fixed as well"),
    ((), {"motor.speed": (0.0, 10.0)}, "give bounds above 0"),
])
def test_bad_choices_are_refused(fixed, varied, said):
    with pytest.raises(ValueError, match=said):
        chosen_variables(fixed, varied)


@pytest.mark.parametrize(("fixed", "varied", "said"), [
    ((), {"crank.radius": (0.04, 0.05)}, "leaves no value where rods and crank are shortest"),
    (tuple(PAPERS), {}, "nothing is left to vary"),
])
def test_bounds_without_a_robot_are_refused(fixed, varied, said):
    with pytest.raises(ValueError, match=said):
        Space(DEVICE, chosen_variables(fixed, varied))


def values(speeds, net=2.0, delivered=4.0, air=0.0, supply=np.nan):
    """Return the values of a robot with these mean speeds [m/s], powers [W] and one share of time in the air."""
    return np.array([[one, net, delivered, air, supply] for one in speeds])


def test_a_lucky_start_does_not_win():
    lucky, steady = values([0.1, 0.1, 0.1, 9.0]), values([0.2, 0.2, 0.2, 0.2])
    assert speed(lucky, Reading()) == pytest.approx(0.1)
    assert speed(steady, Reading()) == pytest.approx(0.2)


def test_either_direction_counts_but_all_starts_must_agree():
    assert speed(values([-0.3, -0.3, -0.2]), Reading()) == pytest.approx(0.25)  # the quartile of 0.2, 0.3, 0.3
    assert speed(values([-0.3, -0.3, 0.1]), Reading()) == pytest.approx(-0.1)
    assert speed_per_power(values([-0.3, -0.3, 0.1]), Reading()) == pytest.approx(-0.1)
    assert speed(values([-0.3, -0.2]), Reading(direction="forward")) == pytest.approx(-0.3)
    assert speed(values([-0.3, -0.2]), Reading(direction="backward")) == pytest.approx(0.225)


def test_each_reading_of_power_which_is_no_merit_unless_above_zero():
    robot = values([0.2, 0.2], supply=8.0)
    assert speed_per_power(robot, Reading(power="supply")) == pytest.approx(0.025)
    assert cost_of_transport(robot, Reading(power="supply"), 10.0) == pytest.approx(8.0 / (10.0 * 0.2))
    assert speed_per_power(robot, Reading()) == pytest.approx(0.1)
    assert speed_per_power(robot, Reading(power="delivered")) == pytest.approx(0.05)
    assert cost_of_transport(robot, Reading(), 10.0) == pytest.approx(2.0 / (10.0 * 0.2))
    robot = values([0.2, 0.2], net=-1e-3)
    assert speed_per_power(robot, Reading()) == 0.0
    assert cost_of_transport(robot, Reading(), 10.0) == np.inf


@pytest.mark.parametrize(("speeds", "score"), [([0.2, np.nan], FAILED), ([0.0, 0.0], 0.0)])
def test_a_robot_that_cannot_be_simulated_or_stands_still_has_no_merit(speeds, score):
    robot = values(speeds)
    assert speed(robot, Reading()) == speed_per_power(robot, Reading()) == score
    assert cost_of_transport(robot, Reading(), 10.0) == np.inf


def test_a_robot_that_flies_too_long_is_worse_than_any_that_counts_and_the_longer_the_worse():
    plan = Plan(Space(DEVICE), "speed_per_power", Reading(), 0.1, 0.02, Effort(), 0)
    grounded, slow, hopping, flying = (plan.score(values([pace, pace], air=air)) for pace, air in (
        (0.2, 0.01), (0.05, 0.01), (0.2, 0.1), (0.2, 0.9)))
    assert grounded > 0.0 > slow == pytest.approx(-0.05) and 0.0 > hopping > flying
    assert plan.speed_and_cost(np.full(17, 0.5), values([0.2, 0.2], air=0.9)) == (pytest.approx(-0.88), math.inf)
