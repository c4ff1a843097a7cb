"""Axes, ranges and designs of a sweep: grids and samples are as requested, and nonsense is refused in a line."""

import math

import numpy as np
import pytest
from scipy.stats import qmc

import vibro_ros
from vibro_lab.study.sweep import main, study_of
from vibro_lab.study.sweep_design import SweepDesign, design_of
from vibro_lab.study.variation import (
    Axis,
    Range,
    at_the_edge,
    ends_at,
    sampling_in_words,
    varied_in_words,
)


def design(varied, sampling=None, starts=2):
    """Return a design over the paper's scene."""
    return SweepDesign(vibro_ros.load_scene("paper"), tuple(varied), sampling, ("mean_speed",), starts, 1.0, 1.0)


def test_a_grid_has_both_ends_and_equal_steps_or_ratios():
    axis = varied_in_words("guide.angle=0.7:1.5:5")
    assert axis.name == "guide.angle" and axis.values == pytest.approx([0.7, 0.9, 1.1, 1.3, 1.5])
    assert (axis.values[0], axis.values[-1]) == (0.7, 1.5)
    axis = varied_in_words("upper.plate.stiffness=1e5:1e8:4:log")
    assert axis.values == pytest.approx([1e5, 1e6, 1e7, 1e8]) and axis.values[-1] == 1e8


def test_lists_are_of_the_parameters_type():
    assert varied_in_words("effects.reaction=true,false").values == (True, False)
    assert varied_in_words("effects.normal_force=printed,hop").values == ("printed", "hop")
    assert varied_in_words("mass.inclined=0.02,1").values == (0.02, 1.0)


def test_linked_parameters_have_one_value_on_a_grid_and_in_a_sample():
    gaps, speed = (varied_in_words(text, linked=True) for text in (
        "upper.gap+inclined.gap=0,0.001", "mass.upper+mass.inclined=0.02:0.2"))
    drawn = design([gaps, speed], sampling_in_words("sobol:4:0"))
    assert drawn.points == 8 and drawn.names == ("upper.gap", "inclined.gap", "mass.upper", "mass.inclined")
    for point in range(8):
        values = drawn.changes(point)
        assert values["upper.gap"] == values["inclined.gap"] == gaps.values[point // 4]
        assert values["mass.upper"] == values["mass.inclined"] == drawn.changes(point % 4)["mass.upper"]
    assert "mass.upper+mass.inclined" in drawn.document()["vary"] and "mass.upper" not in drawn.document()["set"]


@pytest.mark.parametrize(("text", "words"), [
    ("upper.gap+motor.speed=0,1", "link parameters of one kind"), ("upper.gap+inclined.gapp=0,1", "did you mean"),
    ("guide.angle+ground.slope=0,2", "ground.slope")])
def test_parameters_that_cannot_be_linked_are_refused(text, words):
    with pytest.raises(ValueError, match=words):
        varied_in_words(text, linked=True)
    with pytest.raises(ValueError, match="only `study sweep` links"):
        varied_in_words(text)


@pytest.mark.parametrize("method", ["sobol", "latin_hypercube"])
def test_samples_are_scipys_and_their_seed_counts(method):
    drawn = design([Range("guide.angle", 0.5, 1.5, False), Range("mass.inclined", 0.02, 0.2, True)],
                   sampling_in_words(f"{method}:16:7"))
    values = np.array([list(drawn.changes(point).values()) for point in range(drawn.points)])
    sampler = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}[method](2, seed=np.random.default_rng(7))
    shares = sampler.random(16)
    assert values[:, 0] == pytest.approx(0.5 + shares[:, 0])
    assert np.log(values[:, 1] / 0.02) / math.log(10.0) == pytest.approx(shares[:, 1])
    other = design(drawn.varied, sampling_in_words(f"{method}:16:8"))
    assert other.changes(0) != drawn.changes(0) and design(drawn.varied, drawn.sampling).changes(5) == drawn.changes(5)


def test_points_are_every_combination_with_every_sample_and_rows_every_start():
    drawn = design([Axis("guide.angle", (0.5, 1.0)), Range("mass.inclined", 0.02, 0.2, False),
                    Axis("effects.normal_force", ("printed", "hop"))], sampling_in_words("sobol:4:0"), starts=3)
    assert (drawn.points, drawn.rows) == (16, 48)
    changes = [drawn.changes(point) for point in range(16)]
    assert [list(change) for change in changes[:1]] == [["guide.angle", "mass.inclined", "effects.normal_force"]]
    assert [(change["guide.angle"], change["effects.normal_force"]) for change in changes[::4]] == [
        (0.5, "printed"), (0.5, "hop"), (1.0, "printed"), (1.0, "hop")]
    assert [change["mass.inclined"] for change in changes[:4]] == [change["mass.inclined"] for change in changes[4:8]]
    assert [drawn.runs(number) for number in (0, 15)] == [(0, (0, 1, 2)), (15, (0, 1, 2))]
    drawn = design([Axis("guide.angle", tuple(np.linspace(0.1, 3.0, 1000).tolist()))], starts=20)
    assert [drawn.runs(number) for number in (2, 3)] == [(1, tuple(range(16))), (1, (16, 17, 18, 19))]
    study = study_of(drawn)
    assert study.count == 2000 and [k for block in range(study.blocks) for k in study.points(block)] == [*range(2000)]


