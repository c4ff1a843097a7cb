"""A program that crashes, hangs, returns no numbers or is absent is a result, and the run goes on."""

import json
import sys

import pytest

from benchmark import problems, report, run
from benchmark.contract import PLAIN, TUNED

PROBLEM = problems.load("damped")
TRUE = [[float(PROBLEM.values[column][k]) for column in problems.COLUMNS] for k in range(len(PROBLEM.times))]

#: What a runner's `prepare` returns, and the outcome that is said of it.
VISITORS = {
    "crashes": ("import os, signal; return lambda: os.kill(os.getpid(), signal.SIGSEGV)", "fails", "SIGSEGV"),
    "raises": ("raise RuntimeError('no step')", "fails", "RuntimeError: no step"),
    "hangs": ("import time; return lambda: time.sleep(60)", "out of time", "more than 2 s"),
    "knows no number": ("return lambda: Answer([[float('nan')] * 8] * len(problem.times))", "diverges", None),
    "tells too little": ("return lambda: Answer([[0.0] * 8])", "fails", "1 of 21 samples"),
    "cannot": ("raise UnableError('no friction')", "cannot", "no friction"),
    "is chatty": ("print('hello'); return lambda: Answer([[0.0] * 8] * len(problem.times))", "ok", None),
}


@pytest.mark.parametrize("name", VISITORS)
def test_what_goes_wrong_is_a_result(name, tmp_path, monkeypatch):
    body, outcome, why = VISITORS[name]
    package = tmp_path / "benchmark" / "runners"
    package.mkdir(parents=True)
    (package / "visitor.py").write_text(
        "from benchmark.contract import Answer, Setting, UnableError\nSETTINGS = [Setting('tuned', '', 0.0)]\n"
        f"def version():\n    return 'visitor 1'\ndef prepare(problem, setting):\n    {body}\n")
    monkeypatch.setenv("PYTHONPATH", str(run.ROOT))
    text = (f"import sys, benchmark.runners; benchmark.runners.__path__.append({str(package)!r})\n"
            "from benchmark.child import measure; import json; print(json.dumps(measure('visitor', '4_damped', 0)))")
    monkeypatch.setattr(run, "_command", lambda runner, words: [sys.executable, "-c", text])
    row = run.judged(PROBLEM, run.run_child("visitor", "4_damped", 0, limit=2.0 if name == "hangs" else 60.0))
    assert (row["outcome"], row.get("why")) == (outcome, why)


def test_an_absent_program_is_one_line(monkeypatch):
    monkeypatch.setitem(run._INTERPRETERS, "siconos", "/nowhere/python3")
    found = list(run.measured(["4_damped"], ["siconos"], 2.0))
    assert [row["outcome"] for row in found] == ["absent"]
    assert "/nowhere/python3" in found[0]["why"]
    assert "- siconos: " in report.page(found, ["4_damped"], "a machine")


def test_a_body_that_goes_the_wrong_way_is_called_so():
    backwards = [[-number for number in row] for row in TRUE]
    assert run.judged(PROBLEM, {"states": backwards, "events": None})["outcome"] == "wrong sign"
    right = run.judged(PROBLEM, {"states": TRUE, "events": {"upper_contact": 3}})
    assert (right["outcome"], right["error"]) == ("ok", 0.0)
    assert right["missed"] == {"upper_contact": [3, 4], "inclined_contact": [0, 6]}


def test_a_body_that_falls_is_called_so_whatever_its_error():
    """Deeper below the ground than it rises above it; a soft ground that gives way by less is no fall."""
    ball = problems.load("bounce")
    height = ball.start["y"]
    for depth, outcome in ((0.1, "ok"), (1.1, "falls through the ground"), (100.0, "falls through the ground")):
        states = [[0.0] * 6 + [-depth * height, 0.0]] * len(ball.times)
        assert run.judged(ball, {"states": states, "events": None})["outcome"] == outcome
    assert run.judged(PROBLEM, {"states": [[0.0] * 6 + [-1.0, 0.0]] * 21, "events": None})["outcome"] == "ok"


def test_a_program_with_two_versions_says_where_each_ran():
    rows = [{"problem": name, "runner": "siconos", "version": f"siconos {version}"}
            for name, version in (("4_damped", "4.5.0"), ("6_device", "4.5.0"), ("7_bounce", "4.4.0"))]
    assert report.versions([*rows, {"problem": "4_damped", "runner": "rk4", "version": "numba 0"}]) == (
        "siconos 4.5.0 (4_damped, 6_device), siconos 4.4.0 (7_bounce), numba 0")


def test_a_digit_of_a_first_order_method_costs_ten_times():
    rows = [{"outcome": "ok", "error": 1e-3 / k, "cost": float(k), "kind": TUNED} for k in (1, 10, 100)]
    found = report.price(rows)
    assert found == pytest.approx((10.0, 1e-3, 1e-5))
    assert report.price(rows[:1]) is None
    assert report.price(rows[::-1]) is None  # the finer setting is worse: no digit is gained


def test_page_and_table_hold_every_row(tmp_path):
    row = {"problem": "6_device", "runner": "exact", "kind": PLAIN, "label": "as it comes", "outcome": "ok",
           "error": 1e-13, "cost": 0.1, "version": "vibro_ros 0"}
    late = row | {"runner": "drake", "kind": TUNED, "label": "RK3", "outcome": "out of time", "why": "more than 60 s"}
    report.write(tmp_path, [row, {key: late[key] for key in late if key not in ("error", "cost")}], "a machine")
    page = (tmp_path / report.PAGE).read_text(encoding="utf-8")
    assert "| exact | as documented | as it comes | 1.0e-13 | 0.1 |  |" in page
    assert "| drake | tuned | RK3 |  |  | **out of time**: more than 60 s |" in page
    assert len(json.loads((tmp_path / report.RESULTS).read_text())["rows"]) == 2
    assert (tmp_path / "6_device.png").stat().st_size > 10_000


def test_a_name_that_is_none_is_refused(capsys):
    with pytest.raises(SystemExit):
        run.main(["matlab"])
    assert "matlab: neither a problem nor a program of the benchmark" in capsys.readouterr().err
