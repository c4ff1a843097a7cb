"""A sweep's file and the options that override it: the shipped file is read, and every mistake is named with its
remedy.
"""

import argparse

import pytest

from vibro_lab.study.sweep_design import design_of, given_in_words, read_sweep
from vibro_ros.configuration.scene_file import find_file, shipped

WORDS = {"scene": None, "set": [], "vary": [], "sample": None, "measure": None, "starts": None, "settling": None,
         "duration": None}


def entries_of(**options):
    """Return the output of the command line."""
    return given_in_words(argparse.Namespace(**WORDS | options))


def file_of(tmp_path, text):
    """Return a file with the given text."""
    path = tmp_path / "sweep.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", shipped("sweep"))
def test_shipped_sweeps_are_designs(name):
    found = design_of(read_sweep(find_file("sweep", name)), entries_of())
    assert found.points > 1 and all(scene is not None for _, scene, _ in found.scenes())


def test_a_file_says_everything(tmp_path):
    path = file_of(tmp_path, "scene: damped\nset: {motor.speed: 80.0, effects.reaction: true}\n"
                   "vary:\n  guide.angle: {from: 0.7, to: 1.5, count: 3}\n  mass.inclined: {from: 1e-2, to: 0.1, "
                   "scale: log}\nsample: {method: sobol, count: 8, seed: 5}\nmeasure: [mean_speed, period]\nstarts: 4\n"
                   "settling: 2\nduration: 3.5\n")
    found = design_of(read_sweep(path), entries_of())
    assert (found.scene.name, found.scene["motor.speed"], found.scene["effects.reaction"]) == ("damped", 80.0, True)
    assert (found.points, found.starts, found.settling, found.duration) == (24, 4, 2.0, 3.5)
    assert found.measures == ("mean_speed", "period") and found.sampling.seed == 5


def test_the_command_line_changes_what_the_file_says(tmp_path):
    path = file_of(tmp_path, "scene: damped\nset: {motor.speed: 80.0}\nvary: {guide.angle: [0.7, 1.5]}\nstarts: 4\n")
    found = design_of(read_sweep(path), entries_of(vary=["motor.speed=60,70"], set=["guide.angle=1.0"], scene="rigid",
                                             measure=["period"], duration=2.0))
    assert found.names == ("motor.speed",) and found.scene["guide.angle"] == 1.0
    assert (found.scene.name, found.measures, found.starts, found.duration) == ("rigid", ("period",), 4, 2.0)


def test_linked_parameters_of_a_file_are_overridden_together_or_not_at_all(tmp_path):
    path = file_of(tmp_path, "scene: damped\nvary: {upper.gap+inclined.gap: [0.0, 0.001], mass.upper: [0.1]}\n")
    found = design_of(read_sweep(path), entries_of(vary=["upper.gap=0.001", "inclined.gap=0.002"]))
    assert [one.name for one in found.varied] == ["mass.upper", "upper.gap", "inclined.gap"]
    with pytest.raises(ValueError, match="upper.gap: is set and varied"):
        design_of(read_sweep(path), entries_of(set=["upper.gap=0.001"]))


def test_a_relative_path_of_the_scene_starts_at_the_file(tmp_path, monkeypatch):
    (tmp_path / "own.yaml").write_text("/**:\n  ros__parameters:\n    mass.body: 2.0\n")
    path = file_of(tmp_path, "scene: own.yaml\nvary: {guide.angle: [0.7]}\n")
    monkeypatch.chdir("/")
    assert design_of(read_sweep(path), entries_of()).scene["mass.body"] == 2.0


@pytest.mark.parametrize(("text", "words"), [
    ("", "holds no mapping"), ("varry: {}", "did you mean vary"), ("scene: 3", "no text"), ("vary: 3", "no mapping"),
    ("vary: {guide.angel: [1]}", "did you mean guide.angle"), ("set: {guide.angle: 9}", "out of range"),
    ("starts: -1", "whole number"), ("duration: .inf", "give seconds"), ("measure: mean_speed", "list of names"),
    ("sample: {method: sobol, count: 8, sed: 1}", "says not how"), ("scene: paper\nscene: damped", "given twice")])
def test_a_slip_in_a_file_is_named_in_one_line(tmp_path, text, words):
    with pytest.raises(ValueError, match=words) as refused:
        read_sweep(file_of(tmp_path, text))
    assert "\n" not in str(refused.value) and "sweep.yaml" in str(refused.value)


@pytest.mark.parametrize(("options", "words"), [
    ({"set": ["guide.angle"]}, "NAME=VALUE"), ({"set": ["guide.angle=1", "guide.angle=2"]}, "given twice"),
    ({"vary": ["guide.angle=1", "guide.angle=2"]}, "given twice"), ({"starts": -1}, "--starts"),
    ({"vary": ["guide.angle=1,2"]}, "scene: none given"), ({"scene": "papper", "vary": ["guide.angle=1"]}, "papper"),
    ({"scene": "paper", "set": ["guide.angle=1"], "vary": ["guide.angle=1,2"]}, "set and varied"),
    ({"scene": "paper"}, "nothing varies"), ({"scene": "device", "vary": ["guide.angle=1"]}, "motor.speed=100"),
    ({"scene": "paper", "vary": ["guide.angle=1"], "settling": 0.5}, "settling")])
def test_a_slip_in_the_words_is_named(options, words):
    with pytest.raises(ValueError, match=words):
        design_of({}, entries_of(**options))


def test_no_such_file_names_the_shipped_ones(tmp_path):
    for name in ("no_such", "", str(tmp_path), "\0"):
        with pytest.raises(ValueError, match="guide_angle"):
            find_file("sweep", name)
