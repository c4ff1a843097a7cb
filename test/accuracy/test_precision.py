"""What a study measures: a wrong method looks wrong, the reference is checked, chaos and divergence are seen."""

import math

import numpy as np
from quick_study import QUICK, unable

import vibro_ros
from vibro_ros.accuracy import precision
from vibro_ros.accuracy.findings import BELOW, markdown
from vibro_ros.accuracy.measurement import AVERAGE, REFERENCE, TRAJECTORY
from vibro_ros.accuracy.methods import ComparedMethod
from vibro_ros.accuracy.precision import LONG, SHORT, Comparison, Effort, SceneStudy, growth


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


def test_in_an_installation_dop853_checks_the_reference():
    """Its local errors of 1e-13 add up, over some 1e4 steps at most."""
    for name in ("damped", "rigid"):
        checked = Comparison(vibro_ros.load_scene(name), 0.05, Effort()).uncertainty
        assert (checked.method, checked.note) == ("DOP853", "")
        assert 0.0 < checked.mass_error < 1e-9


def test_costs_are_ratios_to_the_baseline_of_the_same_run(rows):
    assert of(rows, "baseline")[0].cost == 1.0
    costs = [row.cost for row in of(rows, "rk4")]
    assert costs[2] > 10.0 * costs[0] > 0.0  # a hundredth of the step costs a hundred times as much, less overhead


def test_what_failed_is_said_not_drawn(rows):
    assert of(rows, "exploding")[0].note == "positions not finite" and math.isnan(of(rows, "exploding")[0].body_error)
    assert of(rows, "unable")[0].note == "cannot do it" and math.isnan(of(rows, "unable")[0].cost)


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


def test_chaos_is_seen_where_it_is_and_nowhere_else():
    """The paper's exponent is 5 1/s; the interval of so few starts is wide."""
    chaotic, regular = (growth(vibro_ros.load_scene(name), 8.0) for name in ("paper", "damped"))
    assert 2.0 < chaotic.rate < 10.0 and chaotic.chaotic
    assert chaotic.horizon < 2.5 and "chaotic" in str(chaotic)
    assert not regular.chaotic and regular.horizon == 1.0


def test_what_diverges_has_no_mean_speed(monkeypatch):
    """No robot is faster than sound; 1e6 m/s is a finite number all the same."""
    monkeypatch.setattr(precision, "speeds_of_starts", lambda *_: np.array([1.1e6, 0.9e6]))
    study = SceneStudy(vibro_ros.load_scene("damped"), QUICK)
    found = [row for row in study.rows({"rk4": ComparedMethod(unable, "step", (1e-4,))}) if row.compared == AVERAGE]
    assert found and all(math.isnan(row.mean_speed) and "diverged" in row.note for row in found)
