"""docs/accuracy.md and its page of scenes are what docs/accuracy/accuracy.csv says; README repeats its sentences."""

from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from benchmark import report
from benchmark.costs import SCENES
from tools import documents
from vibro_lab.accuracy.harness import AVERAGE, REQUIRED, errors, read_rows
from vibro_lab.accuracy.programs import by_device
from vibro_lab.accuracy.report import REQUIREMENTS, cheapest
from vibro_lab.accuracy.scene_rows import SHORT
from vibro_lab.orbits.starts import running

DOCS = Path(__file__).resolve().parents[3] / "docs"
ROWS = report.by_problem(read_rows(DOCS / report.SCENE_ROWS))
README = (DOCS.parent / "README.md").read_text(encoding="utf-8")


def test_every_cell_and_sentence_of_the_pages_is_made_of_the_rows():
    page = documents.without_marks((DOCS / report.ACCURACY).read_text(encoding="utf-8"))
    assert report.accuracy_page(ROWS) == page
    assert report.scenes_page(ROWS) == (DOCS / report.SCENES_PAGE).read_text(encoding="utf-8")


def test_the_first_screen_answers():
    """Three sentences, one picture, one table of at most eight rows; the five labelled programs were measured."""
    page = report.accuracy_page(ROWS)
    screen = page.partition(report.heyoka_sentence(ROWS))[0]
    assert len(report.answer(ROWS)) == 3 and all(sentence in screen for sentence in report.answer(ROWS))
    assert screen.count("![") == 1 and 3 <= screen.count("\n| ") - 1 <= 8
    assert len(page.splitlines()) <= 60
    assert {row.program for row in ROWS[report.SHOWN] if row.horizon == 10.0 and row.compared == REQUIRED} >= set(
        report.LABELLED)


def test_every_scene_was_measured():
    assert list(ROWS) == sorted(SCENES)
    for measured in ROWS.values():
        assert {row.compared for row in measured} >= {"exponent", "reference", "trajectory", REQUIRED, AVERAGE}


ADVISED = [(name, row, asked) for name, measured in ROWS.items() for asked in REQUIREMENTS[:2]
           for row in cheapest(measured, asked).values() if row.program == "rk4_located" and row.value >= 1e-5]


@pytest.mark.parametrize(("name", "row", "asked"), ADVISED, ids=lambda cell: str(getattr(cell, "value", cell))[:20])
def test_advice_holds_at_other_instants_too(name, row, asked):
    """Errors are compared with exact every microsecond, between the instants at which the rows were measured."""
    scene, times = running(vibro_ros.load_scene(name)), np.linspace(0.0, SHORT, 200_001)
    answer, exact = by_device(row.program, scene, times, row.value), by_device("exact", scene, times, 1e-12)
    assert max(errors(answer, exact, SHORT).columns[::2]) < asked.limit


def test_readme_repeats_the_sentences_of_the_rows():
    assert report.in_readme(README, ROWS) == README and report.heyoka_sentence(ROWS) in README
