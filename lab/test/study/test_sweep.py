"""A sweep: the same bytes however often it is interrupted, no foreign files accepted, damage detected, no run lost."""

import json
import os
import re
import signal
import time

import numpy as np
import pandas
import polars
import pyarrow.parquet as pq
import pytest

import vibro_ros
from vibro_lab.study.command import locked
from vibro_lab.study.execution import Execution
from vibro_lab.study.measures import MEASURES, measure
from vibro_lab.study.sweep import main

# 24 points of 3 starts, in blocks of a second of work when the time of a block is shortened.
LONG = ["--scene", "unilateral", "--vary", "guide.angle=0.7:1.5:24", "--starts", "3", "--settling", "4",
        "--duration", "20", "--measure", "mean_speed", "upper_impacts", "--workers", "2"]
SHORT = ["--scene", "damped", "--vary", "guide.angle=0.7,1.1", "--starts", "2", "--settling", "1", "--duration", "0.5",
         "--workers", "1"]


@pytest.fixture
def small_blocks(monkeypatch):
    """Make a block contain four of the long runs."""
    monkeypatch.setattr("vibro_lab.study.sweep._BLOCK_TIME", 100.0)


def interrupted(words, folder, number):
    """Run `main` in a forked process that gets a signal after its first block; return how it ended."""
    blocks_before = len(list(folder.glob("block_*")))
    child = os.fork()
    if child == 0:
        try:
            with open(os.devnull, "w") as nowhere:
                os.dup2(nowhere.fileno(), 1), os.dup2(nowhere.fileno(), 2)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            os._exit(main(words))
        except KeyboardInterrupt:  # the front door of the program turns it into this
            os._exit(128 + signal.SIGINT)
        finally:
            os._exit(99)
    deadline = time.monotonic() + 60.0
    while len(list(folder.glob("block_*"))) == blocks_before and time.monotonic() < deadline:
        time.sleep(0.002)
    os.kill(child, number)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def test_interruptions_change_no_byte(bytes_of, tmp_path, small_blocks):
    assert main([*LONG, "--output", str(tmp_path / "whole")]) == 0
    words, folder = [*LONG, "--output", str(tmp_path / "cut")], tmp_path / "cut" / "blocks"
    ends = [interrupted(words, folder, number) for number in (signal.SIGINT, signal.SIGKILL) * 2]
    assert ends == [128 + signal.SIGINT, -signal.SIGKILL] * 2
    assert main(words) == 0
    whole = bytes_of(tmp_path / "whole")
    assert bytes_of(tmp_path / "cut") == whole and len(whole) > 10


def test_rows_are_the_measures_of_their_scenes(tmp_path, capsys):
    words = ["--scene", "device", "--set", "motor.speed=90", "--vary", "guide.angle=0.7,1.1", "--vary",
             "effects.reaction=true,false", "--vary", "effects.normal_force=hop,weight", "--starts", "2", "--settling",
             "1", "--duration", "1", "--measure", *MEASURES, "--output", str(tmp_path)]
    assert main(words) == 0
    table = pandas.read_parquet(tmp_path / "blocks")
    assert len(table) == 16 and table["error"].isna().all()
    for _, row in table.iterrows():
        names = ("guide.angle", "effects.reaction", "effects.normal_force")
        scene = vibro_ros.load_scene("device").with_parameters(
            {"motor.speed": 90.0, **{name: row[name] for name in names}})
        values = measure(scene, list(MEASURES), 1.0, 1.0, row["start"])
        np.testing.assert_array_equal(row[list(MEASURES)].to_numpy(float), list(values.values()))
    output = capsys.readouterr().out
    assert "8 points from 2 drawn starts each" in output and "mean_speed: from" in output


def test_pandas_and_polars_read_the_same_and_the_files_tell_units_scene_and_design(tmp_path):
    assert main([*SHORT, "--output", str(tmp_path)]) == 0
    by_pandas, by_polars = pandas.read_parquet(tmp_path / "blocks"), polars.read_parquet(tmp_path / "blocks")
    assert list(by_pandas.columns) == by_polars.columns == ["point", "start", "guide.angle", "mean_speed", "turns",
                                                            "states", "drift", "error", "warning"]
    assert by_polars["mean_speed"].to_list() == by_pandas["mean_speed"].to_list()
    schema = pq.read_schema(tmp_path / "blocks" / "block_000000.parquet")
    assert schema.field("mean_speed").metadata[b"unit"] == b"m/s"
    assert schema.field("guide.angle").metadata[b"unit"] == b"rad"
    document = json.loads((tmp_path / "blocks.json").read_text())
    assert document["design"]["set"]["upper.plate.damping"] == 100.0 and document["design"]["settling"] == 1.0
    assert document["design"]["vary"] == {"guide.angle": [0.7, 1.1]} and document["version"]
    everything = set(document["design"]["set"]) | set(document["design"]["vary"])
    assert everything == set(vibro_ros.load_scene("damped").parameters)


