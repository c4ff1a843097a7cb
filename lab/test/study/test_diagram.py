"""`study diagram`: hysteresis where it is known to be, states of known orbits, the same bytes after interruptions."""

import json
import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import vibro_lab
import vibro_ros
from vibro_lab.study import diagram as command
from vibro_lab.study.diagram import Diagram, main

#: Of `damped`: the branch from 100 rad/s folds at 107.959911, and ends at 104.852651 on its way back.
FOLD = ["--scene", "damped", "--vary", "motor.speed=104,104.8,105.2,106,107,107.9,108.1,109", "--workers", "1"]


@pytest.fixture(scope="module")
def fold(tmp_path_factory):
    """Return the folder of a diagram over the fold, and the study's output."""
    folder = tmp_path_factory.mktemp("fold")
    words = [*FOLD, "--output", str(folder)]
    ended = subprocess.run([sys.executable, "-m", "vibro_lab.study.command", "diagram", *words], capture_output=True,
                           text=True, check=True, timeout=120.0)
    return folder, ended.stdout


def column(folder, name):
    return pq.read_table(folder / command.VALUES)[name].to_numpy()


def design_in(folder):
    return json.loads((folder / "visits.json").read_text())["design"]


def test_hysteresis_is_between_the_fold_and_the_end_of_the_branch(fold):
    """A47. On the way down the slow motion is lost where its branch ends."""
    folder, output = fold
    assert "the largest mean speed is at the end of the range of motor.speed: it may still rise beyond" in output
    speeds = column(folder, "motor.speed")[column(folder, "two_motions")]
    assert speeds.tolist() == [105.2, 106.0, 107.0, 107.9, 107.9, 107.0, 106.0, 105.2]
    hysteresis, = [line for line in output.splitlines() if line.startswith("hysteresis")]
    assert hysteresis == "hysteresis: 105.2 to 107.9 rad/s (4 values)"


def test_each_way_finds_its_orbit_its_speed_and_its_multipliers(fold):
    """The upward sweep finds the orbit that Newton's method finds from the scene's own start."""
    folder, _ = fold
    for visit, speed in enumerate(column(folder, "motor.speed")[:6]):
        orbit = vibro_lab.find_orbit(vibro_ros.load_scene("damped").with_parameters({"motor.speed": float(speed)}))
        assert column(folder, "period")[visit] == 1
        if not column(folder, "two_motions")[visit]:
            assert column(folder, "mean_speed")[visit] == pytest.approx(orbit.mean_speed, abs=1e-7)
            expected = math.log(abs(orbit.multipliers[0])) * speed / (2.0 * math.pi)
            assert column(folder, "exponent_1")[visit] == pytest.approx(expected, abs=1e-3)
    up, down = column(folder, "mean_speed")[:8], column(folder, "mean_speed")[:7:-1]
    assert (up[2:6] < -0.05).all() and (down[2:6] > -0.03).all()


def test_the_files_tell_units_design_and_every_state(fold):
    folder, _ = fold
    table = pq.read_table(folder / command.STATES)
    assert table.num_rows == 16 and set(table["direction"].to_pylist()) == {"up", "down"}
    assert table.schema.field("upper_position").metadata[b"unit"] == b"m"
    assert table.schema.field("motor.speed").metadata[b"unit"] == b"rad/s"
    design = design_in(folder)
    assert design["scene"] == "damped" and design["set"]["upper.plate.damping"] == 100.0
    assert (folder / command.PICTURE).read_bytes().startswith(b"\x89PNG")


def test_a_state_that_was_left_is_where_the_next_value_begins(fold):
    """A device that is put into a settled state returns to it a turn later."""
    folder, _ = fold
    table = pq.read_table(folder / command.STATES)
    phase = design_in(folder)["phase"]
    row = {name: table[name][9].as_py() for name in table.column_names}
    scene = vibro_ros.load_scene("damped").with_parameters({
        "motor.speed": row["motor.speed"], "start.state": "given", "start.crank_angle": phase,
        **{f"start.{name}": row[name] for name in ("upper_position", "upper_velocity", "inclined_position",
                                                   "inclined_velocity", "body_velocity")}})
    device = vibro_ros.Simulator(scene)
    device.advance_to(2.0 * math.pi / row["motor.speed"])
    assert device.state.upper_velocity == pytest.approx(row["upper_velocity"], abs=1e-5)


