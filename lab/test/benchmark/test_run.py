"""A program that crashes, hangs, returns NaN or is not installed gives a row with that outcome, and the run goes on."""

import math
import sys

import numpy as np
import pytest

from benchmark import problems, report, run
from benchmark.problems import COLUMNS
from vibro_lab.accuracy.harness import Effort, Row, row_of, rows
from vibro_lab.accuracy.programs import EVENT_DTYPE, PLAIN, TUNED, Answer, Program, Setting, event_array

PROBLEM = problems.load("damped")
TRUE = np.array([[float(PROBLEM.values[column][k]) for column in COLUMNS] for k in range(len(PROBLEM.times))])
EFFORT = Effort(repeats=1)

#: What a program's `prepare` does, and the outcome that is said of it.
VISITORS = {
    "crashes": ("import os, signal; return lambda: os.kill(os.getpid(), signal.SIGSEGV)", "fails", "SIGSEGV"),
    "raises": ("raise RuntimeError('no step')", "fails", "RuntimeError: no step"),
    "hangs": ("import time; return lambda: time.sleep(60)", "out of time", "more than 1 s"),
    "compiles longer than its runs may take": (
        "import time; time.sleep(1.2); return lambda: Answer(np.zeros((len(problem.times), 8)))", "ok", ""),
    "knows no number": ("return lambda: Answer(np.full((len(problem.times), 8), np.nan))", "diverges", ""),
    "tells too little": ("return lambda: Answer(np.zeros((1, 8)))", "fails", "ValueError: 1 of 21 samples"),
    "cannot": ("raise UnableError('no friction')", "cannot", "no friction"),
    "is chatty": ("print('hello'); return lambda: Answer(np.zeros((len(problem.times), 8)))", "ok", ""),
}


@pytest.mark.parametrize("name", VISITORS)
def test_what_goes_wrong_is_a_result(name, tmp_path):
    body, outcome, why = VISITORS[name]
    (tmp_path / "visitor.py").write_text(
        "import sys\nsys.path.insert(0, sys.argv.pop(1))\nimport numpy as np\nfrom benchmark.child import limited\n"
        "from benchmark.problems import load\n"
        "from vibro_lab.accuracy.harness import Effort, measure_setting, print_row\n"
        "from vibro_lab.accuracy.programs import Answer, Program, Setting, UnableError\n"
        f"def prepare(problem, setting):\n    {body}\n"
        "program = Program('visitor', (Setting(1.0, ''),), limited(prepare, float(sys.argv[3])))\n"
        "print_row(measure_setting(load(sys.argv[1]), program, program.settings[0], Effort(repeats=1)))\n")
    command = (sys.executable, str(tmp_path / "visitor.py"), str(run.ROOT))
    visitor = Program("visitor", (Setting(1.0, ""),), run._not_here, command=command)
    [row] = rows(PROBLEM, visitor, Effort(limit=1.0 if name.startswith(("hangs", "compiles")) else 120.0))
    assert (row.outcome, row.note) == (outcome, why)


def test_an_absent_program_is_one_line(monkeypatch):
    monkeypatch.setitem(run._INTERPRETERS, "siconos", "/nowhere/python3")
    [row] = rows(PROBLEM, run.program("siconos"), EFFORT)
    assert row.outcome == "absent" and "/nowhere/python3" in row.note
    assert "- siconos: " in report.page([row], "a machine", "a unit")


def judged(problem, samples, events=None):
    row = row_of(problem, Program("visitor", (), run._not_here), Setting(1.0, ""))
    return problem.judge(row, Answer(np.asarray(samples), events), problem.times)


def test_a_body_that_goes_the_wrong_way_is_called_so():
    assert judged(PROBLEM, -TRUE).outcome == "wrong sign"
    right = judged(PROBLEM, TRUE, event_array([(0.01 * k, "upper_contact") for k in range(3)]))
    assert (right.outcome, right.share_error) == ("ok", 0.0)
    assert right.note == "0 of 6 inclined contacts; 3 of 4 upper contacts"
    assert judged(PROBLEM, TRUE, np.empty(0, EVENT_DTYPE)).note.endswith("0 of 4 upper contacts")


