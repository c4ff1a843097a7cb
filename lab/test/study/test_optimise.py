"""The optimum is verified and written by what it really is."""

import contextlib
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vibro_lab.study import optimise as command
from vibro_lab.study.execution import Execution
from vibro_lab.study.space import VARIABLES, Space
from vibro_lab.study.trials import (
    MEASURED,
    VERIFYING,
    Reading,
    Trials,
    readings,
    values_of,
    values_of_many,
    verified,
    went_on,
)
from vibro_ros.configuration.scene_file import load_scene

SCENE = command.sought(load_scene("device"))
SPACE = Space(SCENE)
SHORT = Trials(starts=3, settling=1.5, duration=1.0)


class Counting:
    """Counts what it is told."""

    count = 0

    def add(self, count):
        """Add `count`."""
        self.count += count


def of_scene(space=SPACE):
    """Return the scene's own values of the varied parameters."""
    return {variable.name: space.scene[variable.name] for variable in space.variables}


def test_values_do_not_depend_on_workers():
    robots = [SPACE.robot(point) for point in np.random.default_rng(0).random((4, 17))]
    one, two = (list(values_of_many(robots, SHORT, Execution(workers))) for workers in (1, 2))
    np.testing.assert_array_equal(one, two)
    assert one[0].shape == (3, len(MEASURED))


def test_two_motions_of_an_optimum_are_two_rows_without_a_mean():
    """`device` at 160 rad/s: no robot runs at the mean of -79.8 and -53.6 mm/s."""
    space, progress = Space(SCENE.with_parameters({"motor.speed": 160.0}), VARIABLES[:1]), Counting()
    trials = Trials(starts=8, settling=4.0, duration=6.0)
    rows = verified(space, of_scene(space), Reading(), trials, Execution(1), progress)
    own = [row for row in rows if row.reading == "as sought (`device`)"]
    assert [row.turns for row in own] == [3, 3]
    assert [1e3 * row.speed.mean for row in own] == pytest.approx([-79.8, -53.6], abs=0.2)
    assert sum(row.starts for row in own) == 8 and own[0].share == own[0].starts / 8
    fresh = values_of(space.scene, Trials(8, 4.0, 6.0, VERIFYING))
    fast = fresh[fresh[:, 0] < -0.07]
    assert own[0].starts == len(fast) and own[0].power.mean == pytest.approx(fast[:, 1].mean())
    weight = space.scene.total_mass * space.scene["gravity"]
    assert own[0].cost == pytest.approx(fast[:, 1].mean() / weight / -fast[:, 0].mean())
    assert own[0].air == pytest.approx(fast[:, 3].mean()) and own[0].load == pytest.approx(1.0, abs=0.01)
    forced = next(row for row in rows if "by decree" in row.reading)
    assert forced.load > 1.5 and forced.air == 0.0
    assert progress.count == len(readings(space.scene))


def test_readings_differ():
    for name in ("device", "paper", "unilateral"):
        scenes = list(readings(load_scene(name)).values())
        assert all(one != other for number, one in enumerate(scenes) for other in scenes[:number])
    assert any(scene["effects.reaction"] for scene in readings(load_scene("paper")).values())


def test_no_cost_of_transport_where_energy_does_not_balance():
    space = Space(load_scene("damped"), VARIABLES[:1])
    rows = verified(space, {"mass.upper": 0.1}, Reading(), SHORT, Execution(1), Counting())
    assert math.isnan(rows[0].cost)
    assert math.isfinite(next(row.cost for row in rows if "`device`" in row.reading))


def test_robots_that_cannot_be_built_are_passed_over():
    """Much friction jams some guide angles (Painlevé's paradox), which no bounds of the space know."""
    space = Space(SCENE.with_parameters({"ground.friction": 12.0, "ground.static_friction": 12.0}))
    points = np.random.default_rng(0).random((12, 17))
    points[0] = space.point(of_scene(space) | {"guide.angle": 0.8, "mass.inclined": 0.25, "mass.upper": 0.02})
    assert space.buildable(points[0]) is None
    built = [space.buildable(point) for point in points]
    assert 0 < sum(robot is not None for robot in built) < 12
    for robot in built:
        assert went_on(values_of(robot, SHORT)) == (robot is not None)


def test_without_weight_there_is_no_cost_of_transport():
    space = Space(SCENE.with_parameters({"gravity": 0.0}), VARIABLES[:1])
    rows = verified(space, {"mass.upper": 0.1}, Reading(), SHORT, Execution(1), Counting())
    assert all(math.isnan(row.cost) for row in rows)


def planned(words):
    return command.plan_of(command.main.parser().parse_args(words.split()))


