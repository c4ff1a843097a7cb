"""docs/paper.md says what its own verdicts say, and the verdicts are what the runs give."""

import re
from pathlib import Path

import numpy as np
import pytest

from research.paper import report as paper_report
from research.paper.claims import HOLDS, NAMED, mean_of, speeds
from research.paper.readings import SPANS, Point, Reading, exact_readings, spans
from research.paper.runs import Batch, displacements, full_effort
from research.paper.tables import MARKS
from research.paper.verdicts import read_verdicts, write_verdicts
from research.paper.words import all_and_forwards

DOCS = Path(__file__).resolve().parents[3] / "docs"
TEXT = (DOCS / paper_report.TEXT).read_text(encoding="utf-8")
TABLE = DOCS / paper_report.FOLDER / paper_report.VERDICTS
TOLD = read_verdicts(TABLE)
MISPRINT = Reading("exact", 0.0, "misprint", "printed", "rest", "eq5")


def of(reading, span):
    [one] = [one for one in TOLD if (one.reading, one.span) == (reading, span)]
    return one


def test_the_page_is_the_one_that_its_verdicts_make():
    """But for the energy, which is computed anew: its digits are the same on any machine."""
    assert paper_report.document(TOLD) == TEXT, "run `make paper`"


def test_verdicts_are_read_as_they_were_written(tmp_path):
    write_verdicts(tmp_path / "again.csv", TOLD)
    assert (tmp_path / "again.csv").read_bytes() == TABLE.read_bytes()


def test_every_reading_has_a_verdict_for_each_of_its_spans():
    wanted = [(reading, span) for reading in full_effort().readings for span in spans(reading)]
    assert [(one.reading, one.span) for one in TOLD] == wanted


@pytest.mark.parametrize("reading", [MISPRINT, MISPRINT._replace(equations="corrected", start="zero"),
                                     MISPRINT._replace(equations="corrected", normal_force="unilateral")])
@pytest.mark.parametrize("point", [Point("angle", 80.0), Point("mass", 0.02)])
def test_mean_speeds_of_the_first_seconds_are_found_again(reading, point):
    """Chaos lets rounding grow by 150 in a second: another machine's mean is the same to five digits in two."""
    found = displacements(Batch(reading, point, full_effort().exact_starts))
    for span in SPANS[:2]:
        mean, spread = mean_of(speeds(found, span))
        told = of(reading, span).means[point]
        assert told.mean == pytest.approx(mean, rel=1e-5, abs=1e-8)
        assert told.spread == pytest.approx(spread, rel=1e-4, abs=1e-8)


def test_the_answer_is_what_the_verdicts_say():
    """Told in the first paragraph, by counting anew."""
    exact = [one for one in TOLD if one.reading.solver == "exact"]
    every = {equations: [one for one in exact if one.reading.equations == equations]
             for equations in ("corrected", "misprint")}
    full = {equations: sum(all(outcome in (HOLDS, NAMED) for outcome in one.along_ox)
                           and all(mean.mean > mean.spread for mean in one.means.values()) for one in told)
            for equations, told in every.items()}
    head = " ".join(TEXT.partition("## ")[0].split())
    assert f"{full['corrected'] or 'none'} of {len(every['corrected'])} combinations" in head
    assert f"{full['misprint'] or 'none'} of {len(every['misprint'])} do" in head
    assert full["misprint"] == len(all_and_forwards(every["misprint"]))


def test_tables_have_a_line_for_every_verdict():
    lines = [line for line in TEXT.splitlines() if re.match(r"\| (corrected|misprint|`\w+`), `?\w+`?", line)
             and " m/s |" in line or line.startswith("| ") and MARKS["diverges"] in line]
    assert len(lines) == len(TOLD)


def test_shown_pictures_are_there():
    names = re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT)
    assert len(names) == len(paper_report.SHOWN) and set(paper_report.SHOWN) <= set(exact_readings())
    for name in names:
        assert (DOCS / name).read_bytes().startswith(b"\x89PNG")


def test_the_misprint_is_told_with_care():
    """A hypothesis, with what speaks against it."""
    part = TEXT.partition("## Is it an index error")[2].partition("\n## ")[0]
    assert "is a hypothesis" in part
    assert part.partition("Against it")[2].count("\n- ") >= part.partition("Against it")[0].count("\n- ")
    assert np.isfinite([mean.mean for mean in of(MISPRINT, SPANS[0]).means.values()]).all()


def test_the_readme_claims_no_more():
    """Of all readings that were tried, fixed steps among them, those that give every claim have the misprint."""
    readme = " ".join((DOCS.parent / "README.md").read_text(encoding="utf-8").split())
    assert "With the equations as they should read, no reading that was tried gives all of them." in readme
    assert "With the paper's misprint taken literally some readings do, at absurd speeds." in readme
    full = all_and_forwards(TOLD)
    assert full and {one.reading.equations for one in full} == {"misprint"}
    assert min(one.means[Point("angle", 80.0)].mean for one in full) > 100.0  # m/s
