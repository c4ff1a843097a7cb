"""The harness of a comparison: a wrong program shows errors, the reference is checked, chaos and divergence are
detected.
"""

import math
import re
import time
from dataclasses import replace

import numpy as np
import pytest

import vibro_ros
from benchmark.report import speeds_table
from vibro_lab.accuracy import harness, scene_rows
from vibro_lab.accuracy.harness import (
    AVERAGE,
    CANNOT,
    DIVERGES,
    REFERENCE,
    TRAJECTORY,
    Effort,
    SceneProblem,
    read_rows,
    row_writer,
)
from vibro_lab.accuracy.programs import COLUMNS, DEVICE, Answer, Program, UnableError, by_device, steps
from vibro_lab.accuracy.report import advice, finding
from vibro_lab.accuracy.scene_rows import LONG, SHORT, LyapunovTime, averages, lyapunov_time
from vibro_lab.orbits import starts
from vibro_lab.orbits.starts import running

TIMES = np.linspace(0.0, 0.1, 101)


def rows_of_program(rows, program, compared=TRAJECTORY):
    return [row for row in rows if row.program == program and row.compared == compared]


def test_a_wrong_program_looks_wrong(rows):
    """Steps shorter by a factor of ten reduce the error of a right program by at least a factor of 3 a decade, and that
    of a wrong program not at all.
    """
    right, wrong = ([row.mass_error for row in rows_of_program(rows, name)] for name in ("rk4", "planted"))
    assert right[-1] < right[0] / 9.0
    assert wrong[-1] > 0.3 * wrong[-2] and wrong[-1] > 10.0 * right[-1]
    assert rows_of_program(rows, "planted")[-1].body_error > 10.0 * rows_of_program(rows, "rk4")[-1].body_error


def test_the_reference_is_checked_by_another_integrator(rows):
    """Runge-Kutta with steps of 1e-6 s that end at events: its rounding, over up to 1e7 steps, stays below 1e-9 m."""
    references = rows_of_program(rows, "rk4_located", REFERENCE)
    assert [reference.horizon for reference in references] == [0.1, SHORT, LONG]
    for reference in references:
        assert 0.0 < reference.mass_error < 1e-9 and 0.0 < reference.event_error < 1e-9
    [exact] = rows_of_program(rows, "exact")  # which is the reference
    assert exact.body_error <= references[0].body_error and exact.event_error <= references[0].event_error


def test_a_cost_is_for_each_simulated_second_and_set_up_is_apart():
    """A program that waits 20 ms before its first step and 0.1 s for each simulated second: runs over 0.1 s and 0.4 s
    have the same cost and the same set-up. A waiting program cannot be early, and other load makes it late by less
    than half.
    """
    def prepare(problem, setting):
        def run():
            time.sleep(0.02 + 0.1 * float(problem.times[-1]))
            return Answer(np.zeros((len(problem.times), 8)), None)
        return run

    program = Program("waiting", steps(1e-3), prepare)
    for horizon in (0.1, 0.4):
        problem = SceneProblem.within(vibro_ros.load_scene("damped"), horizon)
        row = harness.measure_setting(problem, program, program.settings[0], Effort(repeats=3))
        assert row.horizon == horizon
        assert 0.05 < row.cost < 0.15 and 0.015 < row.set_up < 0.03
        assert row.wall_time == pytest.approx(0.02 + 0.1 * horizon, rel=0.5)


def test_what_failed_is_said_not_drawn(rows):
    exploded, unable = rows_of_program(rows, "exploding")[0], rows_of_program(rows, "unable")[0]
    assert (exploded.outcome, exploded.note) == (DIVERGES, "positions not finite") and math.isnan(exploded.body_error)
    assert (unable.outcome, unable.note) == (CANNOT, "cannot do it") and math.isnan(unable.cost)


def test_rows_come_back_from_their_file(rows, tmp_path):
    with row_writer(tmp_path / "rows.csv") as write:
        for row in rows:
            write(row)
    for row, read in zip(rows, read_rows(tmp_path / "rows.csv"), strict=True):
        assert (row.program, row.setting, row.outcome, row.note) == (
            read.program, read.setting, read.outcome, read.note)
        assert read.cost == pytest.approx(row.cost, rel=1e-9, nan_ok=True)


def test_errors_are_looked_for_off_every_grid():
    """No instant but the two ends is a whole part of the horizon; each part has one instant; the largest gap is below
    two parts.
    """
    instants = harness.off_every_grid(0.2, 1000)
    assert (instants[0], instants[-1], len(instants)) == (0.0, 0.2, 1001)
    assert 0.0 < np.diff(instants).min() and np.diff(instants).max() < 2.0 * 0.2 / 1000
    parts = np.mod(instants[1:-1] * 1e5, 1.0)  # in steps of 1e-5 s
    assert np.histogram(parts, 10, (0.0, 1.0))[0].min() > 80
    problem, exact = SceneProblem.within(vibro_ros.load_scene("damped"), 0.02), DEVICE["exact"]
    assert len(problem.instants(exact, exact.settings[0])) > 100 * len(problem.times)


