"""docs/optimum.md is made of docs/optimum/*.json by the code as it is, and its robots do what it says."""

import math
from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from research.optimum import text as optimum_text
from research.optimum.report import LASTING, TEXT, watched_of
from research.optimum.result_file import read_result
from research.optimum.text import FOLDER, SEARCHES, plan
from vibro_ros.study.optimise.plan import VERIFYING, Reading, Trials, directed, values_of
from vibro_ros.study.optimise.verification import OPTIMUM, PAPER

DOCS = Path(__file__).resolve().parents[2] / "docs"
RESULTS = {name: read_result(DOCS / FOLDER / f"{name}.json", plan(name)) for name in SEARCHES}
WATCHED = watched_of(DOCS / FOLDER / LASTING)


def test_the_document_is_made_of_the_numbers():
    assert (DOCS / TEXT).read_text(encoding="utf-8") == optimum_text.document(RESULTS, WATCHED)


@pytest.mark.parametrize("name", SEARCHES)
def test_the_scene_files_are_the_optima(name):
    assert vibro_ros.load_scene(DOCS / FOLDER / f"{name}.yaml").parameters == RESULTS[name].robot.parameters


@pytest.mark.parametrize("name", ["thriftiest", "thrifty", "fastest"])
def test_the_optima_do_what_is_said(name):
    """From three of the starts that verified: the mean lies within the spread of so few."""
    row = RESULTS[name].verified[0]
    verifying = plan(name).effort.verifying
    values = values_of(RESULTS[name].robot, Trials(3, verifying.settling, verifying.duration, VERIFYING))
    deviation = row.speed.spread * math.sqrt(verifying.starts)
    assert np.mean(directed(values[:, 0], Reading().direction)) == pytest.approx(
        row.speed.mean, rel=1e-3, abs=2.0 * deviation)


@pytest.mark.parametrize("name", [name for name in SEARCHES if name != "front"])
def test_the_optimum_beats_the_papers_beyond_noise(name):
    best, paper = (next(row for row in RESULTS[name].verified if row.robot == robot) for robot in (OPTIMUM, PAPER))
    margin = paper.ratio_margin if plan(name).objective == "speed_per_power" else paper.margin
    assert margin.mean > margin.spread
    assert best.agree


def test_the_least_speed_is_kept():
    assert RESULTS["thrifty"].verified[0].speed.mean > plan("thrifty").least_speed


def test_power_vanishes_in_the_paper_and_speed_does_not():
    first, last = WATCHED["paper"][0], WATCHED["paper"][-1]
    assert last.power < first.power / 10.0
    assert last.speed.mean == pytest.approx(first.speed.mean, rel=0.2)
