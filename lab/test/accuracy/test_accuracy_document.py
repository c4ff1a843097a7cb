"""docs/accuracy.md is what docs/accuracy/accuracy.csv says; README's sentences about accuracy are, too."""

import re
from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from benchmark import scenes
from tools import documents
from vibro_lab.accuracy.harness import AVERAGE, REQUIRED, errors, read_rows
from vibro_lab.accuracy.programs import by_device
from vibro_lab.accuracy.report import BY_HAND, REQUIREMENTS, cheapest, finding
from vibro_lab.accuracy.scene_rows import SHORT
from vibro_lab.orbits.starts import running

DOCS = Path(__file__).resolve().parents[3] / "docs"
TEXT = documents.without_marks((DOCS / "accuracy.md").read_text(encoding="utf-8"))
ROWS = scenes.by_scene(read_rows(DOCS / "accuracy" / "accuracy.csv"))
README = (DOCS.parent / "README.md").read_text(encoding="utf-8").replace("\n", " ")
COSTS = TEXT.partition(scenes.COSTS)[2].partition("\n\nWhat each effect")[0].partition("times are not.\n\n")[2]


def test_every_cell_and_sentence_of_the_page_is_made_of_the_rows():
    measured_on = re.search(r"Measured on: (.*)\.$", TEXT, re.MULTILINE)[1]
    assert scenes.page(ROWS, measured_on, COSTS, DOCS) == TEXT


def test_every_scene_was_measured():
    assert list(ROWS) == sorted(scenes.SCENES)
    for own in ROWS.values():
        assert {row.compared for row in own} >= {"exponent", "reference", "trajectory", REQUIRED, AVERAGE}


SOME = [(name, row, asked) for name, own in ROWS.items() for asked in REQUIREMENTS[:2]
        for row in cheapest(own, asked).values() if row.program in ("exact", "rk4_located") and row.value >= 1e-5]


@pytest.mark.parametrize(("name", "row", "asked"), SOME, ids=lambda one: str(getattr(one, "value", one))[:20])
def test_advice_holds_at_other_instants_too(name, row, asked):
    """Errors are compared with exact every microsecond, between the instants at which the rows were measured."""
    scene, times = running(vibro_ros.load_scene(name)), np.linspace(0.0, SHORT, 200_001)
    found, exact = by_device(row.program, scene, times, row.value), by_device("exact", scene, times, 1e-12)
    assert max(errors(found, exact, SHORT).columns[::2]) < asked.limit


def test_readme_says_what_the_rows_and_the_bench_say():
    """README has the cost of exact from the bench and the error of Runge-Kutta from the rows; fixed steps give a wrong
    direction.
    """
    cost_of = {name: 100 * float(cost) for name, cost in re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", COSTS, re.MULTILINE)}
    assert list(cost_of) == list(scenes.SCENES)
    costs = [cost for name, cost in cost_of.items() if name != "machine"]
    assert f"`exact` costs {min(costs):.1f} to {max(costs):.1f} % of Runge-Kutta 4" in README
    assert f"with the dc motor of `machine` {cost_of['machine']:.1f} % of the robot's own `rk4`" in README
    off = {name: row.position_error for name, own in ROWS.items() for row in own
           if (row.program, row.compared, row.horizon, row.value) == (BY_HAND, REQUIRED, SHORT, 1e-5)}
    least, worst = min(off, key=off.get), max(off, key=off.get)
    assert (f"steps of 1e-5 s (`make bench`), which is off by {off[least]:.1e} m (`{least}`) to "
            f"{off[worst]:.1e} m (`{worst}`) within 0.2 s") in README
    assert "WRONG SIGN" in finding(ROWS["paper"])