@pytest.mark.parametrize(("starts", "turns", "known"), [("0", "400", True), ("4", "100", True), ("0", "8", False)])
def test_an_exponent_has_its_interval_and_its_sign_is_known_or_said_not_to_be(tmp_path, capsys, starts, turns, known):
    """The interval comes from the parts of the run for one start, and from the means of several starts; within eight
    turns no two runs can separate.
    """
    assert main(["--scene", "unilateral", "--vary", "guide.angle=0.87", "--starts", starts, "--settling", "4",
                 "--duration", str(int(turns) * 0.063), "--measure", "lyapunov_exponent", "--workers", "1",
                 "--output", str(tmp_path)]) == 0
    output = capsys.readouterr().out
    table = pandas.read_csv(tmp_path / "summary.csv")
    rows = pandas.read_parquet(tmp_path / "blocks")
    mean, spread = table["lyapunov_exponent [1/s]"][0], table["lyapunov_exponent 95 % ± [1/s]"][0]
    assert (mean > spread) == known and ("sign not known of 1 of 1 motions" in output) != known
    assert f"{mean:.4g} ± {spread:.2g} 1/s" in output and "lyapunov_spread" not in output
    assert (starts == "4" and len(rows) == 4) or rows["lyapunov_spread"][0] == spread


def test_two_motions_of_a_point_are_two_rows_without_a_mean(tmp_path, capsys):
    """`device` at 160 rad/s: no robot runs at the mean of -79.8 and -53.6 mm/s."""
    assert main(["--scene", "device", "--vary", "motor.speed=150,160", "--starts", "8", "--duration", "6",
                 "--output", str(tmp_path)]) == 0
    table = pandas.read_csv(tmp_path / "summary.csv").query("point == 1")
    assert (table["mean_speed [m/s]"] * 1e3).round(1).tolist() == [-79.8, -53.6]
    assert table["turns"].tolist() == [3, 3] and table["starts"].sum() == 8 and table["attractor"].tolist() == [1, 2]
    assert (table["share low"] < table["share"]).all() and (table["share"] < table["share high"]).all()
    output = capsys.readouterr().out
    assert "1 of 2 points have several motions, a row each" in output and "motion 1 of 2, 6 of 8 starts" in output


def test_a_mean_that_drifts_says_so(tmp_path, capsys):
    """A body on a slope that friction cannot hold gets faster for ever, from each of 4 starts."""
    assert main(["--scene", "damped", "--set", "ground.slope=1.0", "--vary", "mass.body=1", "--starts", "4",
                 "--settling", "4", "--duration", "10", "--output", str(tmp_path)]) == 0
    assert "the mean speed drifts at 1 of 1 points" in capsys.readouterr().out
    assert abs(pandas.read_csv(tmp_path / "summary.csv")["drift [m/s]"][0]) > 1.0


def test_starts_that_repeat_one_motion_have_no_interval(tmp_path, capsys):
    """`damped` has one motion, to which every start settles; `unilateral` is chaotic."""
    for scene, is_periodic in (("damped", True), ("unilateral", False)):
        assert main(["--scene", scene, "--vary", "guide.angle=0.7,1.1", "--starts", "3", "--settling", "8",
                     "--duration", "2", "--workers", "1", "--output", str(tmp_path / scene)]) == 0
        output = capsys.readouterr().out
        assert (" from every start (" in output) == is_periodic and ("±" in output) != is_periodic


SEVEN = ",".join(f"{0.08 + 0.01 * k:.2f}" for k in range(7))


@pytest.mark.parametrize(("vary", "drawn", "axis"), [
    (["guide.angle=1.1,0.7,0.9"], [""], "guide.angle [rad]"),
    (["guide.angle=0.7:1.1:3", "mass.upper=0.1,0.2"], ["mass.upper = 0.1", "mass.upper = 0.2"], "guide.angle [rad]"),
    (["upper.gap+inclined.gap=0,0.0005,0.001"], [""], "upper.gap+inclined.gap [m]"),
    (["guide.angle=0.7,0.9,1.1", f"mass.upper={SEVEN}"], [f"mass.upper = {0.08 + 0.01 * k:.4g}" for k in range(6)],
     "guide.angle [rad]")])
def test_a_picture_and_the_words_say_what_is_there(tmp_path, capsys, monkeypatch, vary, drawn, axis):
    """A line with intervals for each of at most six values of a second parameter; an extreme at an end is said."""
    figures = []
    monkeypatch.setattr("vibro_lab.study.figures.png", lambda figure: figures.append(figure) or b"")
    words = [word for words_of_axis in vary for word in ("--vary", words_of_axis)]
    assert main(["--scene", "damped", *words, "--starts", "2", "--settling", "1", "--duration", "0.5", "--workers",
                 "1", "--output", str(tmp_path)]) == 0
    panel = figures[0].axes[0]
    lines = [bars for bars in panel.containers if len(bars) and hasattr(bars, "has_yerr")]
    assert "95 % intervals" in figures[0].get_suptitle()
    labels = [bars.get_label() for bars in lines]
    assert ["" if label.startswith("_") else label for label in labels] == drawn and panel.get_xlabel() == axis
    for bars in lines:
        places = list(bars[0].get_xdata())
        assert bars.has_yerr and places == sorted(places)
    ends = axis.partition(" ")[0].replace("+", ", ") if "+" in axis else "guide.angle"
    assert f"mean_speed is at the end of the range of {ends}" in capsys.readouterr().out


