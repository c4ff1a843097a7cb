"""The command line of `study identify`: help, refusals before anything is written, files, and Ctrl-C."""

import json
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

import vibro_ros
from vibro_lab.study import identify as study
from vibro_lab.study.command import STUDIES

PATIENCE = 120.0  # s for a process on a busy machine


def test_help_has_each_option_and_the_exit_codes(capsys):
    with pytest.raises(SystemExit) as end:
        study.main(["--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert end.value.code == 0
    for word in ("BAG", "--free", "--excite", "--range NAME=LOW:HIGH", "--noise SENSOR=SIGMA", "--effects",
                 "stribeck, slope", "Exit code 0: done", "130"):
        assert word in said
    assert "identify" in STUDIES


@pytest.mark.parametrize(("words", "said"), [
    (["--range", "ground.friction"], "--range ground.friction: give NAME=LOW:HIGH"),
    (["--range", "ground.friction=0.1"], "--range ground.friction=0.1: give NAME=LOW:HIGH"),
    (["--range", "ground.friction=low:1"], "low is no number; give one such as 0.1"),
    (["--range", "ground.friction=0.4:0.1"], "0.4 to 0.1 is no range"),
    (["--range", "ground.slope=0:0.1"], "range of ground.slope: the parameter is not free"),
    (["--noise", "odom"], "--noise odom: give SENSOR=SIGMA"),
    (["--noise", "odom=loud"], "loud is no number; give one such as 0.1"),
    (["--noise", "odom=-1"], "noise of odom: -1.0 is no standard deviation; give a number above 0"),
    (["--offset", "odom"], "--offset odom: give SENSOR=SECONDS"),
    (["--effects", "wind"], "'wind' is none that can be tried; give any of stribeck"),
    (["--free", "mass.bodi"], "'mass.bodi' is no number of the robot"),
    (["--free", "mass.body,mass.body"], "each once"),
    (["--scheduler", "tcp://host:1"], "--scheduler: a recording is fitted on this machine"),
    ([], "no such folder; give the folder of a recording"),
], ids=lambda part: " ".join(part) if isinstance(part, list) else "")
def test_bad_input_ends_with_one_line_and_code_2(tmp_path, capsys, words, said):
    output = tmp_path / "out"
    assert study.main([str(tmp_path / "none"), "--scene", "damped", "--output", str(output), *words]) == 2
    captured = capsys.readouterr()
    assert said in captured.err and captured.err.count("\n") == 1 and "Traceback" not in captured.err
    assert captured.out == ""
    assert not output.exists() or not list(output.iterdir())


def test_the_scene_and_the_numbers_are_written_and_can_be_loaded(tmp_path, capsys, monkeypatch):
    """`identify` is replaced: what is given to it and what becomes of its result is the command's part."""
    given = {}

    def replacement(bag, scene, free, ranges, noise, effects, workers, offsets, camera, say):
        given.update(bag=bag, scene=scene, free=free, ranges=ranges, noise=noise, effects=effects, offsets=offsets,
                     camera=camera)
        return SimpleNamespace(
            values={"ground.friction": 0.21}, intervals={"ground.friction": (0.2, 0.22)},
            covariance=np.array([[1e-4]]), rank=("a sentence",), chi_square={"odom": 1.0}, p_value=0.5,
            autocorrelation={"odom.body_position": 0.0}, verdict="the model fits, p = 0.5", said=("read",), passes=7,
            profiles={"ground.friction": np.array([[0.21, 0.0]])},
            windows=np.zeros(1, study.WINDOW), alternatives=(), sensors={"odom.offset": (0.003, 0.0029, 0.0031)},
            outliers={"odom.body_position": np.array([[0.5, 2.0]])},
            recording=SimpleNamespace(channels=()), words=lambda: ["words of the result"],
            scene=scene.with_parameters({"ground.friction": 0.21}))

    monkeypatch.setattr(study, "identify", replacement)
    monkeypatch.setattr(study, "identification_page", lambda identified, name: f"<p>{name}: {identified.verdict}")
    assert study.main(["bag", "--scene", "damped", "--set", "mass.body=1.1", "--output", str(tmp_path), "--free",
                       "ground.friction, upper.gap", "--range", "ground.friction=0.1:0.4", "--noise", "odom=inf",
                       "--noise", "encoder=1e-3", "--effects", "stribeck,slope", "--offset", "odom=0.003",
                       "--camera", "scale"]) == 0
    assert given["offsets"] == {"odom": 0.003} and given["camera"] == ("scale",)
    assert given["free"] == ("ground.friction", "upper.gap") and given["effects"] == ("stribeck", "slope")
    assert given["ranges"] == {"ground.friction": (0.1, 0.4)}
    assert given["noise"] == {"odom": float("inf"), "encoder": 1e-3} and given["scene"]["mass.body"] == 1.1
    scene = vibro_ros.load_scene(tmp_path / study.SCENE)
    assert (scene["ground.friction"], scene["mass.body"]) == (0.21, 1.1)
    numbers = json.loads((tmp_path / study.NUMBERS).read_text())
    assert numbers["intervals"] == {"ground.friction": [0.2, 0.22]} and numbers["verdict"] == "the model fits, p = 0.5"
    assert (tmp_path / study.PAGE).read_text() == "<p>bag: the model fits, p = 0.5"
    assert numbers["sensors"] == {"odom.offset": [0.003, 0.0029, 0.0031]}
    assert numbers["outliers"] == {"odom.body_position": [[0.5, 2.0]]}
    said = capsys.readouterr().out
    assert "words of the result" in said and str(tmp_path / study.SCENE) in said


def test_by_default_all_that_a_scene_has_is_free_and_what_is_0_is_not(tmp_path, monkeypatch):
    given = {}
    monkeypatch.setattr(study, "identify", lambda bag, scene, free, *rest, say: given.update(free=free) or 1 / 0)
    for name, missing in (("damped", ()), ("unilateral", ("upper.spring.damping", "inclined.plate.damping"))):
        with pytest.raises(ZeroDivisionError):
            study.main(["bag", "--scene", name, "--output", str(tmp_path)])
        assert {"ground.friction", "guide.angle", "upper.gap"} <= set(given["free"])
        assert len(given["free"]) == (9 if missing else 13) and not set(missing) & set(given["free"])


@pytest.mark.process
def test_ctrl_c_ends_a_fit_with_130_and_says_so(tmp_path):
    program = ("import sys, time; from vibro_lab.study import identify as study\n"
               "def fit(*given, say): print('fitting', flush=True); [time.sleep(0.01) for _ in range(60_000)]\n"
               "study.identify = fit\n"
               "from vibro_ros.process.entry_point import enter\n"
               f"sys.exit(study.main(['bag', '--scene', 'damped', '--output', {str(tmp_path / 'out')!r}]))\n")
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               text=True)
    assert process.stdout.readline() == "fitting\n"
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130 and time.monotonic() - begun < PATIENCE
    assert "interrupted; the same command begins anew" in said and "Traceback" not in said
    assert not list((tmp_path / "out").iterdir())
