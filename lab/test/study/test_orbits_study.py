"""`study orbits`: its branches are those of Python, and are read as they were written; `test_table.py` has the rest."""

import numpy as np
import pandas
import pytest

import vibro_lab
import vibro_ros
from vibro_lab.orbits.branch import Branch, Special
from vibro_lab.study.orbits import (
    branch_in,
    fields_of,
    main,
    plan_of,
    rows_of,
)
from vibro_lab.study.table import table_of

SHORT = ["--scene", "damped", "--vary", "motor.speed=99.5:101", "--from", "100", "--starts", "1", "--turns", "2"]


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """The folder of a short study."""
    folder = tmp_path_factory.mktemp("orbits")
    assert main([*SHORT, "--workers", "1", "--output", str(folder)]) == 0
    return folder


def test_branches_are_those_that_python_follows(short):
    """Both begin at the same orbit to rounding, which decides where the orbits between the branch's ends lie."""
    table = pandas.read_parquet(short / "branches.parquet")
    scene = vibro_ros.load_scene("damped")
    orbit = vibro_lab.find_orbit(scene)
    for number, upwards in enumerate((True, False)):
        rows = table[table["branch"] == number]
        branch = vibro_lab.follow_orbit(orbit, "motor.speed", 99.5, 101.0, upwards)
        assert rows["stable"].all() and branch.stable.all()
        assert rows["end"].iloc[-1] == branch.end and rows["end"].iloc[:-1].isna().all()
        for row in (rows.iloc[0], rows.iloc[len(rows) // 2], rows.iloc[-1]):
            same = vibro_lab.find_orbit(scene.with_parameters({"motor.speed": row["motor.speed"]}))
            assert row["mean_speed"] == pytest.approx(same.mean_speed, abs=1e-9)
            magnitudes = np.sort(np.abs(same.multipliers.real))
            assert np.sort(np.abs(row["multipliers_real"])) == pytest.approx(magnitudes, abs=1e-5)
        assert rows["mean_speed"].iloc[-1] == pytest.approx(branch.mean_speeds[-1], abs=1e-9)
    assert table["motor.speed"].min() == 99.5 and table["motor.speed"].max() == 101.0


@pytest.mark.parametrize(("words", "message"), [
    ([], "--vary: is missing; give NAME=LOW:HIGH"),
    (["--vary", "motor.speed=100"], "--vary motor.speed=100: is no range"),
    (["--vary", "motor.speed=0:100", "--from", "0"], "motor.speed: 0 rad/s turns no crank; give the speed"),
    (["--vary", "motor.speed=60:130", "--from", "140"], "--from 140: is not from 60 to 130; give a value of the"),
    (["--vary", "motor.speed=60:130", "--from", "fast"], "motor.speed: 'fast' is not a number"),
    (["--vary", "motor.speed=60:130", "--turns", "33"], "--turns: 33 is out of range; give a whole number from"),
    (["--vary", "motor.speed=60:130", "--set", "solver.method=rk4"], "solver.method: 'rk4' is not exact to rounding"),
])
def test_bad_input_is_refused_in_one_line(refusal, words, message):
    assert message in refusal(main, *words)


def test_a_branch_is_read_as_it_was_written():
    """Special points are stored between the orbits that they lie between."""
    plan = plan_of(main.parser().parse_args(["--quick", "--scene", "damped"]))
    random = np.random.default_rng(7)
    names = ("upper_position", "upper_velocity", "inclined_position", "inclined_velocity", "body_velocity")
    multipliers = random.normal(size=(4, 5)) + 1j * random.normal(size=(4, 5))
    special = tuple(Special(kind, 0.1 * at, multipliers[0], change, 0.5, random.normal(size=5), at,
                            100.0 + at, 1e-9)
                    for kind, change, at in (("fold", "", 0), ("grazing", "landing appears", 2), ("fold", "", 2),
                                             ("corner", "stick vanishes", 4)))
    branch = Branch(plan.scene, "motor.speed", 2, random.normal(size=4), random.normal(size=4), multipliers,
                    random.normal(size=4), random.normal(size=(4, 5)),
                    {name: random.normal(size=(4, 2)) for name in names}, special, "an end")
    table = table_of(rows_of(branch), fields_of(plan))
    read = branch_in(table, plan.scene, branch.name)
    assert read.end == "an end" and read.turns == 2
    for key in ("values", "mean_speeds", "multipliers", "phases", "states"):
        np.testing.assert_array_equal(getattr(read, key), getattr(branch, key))
    for name in names:
        np.testing.assert_array_equal(read.strobe[name], branch.strobe[name])
    assert [(point.kind, point.value, point.change, point.at) for point in read.special_points] == [
        (point.kind, point.value, point.change, point.at) for point in special]