def test_a_dc_motor_pays_from_its_supply_unless_another_power_is_asked_for():
    """The supply pays for the winding's heat, too: 23.3 W where the net work is 16.8 W."""
    machine = planned("--scene machine --fix motor.speed=100")
    assert machine.reading.power == "supply" and planned("--scene device").reading.power == "net"
    assert planned("--scene machine --power delivered").reading.power == "delivered"
    trials = Trials(2, 4.0, 4.0, VERIFYING)
    values = values_of(machine.space.scene, trials)
    speeds, net, supply = values[:, 0], values[:, 1], values[:, MEASURED.index("supply_power")]
    assert (supply > 1.3 * net).all() and machine.score(values) == pytest.approx(
        np.quantile(np.abs(speeds) / supply, 0.25))
    row = verified(machine.space, of_scene(machine.space), machine.reading, trials, Execution(1), Counting())[0]
    weight = machine.space.scene.total_mass * machine.space.scene["gravity"]
    assert row.starts == 2 and row.supply.mean == pytest.approx(supply.mean())
    assert row.cost == pytest.approx(supply.mean() / weight / np.abs(speeds).mean())


def test_the_speed_of_a_transient_says_that_it_drifts():
    """`printed` still gets faster after ten seconds, as all of its starts do; a periodic motion has no drift."""
    folder = Path(__file__).resolve().parents[3] / "docs/optimum"
    space = Space(load_scene(folder / "printed.yaml"), VARIABLES[:1])
    row = verified(space, of_scene(space), Reading(), Trials(4, 4.0, 10.0), Execution(2), Counting())[0]
    assert row.turns is None and row.drift < -1.0
    assert re.fullmatch(r"-\d+ to -\d+, drifts by -\d+", command._speed(row))  # mm/s, to three digits
    assert row.least < row.speed.mean < row.largest < 0.0 and math.isnan(row.speed.spread)
    assert "drifts" not in command._speed(replace(row, drift=0.0))


OPTIONS = "--quick --budget 24 --starts 2 --workers 1 --seed 1 --vary crank.radius=0.005:0.02 --fix upper.gap=0.001"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the output of a search that is too short to find anything."""
    found, said = tmp_path_factory.mktemp("optimise"), io.StringIO()
    with contextlib.redirect_stdout(said):
        assert command.main([*OPTIONS.split(), "--output", str(found)]) == 0
    goes, named, bounds = said.getvalue().splitlines()[-3:]
    robot = load_scene(found / "optimum.yaml")
    assert goes.startswith("The optimum goes at ") and goes in (found / "optimum.md").read_text()
    assert f"crank.radius = {robot['crank.radius']:.4g}"[:20] in named and named.endswith(".") and " kg, " in named
    assert bounds in (found / "optimum.md").read_text() and "the range of" in bounds
    return found


def test_everything_is_written_and_of_one_robot(folder):
    assert {path.name for path in folder.iterdir()} == {
        "optimum.md", "optimum.yaml", "optimum.json", "convergence.png", "front.png", "candidates"}
    robot, numbers = load_scene(folder / "optimum.yaml"), json.loads((folder / "optimum.json").read_text())
    assert all(robot[name] == value for name, value in numbers["optimum"].items())
    assert 0.005 <= robot["crank.radius"] <= 0.02 and robot["upper.gap"] == 0.001
    text = (folder / "optimum.md").read_text()
    assert f"{numbers['robots']} robots" in text and all(f"`{name}`" in text for name in numbers["optimum"])


@pytest.mark.parametrize(("words", "said"), [
    ("--scene paper", "--scene paper: has effects.reaction false"),
    ("--power supply", "--power supply: device has no dc motor"),
    ("--scene paper --objective front", "the cost of transport has no bound"),
    ("--budget 0", "--budget 0: give a number from 1"),
    ("--most-air 1.1", "--most-air 1.1: give a share from 0 to 1"),
    ("--least-speed nan", "--least-speed nan: give a number from 0"),
    ("--vary crank.radius=a:b", "'a' is not a number"),
    ("--fix guide.angle=7", "guide.angle: 7 is out of range"),
    ("--fix guide.angle=x", "guide.angle: 'x' is not a number"),
    ("--vary guide.angle=1:0.5", "give the smaller number first"), ("--vary guide.angle=0:4", "out of range"),
    ("--vary guide.angle=0.5,1", "give NAME=LOW:HIGH"),
])
def test_bad_words_are_one_line(capsys, words, said):
    assert command.main(words.split()) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and error.startswith("study: ")


def test_a_record_knows_how_its_values_were_measured(monkeypatch):
    plan = command.plan_of(command.main.parser().parse_args(OPTIONS.split()))
    before = plan.identity()
    monkeypatch.setattr("vibro_lab.study.optimise.computes_with", lambda: {"sources": "others"})
    assert {name for name in before if before[name] != plan.identity()[name]} == {"computed_with"}
