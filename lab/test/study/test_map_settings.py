"""Halved and doubled, no setting of a map changes which motions it finds."""

from dataclasses import fields, replace

import pytest

import vibro_ros
from vibro_lab.study.map import SIDES, GridAxis, MapDesign, MapSettings, motions, visits

#: `damped` from one motion over two to one, between the folds that `test_map.py` names.
DESIGN = MapDesign(vibro_ros.load_scene("damped"), SIDES, GridAxis(102.0, 109.0, 8), GridAxis(-1e-6, 0.0, 2))


def verdict(settings: MapSettings) -> list[tuple[int, int, float]]:
    """Cells and mean speeds [mm/s] of all motions that the sweeps find."""
    design = replace(DESIGN, settings=settings)
    distinct = motions((visit for line in design.lines() for visit in visits(design, line)), settings=settings)
    return [(motion.speed_index, motion.gap_index, round(1e3 * motion.mean_speed, 2)) for motion in distinct]


@pytest.fixture(scope="module")
def usual():
    return verdict(MapSettings())


@pytest.mark.slow
@pytest.mark.settings
@pytest.mark.parametrize(("name", "factor"), [
    (field.name, factor) for field in fields(MapSettings) for factor in (0.5, 2.0)
    if (field.name, factor) != ("phase", 2.0)])  # the crank angle 0, where plates are touched: see `MapSettings`
def test_no_verdict_depends_on_a_setting(name, factor, usual):
    value = getattr(MapSettings(), name)
    assert verdict(replace(MapSettings(), **{name: type(value)(factor * value)})) == usual
