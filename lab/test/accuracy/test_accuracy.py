"""The executable `accuracy`: an interruption loses nothing, bad input is refused in words, workers end."""

import csv
import subprocess
import sys
from dataclasses import fields

import pytest

from vibro_lab.accuracy import accuracy
from vibro_lab.accuracy.harness import Row
from vibro_lab.accuracy.programs import DEVICE, UnableError
from vibro_lab.accuracy.scene_rows import rows_of_scene


def test_an_interrupted_run_keeps_its_rows(monkeypatch, tmp_path, capsys):
    rk4 = DEVICE["rk4"]

    def interrupted(problem, setting):
        if setting.value == 1e-4 and len(problem.times) > 2:
            raise KeyboardInterrupt
        return rk4.prepare(problem, setting)

    monkeypatch.setitem(accuracy.DEVICE, "rk4", rk4._replace(prepare=interrupted))
    options = ["--scene", "damped", "--horizon", "0.05", "--output", str(tmp_path)]
    assert accuracy.main(options) == 130
    with (tmp_path / "accuracy.csv").open(encoding="utf-8") as file:
        kept = list(csv.DictReader(file))
    assert list(kept[0]) == [field.name for field in fields(Row)]
    assert [row["program"] for row in kept] == ["exact", "rk4_located", "exact", "rk4"]  # exponent, reference, two rows
    assert float(kept[2]["body_error"]) >= 0.0
    assert (tmp_path / "damped.png").stat().st_size > 10_000
    assert "what was measured is kept" in capsys.readouterr().err


def test_a_scene_that_cannot_be_simulated_does_not_end_the_others(monkeypatch, tmp_path, capsys):
    def study(scene, *rest):
        if scene.name == "damped":
            raise UnableError("at 0.1 s: events follow each other")
        return rows_of_scene(scene, *rest)

    monkeypatch.setattr(accuracy, "rows_of_scene", study)
    monkeypatch.setattr(accuracy, "shipped", lambda kind: ("damped", "unilateral"))
    monkeypatch.setattr(accuracy, "DEVICE", {"exact": DEVICE["exact"]})
    options = ["--all", "--horizon", "0.05", "--starts", "2"]
    assert accuracy.main([*options, "--patience", "0.01", "--output", str(tmp_path)]) == 1
    output = capsys.readouterr()
    assert "damped: exact cannot simulate it: at 0.1 s" in output.err and "unilateral: The mean speed: " in output.out
    assert (tmp_path / "unilateral.png").exists() and not (tmp_path / "damped.png").exists()


@pytest.mark.parametrize(("options", "reason"), [
    ([], "accuracy: one of the arguments --scene --all is required; `accuracy --help` shows what there is"),
    (["--scene", "paper", "--magic"], "unrecognized arguments: --magic"),
    (["--scene", "nowhere"], "nowhere: neither a shipped scene nor a file"),
    (["--scene", "paper", "--horizon", "nan"], "--horizon nan: must be from 0.001"),
    (["--scene", "paper", "--starts", "1"], "--starts 1: must be at least 2"),
])
def test_bad_input_is_refused_before_anything_is_written(options, reason, tmp_path, capsys):
    assert accuracy.main([*options, "--output", str(tmp_path / "new")]) == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_the_executable_ends_its_workers_without_a_word(tmp_path):
    """Workers are forked from a process that has the signal handlers of `entry_point.enter`, and must end silently all
    the same.
    """
    options = ["--scene", "paper", "--horizon", "0.05", "--starts", "2", "--patience", "0.01"]
    done = subprocess.run([sys.executable, "-m", "vibro_lab.accuracy.accuracy", *options, "--output", str(tmp_path)],
                          capture_output=True, text=True, timeout=250)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr and "KeyboardInterrupt" not in done.stderr
    assert "paper: Every position to 1 mm for 0.2 s: exact (" in done.stdout
