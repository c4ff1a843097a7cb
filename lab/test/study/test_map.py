"""A map: motions that are known from elsewhere, where they coexist and end, resumed to the same bytes."""

import pickle
from functools import partial

import numpy as np
import pandas
import pytest

import vibro_lab
import vibro_ros
from vibro_lab.study.execution import Execution
from vibro_lab.study.map import (
    GAP,
    SPEED,
    UNSETTLED,
    GridAxis,
    Line,
    MapDesign,
    VisitedCell,
    main,
    motions,
    rows_of_line,
    shares,
    visits,
)
from vibro_lab.study.measures import measure

SIDES = ("upper", "inclined")
FOLD, BACK = 107.959911, 104.85265
"""Motor speeds [rad/s] between which `damped` has two motions, by continuation (see test/orbits)."""
#: Eleven motor speeds around these, and two gaps of which one is almost 0.
FOLDED = ["--scene", "damped", "--motor-speed", "100:110:11", "--gap=-1e-6:0:2", "--quick"]
TINY = ["--motor-speed", "110:120:3", "--gap", "0.003:0.005:3", "--workers", "1", "--quick"]


def visit(i=0, j=0, turns=1, landings=1, speed=-0.05, at=0.0):
    """A visit that has found a motion with a state `at` so many crank radii, or around it without a period."""
    states = at + np.random.default_rng(0).uniform(-1.0, 1.0, (max(turns, 0) or 32, 1)) * (not turns)
    return VisitedCell(i, j, turns, landings, speed, 10.0, 0.1, 0.5, states)


@pytest.fixture(scope="module")
def folded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("folded")
    assert main([*FOLDED, "--output", str(folder)]) == 0
    return folder


def test_two_motions_exist_exactly_between_the_folds(folded):
    """105 rad/s is left out: so close to the fold a step of 1 rad/s leaves the motion."""
    table = pandas.read_parquet(folded / "motions.parquet")
    assert sorted(set(table.gap)) == [-1e-6, 0.0]
    for speed in np.linspace(100.0, 110.0, 11).tolist():
        several = 2 if BACK < speed < FOLD else 1
        for gap in (-1e-6, 0.0):
            assert np.sum((table.motor_speed == speed) & (table.gap == gap)) == several or speed == 105.0, speed


def test_only_cells_with_several_motions_have_shares(folded):
    table = pandas.read_parquet(folded / "motions.parquet")
    size = table.groupby(["motor_speed", "gap"]).turns.transform("size")
    assert table.share_of_starts[size == 1].isna().all() and (size == 1).any()
    assert (table[size == 2].groupby(["motor_speed", "gap"]).share_of_starts.sum() == 1.0).all() and (size == 2).any()


def test_the_shares_are_those_of_the_same_starts_by_another_road():
    """`device` at 100 rad/s and 2 mm, where both motions have starts; `attractors` cuts at another crank angle."""
    design = MapDesign(vibro_ros.load_scene("device"), SIDES, GridAxis(90.0, 110.0, 11), GridAxis(0.002, 0.0025, 2))
    found_by_sweeps = motions(visit for line in design.lines() for visit in visits(design, line))
    of_cell = [visit for visit in found_by_sweeps if (visit.speed_index, visit.gap_index) == (5, 0)]
    attractors = sorted(vibro_lab.attractors(design.scene_at(5, 0), design.settings.histories),
                 key=lambda attractor: attractor.mean_speed)
    assert [round(1e3 * attractor.mean_speed, 1) for attractor in attractors] == [-113.6, -84.6]
    assert [visit.mean_speed for visit in of_cell] == pytest.approx(
        [attractor.mean_speed for attractor in attractors], rel=1e-4)
    assert shares(design, of_cell, Execution(1)).tolist() == [0.25, 0.75]
    assert [attractor.share for attractor in attractors] == [0.25, 0.75]


def test_a_motion_is_measured_as_studies_measure_it():
    """At 116 rad/s and 4 mm the device has one motion, of period 2."""
    scene = vibro_ros.load_scene("device")
    design = MapDesign(scene, SIDES, GridAxis(114.0, 116.0, 2), GridAxis(0.004, 0.005, 2))
    *_, visited = visits(design, Line(SPEED, 0, True))
    measured = measure(design.scene_at(1, 0), ("mean_speed", "cost_of_transport", "stick_share", "air_share", "period"),
                  20.0, 5.0)
    assert visited.turns == measured.pop("period") == 2
    for name, value in measured.items():
        assert getattr(visited, name) == pytest.approx(value, rel=1e-5, abs=1e-6), name


def test_a_sweep_goes_on_from_cell_to_cell():
    """At 110 rad/s and -2 to 8 mm a gap's sweep visits each cell once, in its order, either way."""
    design = MapDesign(vibro_ros.load_scene("device"), SIDES, GridAxis(110.0, 120.0, 2), GridAxis(0.003, 0.004, 3))
    up, down = (visits(design, Line(GAP, 0, upwards)) for upwards in (True, False))
    assert [(cell.speed_index, cell.gap_index) for cell in up] == [(0, 0), (0, 1), (0, 2)]
    assert [cell.gap_index for cell in down] == [2, 1, 0]
    for cell, other in zip(up, reversed(down), strict=True):  # one motion, whichever way
        assert cell.mean_speed == pytest.approx(other.mean_speed, abs=1e-6)


def test_other_machines_get_the_work_as_it_is():
    design = MapDesign(vibro_ros.load_scene("device"), SIDES, GridAxis(110.0, 120.0, 2), GridAxis(0.003, 0.004, 2))
    work = pickle.loads(pickle.dumps(partial(rows_of_line, design)))
    rows = work(3)
    assert [row["mean_speed"] for row in rows] == [cell.mean_speed for cell in visits(design, design.lines()[3])]


def test_a_cell_has_each_motion_once():
    """Told apart by period and states, not by the mean speed: two motions may have one."""
    distinct = motions([visit(), visit(at=1e-7), visit(at=0.1), visit(turns=2), visit(turns=0),
                        visit(turns=0, at=0.1), visit(turns=0, at=5.0), visit(turns=UNSETTLED)])
    assert [(motion.turns, round(float(motion.states.mean()))) for motion in distinct] == [
        (1, 0), (1, 0), (2, 0), (0, 0), (0, 5)]


@pytest.mark.parametrize("words, reason", [
    (["--motor-speed", "0:100:3"], "--motor-speed: from 0 rad/s; a crank that stands has no motion"),
    (["--motor-speed", "100"], "--motor-speed: 100 has 1 parts; give LOW:HIGH:COUNT"),
    (["--motor-speed", "50:100"], "--motor-speed 50:100: give LOW:HIGH:COUNT"),
    (["--motor-speed", "1:200:1000", "--gap", "0:0.001:1000"], "--motor-speed, --gap: 1000 x 1000 cells; give at most"),
    (["--scene", "no_impact"], "--gaps both: no_impact has no upper plate"),
    (["--set", "solver.method=rk4"], "solver.method: rk4 has no map"),
    (["--scene", "machine", "--set", "motor.control=voltage"], "motor.control: voltage commands no motor speed"),
])
def test_bad_input_is_one_line(refusal, words, reason):
    assert refusal(main, *words).startswith(f"study: {reason}")
