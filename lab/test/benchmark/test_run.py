"""A program that crashes, hangs, returns NaN or is not installed gives a row with that outcome, and the run goes on."""

import sys

import numpy as np
import pytest

from benchmark import problems, report, run
from benchmark.problems import COLUMNS
from tools import documents
from vibro_lab.accuracy.harness import Effort, Row, read_rows, row_of, rows
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
    assert "Not installed: siconos (" in report.benchmark_page([row])


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


def test_pages_and_table_hold_every_row(tmp_path):
    late = row(program="drake", use=TUNED, setting="RK3", outcome="out of time", note="more than 60 s")
    timed = row(share_error=1e-13, cost=0.001, set_up=0.0005)
    run._keep(tmp_path / report.PROBLEM_ROWS, iter([timed, row(problem="1_impact", program="heyoka")]))
    run._keep(tmp_path / report.PROBLEM_ROWS, iter([late, row(problem="1_impact", program="heyoka", cost=0.2)]))
    rows = read_rows(tmp_path / report.PROBLEM_ROWS)  # what is measured again replaces only its own rows
    assert [(kept.problem, kept.program, kept.cost == 0.2) for kept in rows] == [
        ("1_impact", "heyoka", True), ("6_device", "exact", False), ("6_device", "drake", False)]
    assert report.publish(tmp_path, report.PROBLEM_ROWS) == [tmp_path / report.BENCHMARK]
    page = (tmp_path / report.BENCHMARK).read_text(encoding="utf-8")
    assert "`exact` has an error of 1e-13 at 0.001 s for each simulated second and 0.0005 s of set-up." in page
    assert (tmp_path / "benchmark" / "6_device.png").stat().st_size > 10_000


def test_the_committed_page_is_made_of_the_committed_rows():
    docs = run.ROOT / "docs"
    rows = read_rows(docs / report.PROBLEM_ROWS)
    assert documents.without_marks((docs / report.BENCHMARK).read_text(encoding="utf-8")) == report.benchmark_page(rows)


def test_a_name_that_is_none_is_refused(capsys):
    with pytest.raises(SystemExit):
        run.main(["matlab"])
    assert "matlab: no problem, no scene and no program of the benchmark" in capsys.readouterr().err


def test_a_program_wins_if_it_is_as_accurate_and_cheaper_set_up_included():
    rows = [row(problem="1_impact", cost=0.5, set_up=0.1, share_error=1e-11),
            row(problem="1_impact", program="heyoka", cost=0.2, set_up=0.12, share_error=9e-12),
            row(problem="1_impact", program="heyoka", cost=0.1, set_up=0.0, share_error=1e-9),
            row(problem="1_impact", program="cvode", cost=0.45, set_up=0.0, share_error=1e-12, outcome="wrong sign"),
            row(problem="2_grazing", cost=0.5, set_up=0.0, share_error=1e-15),
            row(problem="2_grazing", program="heyoka", cost=0.1, set_up=0.1, share_error=5e-13)]
    assert report.winners(rows) == [("heyoka", "1_impact", pytest.approx(0.8))]
    first, second = report.benchmark_page(rows).split("\n\n")[1:3]
    assert first.endswith("set-up included: heyoka on `1_impact`, in 0.8 of its time.")
    assert second.startswith("`exact` was not measured")
