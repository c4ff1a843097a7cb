"""`accuracy`: a wrong method looks wrong, an interruption loses nothing, bad input is refused in words."""

import csv
import math
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

import vibro_ros
from vibro_ros.accuracy import accuracy, precision
from vibro_ros.accuracy.advice import MEAN_SPEED, NEEDS, advice, cheapest
from vibro_ros.accuracy.chaos import Growth, growth
from vibro_ros.accuracy.coverage import covered
from vibro_ros.accuracy.errors import errors
from vibro_ros.accuracy.methods import METHODS, Answer, ComparedMethod, UnableError
from vibro_ros.accuracy.precision import LONG, SHORT, Comparison, Effort, SceneStudy
from vibro_ros.accuracy.price import baseline_in_words, price_of_a_digit, price_over_scenes, prices_in_words
from vibro_ros.accuracy.row import AVERAGE, NEED, REFERENCE, TRAJECTORY, Row
from vibro_ros.accuracy.starts import Average, average, speeds_of_starts, started
from vibro_ros.accuracy.studied import STUDIED
from vibro_ros.accuracy.words import BELOW, finding, markdown, speeds_table
from vibro_ros.project import accuracy_report

QUICK = Effort(repeats=1, horizon=0.1, starts=2, duration=0.5)


def with_less_damping(scene, times, step):
    damping = {f"{side}.spring.damping": 0.9 * scene[f"{side}.spring.damping"] for side in ("upper", "inclined")}
    return METHODS["rk4"](scene.with_parameters(damping), times, step)


def exploding(scene, times, step):
    answer = METHODS["rk4"](scene, times, step)
    return Answer(times, np.full_like(answer.samples, np.nan), answer.events, 1, 1, 1.0)


def unable(scene, times, step):
    raise UnableError("cannot do it")


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    """Rows of the scene damped, by right, wrong, exploding and unable methods."""
    steps = (1e-4, 1e-5, 1e-6)
    table = {"exact": METHODS["exact"], "rk4": ComparedMethod(METHODS["rk4"].run, "step", steps),
             "planted": ComparedMethod(with_less_damping, "step", steps),
             "exploding": ComparedMethod(exploding, "step", (1e-4,)),
             "unable": ComparedMethod(unable, "step", (1e-4,)), "baseline": STUDIED["baseline"]}
    study = SceneStudy(vibro_ros.load_scene("damped"), QUICK)
    measured = list(study.rows(table))
    assert len(measured) <= study.count(table)
    return measured


def of(rows, method, compared=TRAJECTORY):
    return [row for row in rows if row.method == method and row.compared == compared]


def test_a_wrong_method_looks_wrong(rows):
    """Steps of a tenth gain at least a factor of 3 a decade where the method is right, none where it is wrong."""
    right, wrong = ([row.mass_error for row in of(rows, name)] for name in ("rk4", "planted"))
    assert right[-1] < right[0] / 9.0
    assert wrong[-1] > 0.3 * wrong[-2] and wrong[-1] > 10.0 * right[-1]
    assert of(rows, "planted")[-1].body_error > 10.0 * of(rows, "rk4")[-1].body_error
    assert "| planted | step 1e-06 s |" in markdown(rows)


def test_the_reference_is_checked_by_another_method(rows):
    """Both are accurate to rounding errors; 1e-9 m is DOP853's share, where heyoka is missing."""
    references = of(rows, "heyoka", REFERENCE) or of(rows, "DOP853", REFERENCE)
    assert [reference.horizon for reference in references] == [QUICK.horizon, SHORT, LONG]
    for reference in references:
        assert 0.0 < reference.mass_error < 1e-9 and 0.0 < reference.event_error < 1e-9
    assert markdown(rows).count(BELOW) >= 4  # every error of exact, which is the reference


def test_without_heyoka_dop853_checks_the_reference(monkeypatch):
    """Its local errors of 1e-13 add up, over some 1e4 steps at most."""
    monkeypatch.setattr(precision.importlib.util, "find_spec", lambda name: None)
    for name in ("damped", "rigid"):
        checked = Comparison(vibro_ros.load_scene(name), 0.05, QUICK).uncertainty
        assert (checked.method, checked.note) == ("DOP853", "")
        assert 0.0 < checked.mass_error < 1e-9


def test_costs_are_ratios_to_the_baseline_of_the_same_run(rows):
    assert of(rows, "baseline")[0].cost == 1.0
    costs = [row.cost for row in of(rows, "rk4")]
    assert costs[2] > 10.0 * costs[0] > 0.0  # a hundredth of the step costs a hundred times as much, less overhead