def test_the_largest_speed_of_a_robot_that_goes_backwards_is_the_fastest(tmp_path, capsys):
    """`damped` goes backwards, faster at 100 rad/s than at 60; of two values each is an end, which says nothing."""
    output = {}
    for speeds in ("60,100", "60,100,140"):
        assert main(["--scene", "damped", "--vary", f"motor.speed={speeds}", "--settling", "2", "--duration", "2",
                     "--workers", "1", "--measure", "mean_speed", "--output", str(tmp_path / speeds)]) == 0
        output[speeds] = capsys.readouterr().out
    slow, fast = (float(text) for text in re.findall(r"(-0\.\S+).*? \(motor.speed = ", output["60,100"]))
    assert fast < slow < 0.0
    assert "at the end of the range" not in output["60,100"]
    assert "the least magnitude of mean_speed is at the end of the range of motor.speed: it may still fall" in (
        output["60,100,140"])


def test_a_grid_with_an_illegal_point_is_refused_before_anything_runs(refusal):
    assert "point 3 (crank.radius = 0.08) is no scene" in refusal(
        main, "--scene", "paper", "--vary", "crank.radius=0.02:0.08:4")


def test_illegal_samples_are_rows_that_say_why(tmp_path, capsys):
    words = ["--scene", "paper", "--vary", "crank.radius=0.02:0.08", "--sample", "sobol:8", "--starts", "1",
             "--settling", "1", "--duration", "1", "--output", str(tmp_path)]
    assert main(words) == 0
    table = pandas.read_parquet(tmp_path / "blocks")
    refused = table["crank.radius"] > 0.06
    assert 0 < refused.sum() < 8
    assert table["mean_speed"].isna().equals(refused) and table["error"].notna().equals(refused)
    assert table["error"][refused].str.startswith("no such scene: crank.radius").all()
    assert f"{refused.sum()} of 8 points are no scenes" in capsys.readouterr().err


def test_a_run_that_cannot_go_on_is_counted_and_the_others_are_kept(tmp_path, capsys):
    words = ["--scene", "damped", "--set", "solver.method=rk4", "--vary", "solver.step=1e-5,0.005", "--starts", "0",
             "--settling", "0", "--duration", "1", "--output", str(tmp_path)]
    assert main(words) == 1
    table = pandas.read_parquet(tmp_path / "blocks")
    assert table["mean_speed"].isna().tolist() == [False, True] and table["start"].isna().all()
    assert "no longer finite" in table["error"][1] and "1 runs could not go on" in capsys.readouterr().out


def test_a_promise_that_rounding_breaks_is_a_warning_in_the_row(tmp_path, capsys):
    assert main([*SHORT, "--set", "upper.plate.stiffness=1e12", "--output", str(tmp_path)]) == 0
    table = pandas.read_parquet(tmp_path / "blocks")
    assert table["warning"].str.contains("solver.tolerance").all() and table["error"].isna().all()
    assert "warning: solver.tolerance" in capsys.readouterr().out


def test_another_study_at_work_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("vibro_lab.study.command._PATIENCE", 0.1)
    with locked(tmp_path):
        assert main([*SHORT, "--output", str(tmp_path)]) == 2
    assert "another study writes here" in capsys.readouterr().err


class KillingRows:
    """Rows of a point; the process that computes them is killed at one point, a given number of times."""

    def __init__(self, at, folder, times):
        self._at, self._folder, self._times = at, folder, times

    def __call__(self, number):
        if number == self._at and len(list(self._folder.iterdir())) < self._times:
            (self._folder / str(os.getpid())).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return [number]


def killing(at, folder, times, count):
    """Return the rows of `count` points, computed by two processes."""
    return Execution(2).rows(KillingRows(at, folder, times), range(count), 64.0)


def test_a_killed_worker_is_replaced(tmp_path):
    assert list(killing(3, tmp_path, 2, 20)) == [[k] for k in range(20)]
    assert len(list(tmp_path.iterdir())) == 2


def test_a_worker_that_dies_again_and_again_is_an_error(tmp_path):
    rows = killing(1, tmp_path, 9, 4)
    assert next(rows) == [0]
    with pytest.raises(RuntimeError, match="3 processes ended at or after point 1"):
        next(rows)


@pytest.mark.parametrize(("words", "message"), [
    (["--workers", "0"], "--workers"), (["--vari", "x"], "--help"), (["--measure", "speed"], "no such measure"),
    (["--scene", "machine", "--set", "motor.control=voltage"], "give --set motor.voltage=15"),
    (["--scheduler", "nowhere"], "--workers"), (["--output", "/dev/null/x"], "give an --output that can be written")])
def test_bad_words_are_refused_in_one_line(tmp_path, capsys, words, message):
    assert main([*SHORT, "--output", str(tmp_path), *words]) == 2
    err = capsys.readouterr().err
    assert message in err and err.count("\n") == 1
