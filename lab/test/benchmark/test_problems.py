"""The problems: pages, data and equations say the same, and programs that share nothing agree with the reference."""

import re
from importlib import import_module

import numpy as np
import pytest
from flint import arb

from benchmark import located, problems, reference
from benchmark.equations import Callbacks, accelerations, forces, guards, machine, slope, start
from benchmark.problems import COLUMNS, FOLDER
from vibro_lab.accuracy.programs import DEVICE, Setting

NAMES = problems.names()
pytestmark = pytest.mark.filterwarnings("ignore::numba.NumbaExperimentalFeatureWarning")


def rows(problem):
    """The reference values as floats, a row an instant."""
    return np.array([[float(problem.values[column][k]) for column in COLUMNS] for k in range(len(problem.times))])


@pytest.mark.parametrize("name", NAMES)
def test_the_page_states_what_the_data_file_holds(name):
    problem, page = problems.load(name), (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert page.startswith(f"# {problem.title}\n")
    stated = dict(re.findall(r"^\| (\w+) \| ([\d.e+-]+) \|$", page, re.MULTILINE))
    assert stated
    assert {symbol: problem.parameters[symbol] for symbol in stated} == {s: float(text) for s, text in stated.items()}
    start_values = dict(re.findall(r"(\w+) = ([\d.e+-]+\d)", page.partition("Start: ")[2].partition(";")[0]))
    assert {column: float(start_values.get(column, 0.0)) for column in COLUMNS} == problem.start
    for kind, event in problem.events.items():
        assert f"{event['count']} {kind.replace('_', ' ')}" in page


@pytest.mark.parametrize("name", NAMES)
def test_the_data_file_is_in_order(name):
    problem = problems.load(name)
    assert all(len(column) == len(problem.times) for column in problem.values.values())
    assert problem.digits >= reference.DIGITS
    assert max(len(text.lstrip("-0.").partition("e")[0]) for text in problem.values[problem.judged[0]]) >= 59
    assert list(rows(problem)[0]) == [problem.start[column] for column in COLUMNS]
    assert problem.error(rows(problem)) == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_exact_keeps_its_promise(name):
    """Rounding, which the loss-free problems amplify (e⁵ a second, and more at resonance).

    A ball that lands at less than 1e-9 m/s rests, which is early by 3e-11 m/s in one sample of `7_bounce`.
    """
    problem = problems.load(name)
    answer = DEVICE["exact"].prepare(problem, DEVICE["exact"].settings[0])()
    assert problem.error(answer.samples) < (1e-10 if name in ("1_impact", "5_loss_free", "7_bounce") else 1e-12)
    assert not problem.missed(answer) or name == "7_bounce"


@pytest.mark.parametrize("name", NAMES)
def test_heyoka_agrees_with_the_reference_to_rounding(name):
    """heyoka is another method by other authors, so that it checks the reference values independently."""
    pytest.importorskip("heyoka", reason="heyoka is the second road")
    problem = problems.load(name)
    answer = import_module("benchmark.programs.heyoka").prepare(problem, Setting(2.2e-16, ""))()
    assert problem.error(answer.samples) < 1e-13


def test_the_closed_form_of_the_ball_agrees_with_the_integration_of_the_other_problems():
    """Taylor series from landing to landing, which rest below 1e-36 m/s; and the two events."""
    problem = problems.load("bounce")
    integrated, _ = reference.integrate(dict(problem.parameters), problem.times[-1], **reference.FIRST)
    for column in problem.judged:
        for row, text in zip(integrated, problem.values[column], strict=True):
            assert abs(row[COLUMNS.index(column)] - arb(text)) < arb("1e-58"), column
    g, e, height = (arb(number) for number in (problem.parameters["g"], problem.parameters["restitution"],
                                               problem.start["y"]))
    first = (2 * height / g).sqrt()
    assert abs(arb(problem.events["landing"]["first"]) - first) < arb("1e-58")
    assert abs(arb(problem.events["landing"]["last"]) - first * (1 + e) / (1 - e)) < arb("1e-58")


def test_a_ball_that_may_not_rest_falls_through_the_ground():
    """DOP853 from landing to landing, without `slow`: the last flights are shorter than the spacing of doubles."""
    problem = problems.load("bounce")
    integrated = import_module("benchmark.programs.scipy")._steps
    endless, ending = Callbacks(machine(problem)), Callbacks(machine(problem, slow=1e-9))
    answer = located.run(problem, endless, integrated(endless, 1e-9))
    assert 50 < np.count_nonzero(answer.events["kind"] == "landing") < 100
    assert answer.samples[-1][COLUMNS.index("y")] < -0.1
    assert problem.error(located.run(problem, ending, integrated(ending, 1e-9)).samples) < 1e-10
    assert ending.mode[3] > ending.mode[4] > 100 and 0.0 < answer.callbacks() < 1.0


@pytest.mark.parametrize("name", [name for name in NAMES if name != "7_bounce"])
def test_the_unit_of_cost_converges_to_the_reference(name):
    """The device's Runge-Kutta crosses events without locating them: first order, or better where no force jumps."""
    problem = problems.load(name)
    coarse, fine = (problem.error(DEVICE["rk4"].prepare(problem, Setting(step, ""))().samples) for step in (1e-5, 1e-6))
    assert fine < 0.25 * coarse


def test_the_compiled_equations_are_the_rows_of_the_readme():
    """The accelerations of every mode, put into the four rows of the equations, leave no remainder."""
    problem = problems.load("device")
    p, generator = machine(problem), np.random.default_rng(1)
    m2, m3, total, sine, cosine = p.m2, p.m3, p.total, p.sine, p.cosine
    for ground, slide in ((2, 0.0), (1, 1.0), (-1, -1.0), (0, 0.0), (3, 0.0)):
        y = start(problem) + generator.normal(size=8)
        f2, f3 = forces(0.3, y, True, True, p)
        au, aw, ax, ay, normal = accelerations(f2, f3, slide, ground, p)
        friction = p.mu * normal * slide if ground != 2 else -(total * ax - m3 * sine * aw)
        remainders = (total * ax - m3 * sine * aw + friction,
                      total * ay + m2 * au + m3 * cosine * aw - normal + total * p.g,
                      m2 * au + m2 * ay + f2, m3 * aw + m3 * (cosine * ay - sine * ax) + f3)
        assert np.abs(remainders).max() < 1e-12 * (abs(f2) + abs(f3)), ground


def test_guards_are_positive_within_the_mode_that_a_start_has():
    for name in NAMES:
        problem = problems.load(name)
        p, y = machine(problem), start(problem)
        values, out = np.empty(4), np.empty(8)
        mode = import_module("benchmark.equations").begin(0.0, y, p)
        guards(0.0, y, *mode, p, values)
        slope(0.0, y, *mode, float(mode[2]), p, out)
        assert np.all(values >= 0.0), name
        assert np.all(np.isfinite(out)), name


def test_no_number_is_no_small_error():
    problem = problems.load("damped")
    states = rows(problem)
    states[7] = np.nan
    assert np.isnan(problem.error(states))
    with pytest.raises(ValueError, match="'friction' is no problem of the benchmark; there are 1_impact"):
        problems.load("friction")