def test_what_failed_is_said_not_drawn(rows):
    assert of(rows, "exploding")[0].note == "positions not finite" and math.isnan(of(rows, "exploding")[0].body_error)
    assert of(rows, "unable")[0].note == "cannot do it" and math.isnan(of(rows, "unable")[0].cost)


def test_advice_is_what_was_measured_within_the_horizon_of_each_need(rows):
    advised = advice(rows, comparable=15.0)
    assert list(advised) == [*(need.words for need in NEEDS), MEAN_SPEED]
    assert all(text.startswith("exact") for text in advised.values())
    for need in NEEDS:
        for row in cheapest(rows, need).values():
            assert row.compared == NEED and row.horizon == need.horizon and getattr(row, need.column) < need.limit
    assert "rk4" in advised[NEEDS[0].words] and "planted" not in str(advised)
    assert advice(rows, comparable=1.0)[NEEDS[-1].words] == "not possible: chaos"


def within(compared, method, setting, value, body, height=0.0, masses=0.0, cost=1.0):
    return Row("s", compared, method, setting, value, SHORT, 1, wall_time=cost, cost=cost, body_error=body,
               height_error=height, mass_error=masses)


def measured_within(step, error, height=0.0, masses=0.0):
    return within(NEED, "rk4", "step", step, error, height, masses, cost=1e-6 / step)


def test_a_step_that_is_accurate_by_luck_is_not_advised():
    reference = within(REFERENCE, "heyoka", "tolerance", 1e-15, 1e-12)
    need = NEEDS[0]  # 1 mm
    lucky = [reference, *map(measured_within, (1e-3, 1e-4, 1e-5, 1e-6), (1e-4, 1e-2, 1e-4, 1e-5))]
    assert cheapest(lucky, need)["rk4"].value == 1e-5
    assert cheapest([*lucky, measured_within(1e-7, 1.0)], need) == {}
    blurred = within(REFERENCE, "DOP853", "tolerance", 1e-13, 1e-2)
    assert cheapest([blurred, *lucky[1:]], need) == {}


@pytest.mark.parametrize("column", range(3))
def test_every_position_is_that_of_body_height_and_masses(column):
    reference = within(REFERENCE, "heyoka", "tolerance", 1e-15, 1e-12)
    far = [2e-3 if k == column else 1e-5 for k in range(3)]
    rows = [reference, measured_within(1e-4, *far), measured_within(1e-5, 1e-5, 1e-5, 1e-5)]
    assert rows[1].position_error == 2e-3
    assert cheapest(rows, NEEDS[0])["rk4"].value == 1e-5
    assert rows[1].path_error == (1e-5 if column == 2 else 2e-3)
    assert not Row("s", NEED, "rk4", "step", 1e-4, SHORT, 1, body_error=0.0, mass_error=0.0).position_error < 1.0


def test_errors_are_looked_for_off_every_grid():
    """At no whole part of the horizon but its ends; one in each part; the largest gap is below two of them."""
    instants = precision.off_every_grid(0.2, 1000)
    assert (instants[0], instants[-1], len(instants)) == (0.0, 0.2, 1001)
    assert 0.0 < np.diff(instants).min() and np.diff(instants).max() < 2.0 * 0.2 / 1000
    parts = np.mod(instants[1:-1] * 1e5, 1.0)  # in steps of 1e-5 s
    assert np.histogram(parts, 10, (0.0, 1.0))[0].min() > 80
    flat = Comparison(vibro_ros.load_scene("damped"), 0.02, QUICK)
    assert len(flat.instants) > 100 * len(flat.times) and len(flat.reference.samples) == len(flat.instants)


def test_a_standing_scene_is_studied_running():
    """Its masses meet their plates from the start: nothing of it is the rest before a command."""
    study = SceneStudy(vibro_ros.load_scene("device"), QUICK)
    assert study.scene["motor.speed"] == precision.RUNNING_SPEED
    assert len(study.comparison.reference.events) > 5
    slow = vibro_ros.load_scene("device").with_parameters({"motor.max_speed": 20.0})
    assert precision.running(slow)["motor.speed"] == 20.0
    assert precision.running(vibro_ros.load_scene("paper")) == vibro_ros.load_scene("paper")