def test_a_standing_scene_is_studied_running():
    """Its masses meet their plates from the start, so no time of the run is rest before a command."""
    scene = running(vibro_ros.load_scene("device"))
    assert scene["motor.speed"] == starts.RUNNING_SPEED
    assert len(by_device("exact", scene, TIMES, 1e-12).events) > 5
    slow = vibro_ros.load_scene("device").with_parameters({"motor.max_speed": 20.0})
    assert running(slow)["motor.speed"] == 20.0
    assert running(vibro_ros.load_scene("paper")) == vibro_ros.load_scene("paper")


def test_chaos_is_seen_where_it_is_and_nowhere_else():
    """The paper's exponent is 5 1/s; the interval of so few starts is wide."""
    chaotic, regular = (lyapunov_time(vibro_ros.load_scene(name), 8.0) for name in ("paper", "damped"))
    assert 2.0 < chaotic.rate < 10.0 and chaotic.chaotic
    assert chaotic.comparable < 2.5 and "chaotic" in str(chaotic)
    assert not regular.chaotic and regular.comparable == 8.0
    assert str(scene_rows.lyapunov_time_in([chaotic.row("paper")])) == str(chaotic)


def test_what_diverges_has_no_mean_speed(monkeypatch):
    """A mean speed above that of sound, such as the finite 1e6 m/s, counts as divergence."""
    monkeypatch.setattr(scene_rows, "_settled", fast)
    rows = list(scene_rows.averages_of_scene(vibro_ros.load_scene("damped"), Effort(patience_for_averages=0.0)))
    assert rows and all(row.compared == AVERAGE and math.isnan(row.mean) and "diverged" in row.note for row in rows)


def fast(_, __, number):
    """Return a start whose body is faster than sound."""
    return 1e6 + number, None, 0.0


def test_what_a_method_cannot_do_it_says():
    with pytest.raises(UnableError, match="rk4 may need a solver.step below 0.01 s"):
        by_device("rk4", vibro_ros.load_scene("damped"), np.linspace(0.0, 20.0, 11), 1e-2)


def test_columns_are_fields_of_a_run():
    run, answer = (vibro_ros.simulate(vibro_ros.load_scene("paper"), times=TIMES),
                   by_device("exact", vibro_ros.load_scene("paper"), TIMES, 1e-9))
    for k, column in enumerate(COLUMNS):
        np.testing.assert_array_equal(answer.samples[:, k], getattr(run, column))


def test_a_long_run_of_device_is_one_of_its_usual_motion():
    """Turning from the start, `device` goes -76.4 mm/s, which few drawn starts do; by a command, -73.6 as most do."""
    positions = []
    for scene in (vibro_ros.load_scene("device"), running(vibro_ros.load_scene("device"))):
        turns = 2.0 * np.pi / 100.0 * np.array([0, 150, 190])
        positions.append(by_device("exact", scene, turns, 1e-9).samples[:, COLUMNS.index("body_position")])
    speeds = [1e3 * (late - early) / (0.8 * np.pi) for _, early, late in positions]
    assert speeds == pytest.approx([-73.6, -76.4], abs=0.3)


def test_the_mean_of_a_transient_says_that_it_drifts():
    """On a slope that friction cannot hold, starts of `damped` get faster for ever; on level ground they settle."""
    steep = vibro_ros.load_scene("damped").with_parameters({"motor.speed": 100.0, "ground.slope": 1.0})
    [row] = averages(steep, "exact", math.nan, Effort(starts=1, duration=10.0))
    assert re.fullmatch(r"drifts by -\d\.?\d*e\+04 mm/s", row.note)
    rows = [LyapunovTime(0.0, 0.0, False, 15.0).row("damped"), row, replace(row, program="rk4", value=1e-4)]
    assert f" mm/s, {row.note}" in speeds_table(rows)
    damped = vibro_ros.load_scene("damped").with_parameters({"motor.speed": 100.0})
    assert [row.note for row in averages(damped, "exact", math.nan, Effort(starts=1, duration=10.0))] == [""]


def test_several_motions_have_a_row_each_and_no_mean():
    """`device` at 160 rad/s: no robot runs at the mean of -79.8 and -53.6 mm/s."""
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 160.0})
    averaged = averages(scene, "exact", math.nan, Effort(starts=2, duration=6.0))
    assert [1e3 * row.mean for row in averaged] == pytest.approx([-79.8, -53.6], abs=0.2)
    assert [(row.motions, row.starts_forwards) for row in averaged] == [(2, 0)] * 2
    assert sum(row.repeats for row in averaged) == 8
    rows = [LyapunovTime(0.0, 0.0, False, 15.0).row("device"), *averaged,
            replace(averaged[0], program="rk4", value=1e-4), replace(averaged[1], program="rk4", value=1e-4)]
    assert finding(rows).startswith("There are several mean speeds (-79.8") and " of 8 starts; -53.6" in finding(rows)
    assert "8 drawn starts of 6 s after 4 s: -79.8" in speeds_table(rows) and "; -53.6 (" in speeds_table(rows)
    assert "not one: 2 motions" in advice(rows).values()