def test_a_body_that_falls_is_called_so_whatever_its_error():
    """The outcome is a fall if the body is deeper below the ground than it rises above it; a soft ground that gives way
    by less is no fall.
    """
    ball = problems.load("bounce")
    height = ball.start["y"]
    for depth, outcome in ((0.1, "ok"), (1.1, "falls through the ground"), (100.0, "falls through the ground")):
        assert judged(ball, [[0.0] * 6 + [-depth * height, 0.0]] * len(ball.times)).outcome == outcome
    assert judged(PROBLEM, [[0.0] * 6 + [-1.0, 0.0]] * 21).outcome == "ok"


def row(**cells):
    return Row(**{"problem": "6_device", "compared": "trajectory", "program": "exact", "use": PLAIN,
                  "setting": "as it comes", "value": 1e-9, "horizon": 0.2} | cells)


def test_a_program_with_two_versions_says_where_each_ran():
    ran = [row(problem=name, program="siconos", version=f"siconos {version}")
           for name, version in (("4_damped", "4.5.0"), ("6_device", "4.5.0"), ("7_bounce", "4.4.0"))]
    assert report.versions([*ran, row(version="numba 0")]) == (
        "siconos 4.5.0 (4_damped, 6_device), siconos 4.4.0 (7_bounce), numba 0")


def test_a_digit_of_a_first_order_method_costs_ten_times():
    ladder = [row(share_error=1e-3 / k, cost=float(k), use=TUNED) for k in (1, 10, 100)]
    found = report.slope(ladder)
    assert (found.factor, found.coarse, found.fine) == pytest.approx((10.0, 1e-3, 1e-5))
    assert report.slope(ladder[:1]) is None
    assert report.slope(ladder[::-1]) is None  # the finer setting is worse: no digit is gained


def test_page_and_table_hold_every_row(tmp_path):
    late = row(program="drake", use=TUNED, setting="RK3", outcome="out of time", note="more than 60 s")
    hand = row(program="rk4_by_hand", use=TUNED, setting="step 1e-05 s", value=1e-5, share_error=1e-4, cost=0.4)
    report.write(tmp_path, [row(share_error=1e-13, cost=0.1), hand, late], "a machine")
    page = (tmp_path / report.PAGE).read_text(encoding="utf-8")
    assert "| exact | as documented | as it comes | 1.0e-13 | 0.1 |  |" in page
    assert "| drake | tuned | RK3 |  |  | **out of time**; more than 60 s |" in page
    assert "`exact` has an error of 1e-13 at 0.25 of the cost of Runge-Kutta 4 of 1e-05 s written" in page
    rows, machine, _ = report.read(tmp_path / report.RESULTS)
    assert (len(rows), machine) == (3, "a machine") and math.isnan(rows[2].cost)
    assert (tmp_path / "6_device.png").stat().st_size > 10_000


def test_the_committed_page_is_made_of_the_committed_rows():
    docs = run.ROOT / "docs" / "benchmark"
    page = report.page(*report.read(docs / report.RESULTS))
    assert (docs / report.PAGE).read_text(encoding="utf-8").startswith(page.rstrip())


def test_a_name_that_is_none_is_refused(capsys):
    with pytest.raises(SystemExit):
        run.main(["matlab"])
    assert "matlab: neither a problem nor a program of the benchmark" in capsys.readouterr().err


def test_the_page_says_first_where_another_program_wins():
    """A program wins if it is as accurate and cheaper; being cheaper alone, or failing, does not win."""
    rows = [row(problem="1_impact", cost=0.5, share_error=1e-11),
            row(problem="1_impact", program="heyoka", cost=0.4, share_error=9e-12),
            row(problem="1_impact", program="heyoka", cost=0.3, share_error=1e-9),
            row(problem="1_impact", program="cvode", cost=0.45, share_error=1e-12, outcome="wrong sign"),
            row(problem="2_grazing", cost=0.5, share_error=1e-15),
            row(problem="2_grazing", program="heyoka", cost=0.25, share_error=5e-13)]
    assert report.winners(rows, ["1_impact", "2_grazing"]).endswith(
        "cheaper: heyoka on `1_impact`, for 0.8 of its cost; heyoka on `2_grazing`, for 0.5 of its cost.")
    assert report.winners(rows[:1], ["1_impact"]).endswith("cheaper: none on any problem.")
    first, second = report.page(rows, "here", "the unit").split("\n\n")[1:3]
    assert first == report.winners(rows, ["1_impact", "2_grazing"]) and second.startswith("`exact` was not measured")