def ladder(method, slope, constant, compared=NEED, noise=(0.0,)):
    """Rows whose cost rises by 10**slope for each digit."""
    return [within(compared, method, "step", error, error, cost=constant * error**-slope * 10.0**off)
            for error, off in zip((1e-3, 1e-4, 1e-5, 1e-6), 4 * noise, strict=False)]


def test_the_price_of_a_digit_is_the_slope():
    reference = within(REFERENCE, "heyoka", "tolerance", 1e-15, 1e-12)
    both = [reference, *ladder("rk4", 0.5, 1e-3), *ladder("DOP853", 0.1, 3.0), *ladder("LSODA", 0.1, 50.0)]
    price = price_of_a_digit(both, ("rk4",))
    assert (price.factor, price.spread) == (pytest.approx(10**0.5), pytest.approx(0.0, abs=1e-6))
    assert price_of_a_digit(both, ("DOP853", "LSODA")).factor == pytest.approx(10**0.1)  # a slope, two lines
    assert price_of_a_digit(both, ("heyoka",)) is None
    useless = [within(NEED, "rk4", "step", 1.0, 0.5, cost=1e-9), within(NEED, "rk4", "step", 1e-9, 1e-12, cost=1e9)]
    assert price_of_a_digit([*both, *useless], ("rk4",)) == price  # neither lost from the start nor at rounding
    noisy = price_of_a_digit([reference, *ladder("rk4", 0.5, 1e-3, noise=(0.1, -0.1))], ("rk4",))
    assert abs(noisy.slope - 0.5) < noisy.spread < 1.0
    several = price_over_scenes({"a": both, "b": [reference, *ladder("rk4", 0.7, 1e-3)]}, ("rk4",))
    assert several.slope == pytest.approx(0.6)
    assert several.spread == pytest.approx(12.706 * 0.1, rel=1e-4)  # Student's, of two
    assert several.scenes == 2 and "from 2 scenes" in str(several)


def test_the_report_begins_with_the_price_of_a_digit(rows):
    told = prices_in_words({"damped": rows})
    assert told[0].startswith("One more digit of every position by `exact` costs nothing: it is accurate to rounding")
    assert any(text.startswith("One more digit of every position by `rk4` costs ") for text in told)
    off = next(row for row in rows if row.method == "baseline" and row.compared == NEED).position_error
    assert 1e-6 < off < 1e-2
    assert f"which is itself off by {off:.1e} m within 0.2 s" in baseline_in_words({"damped": rows})
    study = accuracy.Accuracy({}, QUICK)
    study.rows, study.growths = {"damped": rows}, {"damped": Growth(0.0, 0.1, False, 15.0)}
    head = accuracy_report.document(study, "").partition("Measured on")[0]
    assert [line for line in head.splitlines() if line.startswith("- ")] == [f"- {text}" for text in told]


def test_the_head_of_a_users_report_has_the_findings(rows, tmp_path):
    study = accuracy.Accuracy({}, QUICK)
    study.rows, study.growths = {"damped": rows}, {"damped": Growth(0.0, 0.1, False, 15.0)}
    text = study.write_text_and_diagrams(tmp_path, False)[0].read_text(encoding="utf-8")
    head = text.partition("Measured on")[0]
    assert [line[2:] for line in head.splitlines() if line.startswith("- ")] == study.findings("damped")
    assert "- Every position to 1 mm for 0.2 s: exact (" in head and "itself off by" in text


def answer(times, contacts):
    events = np.array([(time, "upper_contact") for time in contacts], dtype=METHODS["exact"](
        vibro_ros.load_scene("damped"), np.array([0.0, 1e-3]), 1e-9).events.dtype)
    return Answer(times, np.zeros((len(times), 8)), events, 1, 1, 1.0)


def test_a_contact_too_many_or_too_few_is_an_error():
    times, full = np.array([0.0, 1.0]), [0.1, 0.2, 0.5]
    assert errors(answer(times, full), answer(times, full)).events == 0.0
    assert errors(answer(times, [0.1, 0.2]), answer(times, full)).events == pytest.approx(0.3)
    assert errors(answer(times, [*full, 0.6]), answer(times, full)).events == pytest.approx(0.1)
    assert math.isnan(errors(answer(times, []), answer(times, full)).events)


def test_chaos_is_seen_where_it_is_and_nowhere_else():
    """The paper's exponent is 5 1/s; the interval of so few starts is wide."""
    chaotic, regular = (growth(vibro_ros.load_scene(name), 8.0) for name in ("paper", "damped"))
    assert 2.0 < chaotic.rate < 10.0 and chaotic.chaotic
    assert chaotic.horizon < 2.5 and "chaotic" in str(chaotic)
    assert not regular.chaotic and regular.horizon == 1.0


