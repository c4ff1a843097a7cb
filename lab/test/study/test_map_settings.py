"""Halved and doubled, no setting of a map changes which motions it finds, apart from `COUNTED`."""

from dataclasses import fields, replace

import pytest

import vibro_ros
from vibro_lab.study.map import SIDES, GridAxis, MapDesign, MapSettings, motions, visits

#: `damped` from one motion over two to one, between the folds that `test_map.py` names.
DESIGN = MapDesign(vibro_ros.load_scene("damped"), SIDES, GridAxis(102.0, 109.0, 8), GridAxis(-1e-6, 0.0, 2))
#: A doubled least number of cells leaves a motion of fewer cells without a number.
COUNTED = {("least_cells", 2.0)}


def verdict(settings: MapSettings) -> list[tuple[int, int, float, bool]]:
    """Cells, mean speeds [mm/s] and whether they are numbered, of all motions that the sweeps find."""
    design = replace(DESIGN, settings=settings)
    table, _ = motions((visit for line in design.lines() for visit in visits(design, line)), settings=settings)
    return [(speed, gap, round(1e3 * mean, 2), number >= 0) for speed, gap, mean, number in zip(
        table.speed_index.tolist(), table.gap_index.tolist(), table.mean_speed.tolist(), table.motion.tolist(),
        strict=True)]


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
    motions_found = verdict(replace(MapSettings(), **{name: type(value)(factor * value)}))
    if (name, factor) in COUNTED:
        motions_found = [(*cells, True) for *cells, _ in motions_found]
    assert motions_found == usual