def test_a_motion_that_never_settles_says_so(tmp_path, capsys):
    words = ["--scene", "unilateral", "--vary", "motor.speed=90,100", "--most-turns", "64", "--exponents", "20",
             "--output", str(tmp_path)]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "not settled: 4 of 4 visits within 64 turns" in out and "hysteresis: none" in out
    assert not column(tmp_path, "settled").any() and (column(tmp_path, "exponent_1") > 0.0).any()


@pytest.mark.process
def test_a_long_period_is_found_and_an_unknown_sign_is_said(tmp_path, capsys):
    """`device` repeats itself every 158 turns at 204 rad/s, and not at all at 186 rad/s."""
    words = ["--vary", "motor.speed=186,204", "--exponents", "20", "--output", str(tmp_path)]
    assert main(words) == 0
    out = capsys.readouterr().out
    period, exponent, spread = (column(tmp_path, name) for name in ("period", "exponent_1", "spread_1"))
    assert period[1] == 158 and exponent[1] < 0.0 == spread[1]
    assert "every 158 turns" in out and "no period to 2048" in out
    assert ("sign of the largest exponent not known, 0 lies within its interval: at 186 rad/s" in out) == bool(
        np.any(spread > np.abs(exponent)))


def test_the_sign_of_an_exponent_is_not_known_within_its_interval():
    exponents = pa.table({"exponent_1": [-1.0, 1.0, 1.0], "spread_1": [0.5, 0.5, 2.0]})
    visits = [SimpleNamespace(number=number) for number in range(3)]
    diagram = Diagram(None, tuple(visits), exponents)
    assert [diagram.sign(visit) for visit in visits] == [-1, 1, 0]


def test_a_plate_that_moves_into_a_mass_takes_it_along(tmp_path):
    """A rigid plate moves nearer from value to value, to where the mass was in the previous state."""
    words = ["--scene", "rigid", "--vary", "upper.gap=-0.01:0.01:3", "--exponents", "0", "--output", str(tmp_path)]
    assert main(words) == 0
    assert np.isfinite(column(tmp_path, "mean_speed")).all()


@pytest.mark.parametrize(("words", "reason"), [
    (["--vary", "motor.speed=60:240"], "a range needs a count here; give NAME=LOW:HIGH:COUNT"),
    (["--vary", "effects.reaction=true,false"], "is true or false; choose a number, which can go up and down"),
    (["--vary", "start.body_velocity=0:1:3"], "is no part of the machine"),
    (["--vary", "motor.speed=60"], "one value goes neither up nor down; give at least 2"),
    (["--vary", "motor.speed=0,60"], "motor.speed: 0 rad/s turns no crank"),
    (["--scene", "damped", "--vary", "crank.radius=0.05,0.07"], "at 0.07 there is no scene"),
    (["--scene", "damped", "--vary", "guide.angle=0,1"], "at 1 the state has other coordinates than at 0"),
    (["--coordinate", "crank_angle"], "--coordinate crank_angle: is none of the state; choose one of upper_position"),
    (["--phase", "nan"], "--phase: nan is out of range; give a number from 0 to 6.28318 rad"),
    (["--scene", "machine", "--vary", "motor.speed=90,100"], "--exponents 100: motor.control speed_by_current takes"),
    (["--scene", "machine", "--set", "motor.control=voltage"], "motor.voltage: 0 V turns no crank forwards"),
    (["--exponents", "3"], "--exponents (0: none): 3 is out of range; give a whole number from 20"),
    (["--most-turns", "1"], "--most-turns: 1 is out of range")])
def test_bad_input_is_refused_in_one_line_and_writes_nothing(refusal, words, reason):
    assert reason in refusal(main, *words)