def speeds(*values):
    exact = Row("s", AVERAGE, "exact", "tolerance", 1e-9, 20.0, 16, mean_speed=-0.1, mean_speed_spread=0.001)
    return [exact, *(Row("s", AVERAGE, "rk4", "step", step, 20.0, 16, mean_speed=speed, mean_speed_spread=0.001,
                           starts_forwards=16 if speed > 0.0 else 0)
                     for step, speed in zip((1e-3, 1e-4, 1e-5), values, strict=True))]


def test_the_finding_names_the_coarsest_step_from_which_all_are_right():
    text = finding(speeds(0.05, -0.2, -0.101))
    assert "from dt = 1e-05 s down" in text and "0.001 s: 50.00 ± 1 mm/s, -150%, WRONG SIGN (16 of 16" in text
    assert "WRONG" not in text.partition("0.0001 s")[2]
    assert "at no step tried" in finding(speeds(-0.1, -0.1, -0.2))  # right by accident
    assert "allows for 6%" in finding(speeds(0.05, -0.2, -0.1045))
    table = speeds_table(speeds(0.05, -0.2, -0.101))
    assert "| +50.0 ± 1.0 (!) | -200.0 ± 1.0 | **-101.0 ± 1.0** |" in table


def test_what_diverges_has_no_mean_speed(monkeypatch):
    """No robot is faster than sound; 1e6 m/s is a finite number all the same."""
    monkeypatch.setattr(precision, "speed_over_starts", lambda *_: Average(1e6, 1e5, 2))
    study = SceneStudy(vibro_ros.load_scene("damped"), QUICK)
    found = [row for row in study.rows({"rk4": ComparedMethod(unable, "step", (1e-4,))}) if row.compared == AVERAGE]
    assert found and all(math.isnan(row.mean_speed) and "diverged" in row.note for row in found)


def test_the_report_tells_every_scene_and_links_what_is_there(rows, tmp_path):
    study = accuracy.Accuracy({}, QUICK)
    study.rows = {"damped": rows, "paper": [*rows, *speeds(0.05, -0.2, -0.101)]}
    study.growths = {"damped": Growth(0.0, 0.1, False, 15.0), "paper": Growth(5.0, 0.1, True, 15.0)}
    text = accuracy_report.document(study, "| the node |")
    assert "make accuracy" in text.splitlines()[0]
    assert "`paper` are chaotic" in text or "`paper` is chaotic" in text
    assert "| `damped` | no chaos | exact" in text and "| `paper` | 0.2 s | exact" in text
    assert text.count("not possible: chaos") == 1
    assert "WRONG SIGN" in text.partition("## Which method")[0] and "| the node |" in text
    for name, picture in study.draw(tmp_path).items():
        assert picture.stat().st_size > 10_000 and f"accuracy/{name}.png" in text


def test_an_interrupted_run_keeps_its_rows(monkeypatch, tmp_path, capsys):
    rk4 = METHODS["rk4"].run

    def interrupted(scene, times, step):
        if step < 5e-4 and len(times) > 2:
            raise KeyboardInterrupt
        return rk4(scene, times, step)

    monkeypatch.setitem(accuracy.STUDIED, "rk4", ComparedMethod(interrupted, "step", (1e-3, 1e-4)))
    options = ["--scene", "damped", "--methods", "rk4", "exact", "--horizon", "0.05", "--repeats", "1"]
    assert accuracy.main([*options, "--output", str(tmp_path)]) == 130
    with (tmp_path / "accuracy.csv").open(encoding="utf-8") as file:
        kept = list(csv.DictReader(file))
    assert list(kept[0]) == [field.name for field in fields(Row)]
    assert [row["method"] for row in kept][1:] == ["exact", "rk4"]
    assert float(kept[-1]["body_error"]) > 0.0
    assert "Interrupted: only a part" in (tmp_path / "accuracy.md").read_text(encoding="utf-8")
    assert (tmp_path / "damped.png").stat().st_size > 10_000
    assert "what was measured is kept" in capsys.readouterr().err


