"""Halved and doubled, no setting of the continuation but one moves or loses a special point."""

from dataclasses import fields, replace

import numpy as np
import pytest
from test_continuation import HIGH, LOW, oscillator

import vibro_lab
import vibro_ros
from vibro_lab.orbits.continuation import CORNER, FOLD, GRAZING, follow, special_points
from vibro_lab.orbits.family import ContinuationSettings, Family, corrected_orbit, point_at
from vibro_lab.orbits.turn_map import TurnMap

#: A fold of an impact oscillator; and a corner and a grazing of `device`, at which its branch meets edges.
BRANCHES = {
    FOLD: (oscillator(170.0, 0.5, 0.0), "upper.gap", LOW, HIGH, 1.0, [FOLD]),
    GRAZING: (vibro_ros.load_scene("device").with_parameters({"motor.speed": 62.64}), "motor.speed", 60.0, 65.0, -1.0,
              [CORNER, GRAZING])}


@pytest.fixture(scope="module")
def orbits():
    return {kind: vibro_lab.find_orbit(branch[0]) for kind, branch in BRANCHES.items()}


def verdict(orbits, settings: ContinuationSettings) -> list[tuple[str, float]]:
    """Kinds and parameter values of the first special points of both branches."""
    points = []
    for kind, (scene, name, low, high, direction, expected) in BRANCHES.items():
        turn_map = TurnMap(scene, orbits[kind].state.crank_angle)
        family = Family(scene, name, (low, high), 1, turn_map.phase, settings)
        along = direction * np.eye(len(family.units) + 1)[-1]
        start = np.append(turn_map.read(orbits[kind].state) * turn_map.units / family.units, family.scaled(scene[name]))
        unknowns, _ = corrected_orbit(family, start, along)
        needed = len(points) + len(expected)
        for pair in follow(point_at(family, unknowns, along)):
            points += [(special.kind, special.point.value) for special in special_points(*pair)]
            if len(points) >= needed:
                break
    return points


@pytest.fixture(scope="module")
def usual(orbits):
    points = verdict(orbits, ContinuationSettings())
    assert [kind for kind, _ in points] == [FOLD, CORNER, GRAZING]
    return points


def scaled(value, factor):
    if isinstance(value, tuple):
        return tuple(factor * part for part in value)
    return max(1, int(factor * value)) if isinstance(value, int) else factor * value


@pytest.mark.slow
@pytest.mark.settings
@pytest.mark.parametrize(("name", "factor"), [
    (field.name, factor) for field in fields(ContinuationSettings) for factor in (0.5, 2.0)
    if (field.name, factor) != ("smooth_change", 2.0)])  # takes a corner for smooth: see `ContinuationSettings`
def test_no_special_point_depends_on_a_setting(name, factor, orbits, usual):
    """A special point is located to 1e-10 of the range; an edge, to 1e-9 of it by the arc beyond which it is seen."""
    points = verdict(orbits, replace(ContinuationSettings(), **{name: scaled(getattr(ContinuationSettings(), name),
                                                                             factor)}))
    assert [kind for kind, _ in points] == [kind for kind, _ in usual]
    assert [value for _, value in points] == pytest.approx([value for _, value in usual], rel=1e-7)
