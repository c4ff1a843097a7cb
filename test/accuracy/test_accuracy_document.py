"""Each sentence of docs/accuracy.md and of README.md about accuracy is what docs/accuracy/accuracy.csv says."""

import csv
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from tools import accuracy_report, bench
from vibro_ros.accuracy.findings import NEEDS, Need, baseline_in_words, finding, prices_in_words
from vibro_ros.accuracy.measurement import NEED, Measurement, errors
from vibro_ros.accuracy.methods import METHODS
from vibro_ros.accuracy.precision import SHORT, running
from vibro_ros.model.support import unsupported

_USE = re.compile(r"(\w+)(?: ([\d.e-]+)(?: s)?)? \(([\d.]+)\)")


@dataclass(frozen=True)
class Advised:
    """A use that a cell of the table names: in a scene, for a need, a method, its setting and its cost."""

    scene: str
    need: Need
    method: str
    value: float
    cost: float


def rows_of(file: Path) -> list[Measurement]:
    """The rows of a table."""
    kinds = {field.name: field.type for field in fields(Measurement)}
    read = {"str": str, "float": float, "int": int, str: str, float: float, int: int}
    with file.open(encoding="utf-8") as lines:
        return [Measurement(**{name: read[kinds[name]](cell) for name, cell in line.items()})
                for line in csv.DictReader(lines)]


def advised(text: str) -> Iterator[Advised]:
    """Every use that the table under "Which method for what" names."""
    table = text.partition("## Which method for what")[2].partition("\n## ")[0]
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"]
    heads = lines[0]
    for cells in lines[2:]:
        for need in NEEDS:
            for method, value, cost in _USE.findall(cells[heads.index(need.words)]):
                yield Advised(cells[0].strip("`"), need, method, float(value or "nan"), float(cost))


def complaints(text: str, rows: Sequence[Measurement]) -> list[str]:
    """Uses that their rows deny: too inaccurate there or at a finer setting, not the coarsest, or of another cost."""
    found = []
    for use in advised(text):
        own = sorted((row for row in rows if (row.scene, row.compared, row.method, row.horizon) == (
            use.scene, NEED, use.method, use.need.horizon)), key=lambda row: row.value)
        here = [row for row in own if not abs(row.value / use.value - 1.0) > 0.02]  # exact has no value
        finer = [row for row in own if here and row.value <= here[0].value]
        coarser = [row for row in own if here and row.value > here[0].value]
        if not here or any(not error_of(row, use.need) < use.need.limit for row in finer):
            found.append(f"{use}: missed")
        elif coarser and error_of(coarser[0], use.need) < use.need.limit:
            found.append(f"{use}: a coarser one does, too")
        elif not math.isclose(here[0].cost, use.cost, rel_tol=0.06):
            found.append(f"{use}: costs {here[0].cost:g}")
    return found


def error_of(row: Measurement, need: Need) -> float:
    """A row's error for a need, by the words of the need and the columns of the table."""
    if "contact" in need.words:
        return row.event_error
    parts = [row.body_error, row.height_error] + [row.mass_error] * ("every position" in need.words)
    return math.nan if any(map(math.isnan, parts)) else max(parts)


ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
ROWS = rows_of(ROOT / "docs" / "accuracy" / "accuracy.csv")
BY_SCENE: dict[str, list[Measurement]] = defaultdict(list)
for _row in ROWS:
    BY_SCENE[_row.scene].append(_row)
README = (ROOT / "README.md").read_text(encoding="utf-8")
BENCH = TEXT.partition(accuracy_report.BENCH)[2].partition("\n## ")[0]


def test_every_advice_holds_against_its_own_rows():
    assert len(list(advised(TEXT))) > 30
    assert complaints(TEXT, ROWS) == []


SOME = [use for use in advised(TEXT) if use.need in NEEDS[:2] and use.method in ("exact", "heyoka") or (
    use.need is NEEDS[0] and use.value >= 1e-6)]


@pytest.mark.parametrize("use", SOME, ids=lambda use: f"{use.scene}-{use.method}-{use.need.limit:g}")
def test_advice_holds_at_other_instants_too(use):
    """Every microsecond, between the instants that the rows were measured at; against exact."""
    scene = running(vibro_ros.load_scene(use.scene))
    times, run = np.linspace(0.0, SHORT, 200_001), METHODS.get(use.method)
    if use.method == "heyoka":
        run, times = pytest.importorskip("tools.peer.accuracy").by_heyoka, times[::8]
    value = next(row.value for row in BY_SCENE[use.scene] if row.method == use.method and row.compared == NEED and (
        use.method == "exact" or row.value == pytest.approx(use.value, rel=0.02)))
    found, exact = run(scene, times, value), METHODS["exact"](scene, times, 1e-12)
    assert errors(found, exact).positions < use.need.limit


def test_the_page_begins_with_what_a_digit_costs():
    head = TEXT.partition("Measured on")[0]
    assert [line[2:] for line in head.splitlines() if line.startswith("- ")] == prices_in_words(BY_SCENE)
    assert head.index(accuracy_report.known_to(BY_SCENE)) < head.index("`exact` has no setting")
    assert "scipy's solvers with events" in head and accuracy_report.PRICE in head


def test_before_that_stands_the_chart_of_the_benchmark():
    sentence, chart, more = accuracy_report.about_the_benchmark()
    assert TEXT.index(sentence) < TEXT.index(chart) < TEXT.index(more) < TEXT.index(accuracy_report.known_to(BY_SCENE))


def test_findings_are_those_of_the_rows():
    for text in accuracy_report.headlines(BY_SCENE):
        assert f"\n- {text}\n" in TEXT
    assert finding(BY_SCENE[accuracy_report.CLOSER]) in TEXT


def test_the_device_is_measured_running():
    assert {row.scene for row in ROWS} == set(bench.SCENES)
    exact = [row for row in BY_SCENE["device"] if row.method == "exact" and row.compared == NEED]
    assert exact and all(error_of(row, NEEDS[2]) == 0.0 for row in exact)  # it has contacts


def test_readme_says_what_the_rows_and_the_bench_say():
    """README's cost of exact is the bench's, its error of Runge-Kutta the rows'; fixed steps lead the wrong way."""
    readme = README.replace("\n", " ")
    found = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", BENCH, re.MULTILINE)
    cost_of = {name: 100 * float(cost) for name, cost in found}
    assert list(cost_of) == list(bench.SCENES)
    costs = [cost for name, cost in cost_of.items() if not unsupported(vibro_ros.load_scene(name), "baseline")]
    assert f"`exact` costs {min(costs):.1f} to {max(costs):.1f} % of Runge-Kutta 4" in readme
    assert f"with the dc motor of `machine` {cost_of['machine']:.1f} % of the robot's own `rk4`" in readme
    baseline = re.search(r"off by .*? within 0.2 s", baseline_in_words(BY_SCENE))[0]
    assert f"steps of 1e-5 s (`make bench`), which is {baseline}" in readme
    assert "WRONG SIGN" in finding(BY_SCENE["paper"])
    compiled = {"heyoka", *(name for name, method in METHODS.items() if method.compiled)}
    assert compiled >= {use.method for use in advised(TEXT)}