def test_a_scene_that_cannot_be_simulated_does_not_end_the_others(monkeypatch, tmp_path, capsys):
    def study(scene, effort):
        if scene.name == "paper":
            raise UnableError("at 0.1 s: events follow each other")
        return SceneStudy(scene, effort)

    monkeypatch.setattr(accuracy, "SceneStudy", study)
    monkeypatch.setattr(accuracy, "shipped_scenes", lambda: ("paper", "damped"))
    options = ["--all", "--methods", "exact", "--horizon", "0.05", "--repeats", "1", "--starts", "2"]
    assert accuracy.main([*options, "--output", str(tmp_path)]) == 1
    assert "paper: exact cannot simulate it: at 0.1 s" in capsys.readouterr().err
    assert "## damped" in (tmp_path / "accuracy.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("options", "reason"), [
    (["--scene", "nowhere"], "nowhere: neither a shipped scene nor a file"),
    (["--scene", "paper", "--methods", "magic"], "magic: no such method; methods are exact, rk4"),
    (["--scene", "paper", "--methods", ""], "'': no such method; methods are exact, rk4"),
    (["--scene", "paper", "--methods"], "--methods: none named; methods are exact, rk4"),
    (["--scene", "paper", "--horizon", "-1"], "--horizon -1: must be from 0.001"),
    (["--scene", "paper", "--horizon", "nan"], "--horizon nan: must be from 0.001"),
    (["--scene", "paper", "--repeats", "0"], "--repeats 0: must be at least 1"),
    (["--scene", "paper", "--starts", "1"], "--starts 1: must be at least 2"),
])
def test_bad_input_is_refused_before_anything_is_written(options, reason, tmp_path, capsys):
    assert accuracy.main([*options, "--output", str(tmp_path / "new")]) == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("options", [["--methods", "heyoka"], ["--methods", "exact", "heyoka"]])
def test_heyoka_that_is_asked_for_and_missing_is_refused(options, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(accuracy.importlib.util, "find_spec", lambda name: None)
    assert accuracy.main(["--scene", "paper", *options, "--output", str(tmp_path / "new")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "heyoka: not installed; `pip install heyoka` with Python 3.11 or later" in said
    assert not (tmp_path / "new").exists()
    assert "heyoka" in accuracy.chosen_methods(None)  # who asks for all gets a row that says so


def test_what_failed_does_not_say_that_nothing_touches():
    failed = [Row("s", NEED, "heyoka", "tolerance", 1e-9, SHORT, 0, note="not installed")]
    assert set(advice(failed, 15.0).values()) == {"nothing that was measured", "not measured"}


def test_starts_are_independent_and_repeatable():
    scene = vibro_ros.load_scene("damped")
    first, again, others = (speeds_of_starts(scene, 0.2, 6, batch) for batch in (0, 0, 1))
    assert np.array_equal(first, again) and not np.intersect1d(first, others).size
    assert len(np.unique(first)) == 6
    device = started(scene, np.random.default_rng(3))
    device.advance_to(3.0)
    assert device.state.motor_speed == scene["motor.speed"]
    assert device.state.upper_plate_position == pytest.approx(scene["crank.upper_rod"] + scene["upper.gap"], abs=1e-12)


def test_intervals_hold_as_often_as_they_say():
    """95 % of 400, within 4 standard deviations; and an interval that is too narrow is seen."""
    draw = np.random.default_rng(5).normal(-0.1, 0.03, (400, 16))
    found = covered(draw.ravel(), 16)
    assert found.batches == 400 and abs(found.holding - 380) < 4.0 * (400 * 0.95 * 0.05) ** 0.5
    assert found.overlapping > 390
    drifting = draw + np.linspace(-0.1, 0.1, 400)[:, None]
    assert covered(drifting.ravel(), 16).holding < 100


def test_intervals_of_a_chaotic_scene_hold():
    """Eight batches of exact's 16 starts: by chance one or two miss, hardly ever three."""
    values = speeds_of_starts(vibro_ros.load_scene("paper"), 2.0, 8 * 16, batch=7)
    found = covered(values, 16)
    assert found.holding >= 6 and found.overlapping >= 7
    assert average(values).spread < 0.01


def test_the_executable_ends_its_workers_without_a_word(tmp_path):
    """They are forked from a process that has the front door's signal handlers."""
    options = ["--scene", "damped", "--methods", "exact", "--horizon", "0.05", "--repeats", "1", "--starts", "2"]
    done = subprocess.run([sys.executable, "-m", "vibro_ros.accuracy.accuracy", *options, "--output", str(tmp_path)],
                          capture_output=True, text=True, timeout=250)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr and "KeyboardInterrupt" not in done.stderr
    assert "Findings in the scene `damped`" in (tmp_path / "accuracy.md").read_text(encoding="utf-8")