@pytest.mark.parametrize(("text", "words"), [
    ("guide.angle", "NAME=LOW:HIGH:COUNT"), ("guide.angle=0.7-1.2", "NAME=LOW:HIGH:COUNT"),
    ("guide.angel=0:1:3", "did you mean guide.angle"),
    ("guide.angle=0:1:2:3", "4 parts"), ("guide.angle=1:0:3", "smaller number first"),
    ("guide.angle=0:nan:3", "'nan' is not a number"), ("guide.angle=0:1:1", "count: 1 is out of range"),
    ("guide.angle=0:4:3", "0 to 3.14159 rad"), ("guide.angle=0:1:3:log", "no logarithm"),
    ("guide.angle=0.1,0.1", "given twice"), ("effects.reaction=0:1:2", "has no range"),
    ("guide.angle=0:1:9999999", "whole number")])
def test_what_varies_nothing_is_refused_in_one_line(text, words):
    with pytest.raises(ValueError, match=words) as refused:
        varied_in_words(text)
    assert "\n" not in str(refused.value)


def test_an_extreme_at_an_end_of_a_scan_is_said():
    """Only a numerical parameter has ends; a scan of one or two values has none, because every point would be one."""
    values = {"guide.angle": [0.5, 0.5, 1.0, 0.7], "effects.normal_force": ["hop", "printed"] * 2,
              "mass.upper": [0.1] * 4, "motor.speed": [50.0, 60.0] * 2, "mass.inclined": [0.1, 0.2, 0.3, 0.2]}
    assert at_the_edge("the largest x", ends_at(values, 2)) == (
        "the largest x is at the end of the range of guide.angle, mass.inclined: it may still rise beyond")
    assert at_the_edge("the largest x", ends_at({**values, "guide.angle": [0.0, 0.5, 1.0, 2.0]}, 1)) == ""


@pytest.mark.parametrize(("text", "words"), [
    ("sobol", "METHOD:COUNT"), ("halton:8", "'halton' is unknown"), ("sobol:1000", "512 or 1024"),
    ("latin_hypercube:8:-1", "seed"), ("sobol:x", "count")])
def test_a_bad_sampling_is_refused(text, words):
    with pytest.raises(ValueError, match=words):
        sampling_in_words(text)


@pytest.mark.parametrize(("varied", "sampling", "starts", "words"), [
    ([Range("guide.angle", 0.1, 1.0, False)], None, 2, "needs --sample"),
    ([Axis("guide.angle", (0.1,))], sampling_in_words("sobol:8:0"), 2, "no range to sample"),
    ([Axis("upper.gap+inclined.gap", (0.0,)), Axis("upper.gap", (0.0,))], None, 2, "upper.gap: is varied twice"),
    ([Axis(name, tuple(np.linspace(0.01, 0.02, 1000).tolist())) for name in ("mass.upper", "mass.inclined")], None,
     101, "more than 100000000 runs")])
def test_a_design_that_contradicts_itself_is_refused(varied, sampling, starts, words):
    with pytest.raises(ValueError, match=words):
        design(varied, sampling, starts)


@pytest.mark.parametrize(("words", "message"), [
    ("--set guide.angle", "NAME=VALUE"), ("--set guide.angle=1 --set guide.angle=2", "given twice"),
    ("--vary guide.angle=1 --vary guide.angle=2", "varied twice"), ("--vary guide.angle=1 --starts -1", "--starts"),
    ("--scene papper --vary guide.angle=1", "papper"),
    ("--scene paper --set guide.angle=1 --vary guide.angle=1,2", "set and varied"),
    ("--scene paper --set upper.gap=0 --vary upper.gap+inclined.gap=0,0.001", "upper.gap: is set and varied"),
    ("--scene paper", "nothing varies"), ("--vary guide.angle=1", "motor.speed=100"),
    ("--scene paper --vary guide.angle=1 --settling 0.5", "settling"),
    ("--scene paper --vary guide.angle=1 --duration inf", "duration")])
def test_a_slip_in_the_words_is_named(words, message):
    with pytest.raises(ValueError, match=message):
        design_of(main.parser().parse_args(words.split()))
