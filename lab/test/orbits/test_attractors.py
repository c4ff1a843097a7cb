"""Attractors of several starts: distinguished by one rule, with shares, intervals and exponents, and without a mean
over two.
"""

import math

import numpy as np
import pytest

import vibro_lab
import vibro_ros
from vibro_lab.orbits.attractors import Attractors, group_starts
from vibro_lab.orbits.recurrence import SettledMotion
from vibro_lab.orbits.turn_map import TurnMap

TWO = vibro_ros.load_scene("device").with_parameters({"motor.speed": 160.0})


@pytest.fixture(scope="module")
def two():
    return vibro_lab.attractors(TWO, starts=8)


def test_two_motions_are_two_attractors(two):
    """`device` at 160 rad/s: six of eight starts run at -79.80 mm/s, two at -53.58; none at -73.2, the mean."""
    assert [round(attractor.mean_speed * 1e3, 2) for attractor in two] == [-79.8, -53.58]
    assert [attractor.starts for attractor in two] == [6, 2] and [attractor.share for attractor in two] == [0.75, 0.25]
    assert [attractor.turns for attractor in two] == [3, 3] and [attractor.spread for attractor in two] == [0.0, 0.0]
    assert two.single is None and not hasattr(two, "mean_speed")
    assert two.in_words() == ("-79.80 mm/s, again after 3 turns (6 of 8 starts, 41 to 93 %, the scene's own start); "
                              "-53.58 mm/s, again after 3 turns (2 of 8 starts, 7 to 59 %)")


def test_a_motion_to_which_only_the_scenes_own_start_leads_is_named_and_has_no_share():
    """`device` at 100 rad/s goes -76.41 mm/s from its own start, which no drawn start finds."""
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0})
    attractors, settled = vibro_lab.attractors(scene, starts=4), vibro_lab.settled_motion(scene)
    (of_scene,) = (attractor for attractor in attractors if attractor.of_scene_start)
    assert of_scene.mean_speed == pytest.approx(settled.mean_speed, abs=1e-9) and of_scene.turns == settled.turns
    assert round(1e3 * of_scene.mean_speed, 2) == -76.41
    assert of_scene.starts == 0 and of_scene.share == of_scene.low == 0.0 < of_scene.high
    assert sum(attractor.starts for attractor in attractors) == 4
    assert list(attractors.drawn) == [attractor for attractor in attractors if attractor is not of_scene]
    assert attractors.in_words().endswith(", the scene's own start)") and math.isfinite(of_scene.exponent)


def test_exponents_are_those_of_the_orbits_multipliers(two):
    """A periodic motion repeats its states, and a disturbance shrinks by the multiplier within three turns."""
    slower = vibro_lab.find_orbit(TWO, turns=3)  # of the scene's own start
    same = next(attractor for attractor in two if attractor.mean_speed == pytest.approx(slower.mean_speed, abs=1e-9))
    assert np.abs(same.multipliers[0]) == pytest.approx(np.abs(slower.multipliers[0]), abs=1e-6)
    assert same.exponent == pytest.approx(math.log(abs(slower.multipliers[0])) / slower.period, abs=1e-4)
    assert same.exponent_spread == 0.0 and same.states.shape == (3, len(TurnMap(TWO).names))


def test_more_starts_are_the_same_ones_and_others(two):
    few = vibro_lab.attractors(TWO, starts=3)
    assert sum(attractor.starts for attractor in few) == 3
    assert {attractor.mean_speed for attractor in few} <= {attractor.mean_speed for attractor in two}


def test_a_loss_free_scene_has_an_interval_and_a_positive_exponent():
    """`paper` is chaotic, about 5 1/s."""
    chaos = vibro_lab.attractors(vibro_ros.load_scene("paper"), starts=3)
    assert sum(attractor.starts for attractor in chaos) == 3 and all(not attractor.turns for attractor in chaos)
    assert chaos[0].exponent - chaos[0].exponent_spread > 2.0 and not len(chaos[0].multipliers)


def motion(turns, *states):
    return SettledMotion(turns, np.array(states, float), -0.1, 64)


def test_grouping_has_one_rule():
    """Two starts have the same motion if their periods are equal and their states agree within the tolerance, at any
    turn of the period; starts that have not settled form one group.
    """
    first, shifted = motion(2, [0.0, 1.0], [2.0, 3.0]), motion(2, [2.0, 3.0], [1e-6, 1.0])
    other, longer = motion(2, [0.0, 1.0001], [2.0, 3.0001]), motion(1, [0.0, 1.0])
    grouped, places = group_starts([None, other, first, longer, shifted, None], [0.3, -0.1, -0.1, -0.1, -0.1, 0.5])
    assert [attractor.turns for attractor in grouped] == [2, 2, 1, None] and places.tolist() == [3, 1, 0, 2, 0, 3]
    assert [attractor.starts for attractor in grouped] == [2, 1, 1, 2]
    assert sum(attractor.share for attractor in grouped) == pytest.approx(1.0)
    assert math.isnan(grouped[-1].spread) and (grouped[-1].least, grouped[-1].largest) == (0.3, 0.5)
    assert "300.00 to 500.00 mm/s, not settled (2 of 6 starts, 10 to 70 %)" in grouped.in_words()
    alone, _ = group_starts([None], [-0.1])
    assert alone.in_words() == "-100.00 mm/s, not settled"
    assert math.isnan(grouped[0].exponent)


def test_a_single_attractor_is_said_without_shares():
    grouped, places = group_starts([motion(1, [0.0, 1.0])] * 4, [-0.1] * 4)
    assert grouped.single is grouped[0] and grouped.in_words() == "-100.00 mm/s, again after 1 turn"
    assert places.tolist() == [0, 0, 0, 0] and isinstance(grouped, Attractors)


def test_a_wrong_number_of_starts_and_a_crank_that_stands_are_refused():
    for starts in (0, 10_001, 2.0, True):
        with pytest.raises(ValueError, match=f"starts: {starts} is out of range; give a whole number from 1 to 10000"):
            vibro_lab.attractors(TWO, starts=starts)
    with pytest.raises(ValueError, match="motor.speed: 0 rad/s turns no crank"):
        vibro_lab.attractors(vibro_ros.load_scene("device"))
