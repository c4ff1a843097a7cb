"""The section of docs/speeds.md on the optimum is made of docs/optimum/*.json, and the optima move as it says."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from research.optimum import __main__ as optimum
from research.starts import started
from tools.generated_text import replaced

DOCS = Path(__file__).resolve().parents[3] / "docs"
SPEEDS = DOCS / optimum.PAGE.name
FOLDER = DOCS / optimum.FOLDER
RESULTS = optimum.read_results(FOLDER)
WATCHED, PAPERS, MOTIONS = (json.loads((FOLDER / file).read_text(encoding="utf-8"))
                            for file in (optimum.LASTING, optimum.COMPARED, optimum.MOTIONS))


def test_the_section_is_made_of_the_numbers():
    page, section = SPEEDS.read_text(encoding="utf-8"), optimum.section(RESULTS, WATCHED, PAPERS, MOTIONS)
    assert replaced(page, *optimum.MARKS, section) == page


def test_the_front_reaches_the_fastest_optimum_and_held_optima_move_in_their_own_motions():
    """The front ends with `fastest`, and the speed of a held robot is that of one motion, not a mean over starts."""
    end, fastest = optimum.front_of_all(RESULTS)[-1], RESULTS["fastest"]["verified"][0]
    assert end == {"speed": abs(fastest["speed"]["mean"]), "cost": fastest["cost"]}
    scene = vibro_ros.load_scene(FOLDER / "thrifty.yaml").with_parameters({"effects.normal_force": "unilateral"})
    usual, *_ = optimum.settled_motions(scene, 4)
    assert usual["words"] == MOTIONS["thrifty, held"][0]["words"] in optimum.about_decree(RESULTS, MOTIONS)


@pytest.mark.parametrize("name", optimum.SEARCHES)
def test_the_scene_files_are_the_optima(name):
    scene = vibro_ros.load_scene(FOLDER / f"{name}.yaml")
    assert {parameter: scene[parameter] for parameter in RESULTS[name]["optimum"]} == RESULTS[name]["optimum"]


@pytest.mark.parametrize("name", ["thriftiest", "thrifty", "fastest", "thrifty_grounded", "fastest_grounded"])
def test_the_optima_do_what_is_said(name):
    """From three starts: the mean speed, with its sign, lies within two standard deviations of one start."""
    stored, scene = RESULTS[name]["verified"][0]["speed"], vibro_ros.load_scene(FOLDER / f"{name}.yaml")
    speeds = []
    for start in range(3):
        device = started(scene, np.random.default_rng(start))
        device.advance_to(4.0)
        begin = device.state.body_position
        span = optimum.whole_turns(scene, 10.0)
        device.advance_to(4.0 + span)
        speeds.append((device.state.body_position - begin) / span)
    spread = stored["spread"] or 0.0  # a motion with a period has none
    assert np.mean(speeds) == pytest.approx(stored["mean"], rel=1e-3, abs=8.0 * spread)


@pytest.mark.parametrize("name", ["thrifty_grounded", "fastest_grounded"])
def test_the_optima_on_the_ground_are_there_by_themselves(name):
    """With `hop` these robots are seldom in the air, and the mean N is the weight; samples of N leave out the shocks of
    landings.
    """
    scene, best = vibro_ros.load_scene(FOLDER / f"{name}.yaml"), RESULTS[name]["verified"][0]
    assert scene["effects.normal_force"] == "hop"
    assert best["air"] <= 0.02 and best["load"] == pytest.approx(1.0, abs=0.01)
    device = started(scene, np.random.default_rng(0))
    device.advance_to(4.0)
    times = 4.0 + np.linspace(0.0, optimum.whole_turns(scene, 10.0), 200_001)
    samples = device.sample(times)
    assert np.mean(samples.body_height > 0.0) < 0.03
    assert np.mean(samples.normal_force) == pytest.approx(scene.total_mass * scene["gravity"], rel=0.03)


def test_what_the_rule_holds_on_the_ground_leans_on_it():
    for name in ("thrifty", "fastest", "unilateral"):
        held = next(row for row in RESULTS[name]["verified"] if "as sought" in row["reading"] and name == "unilateral"
                    or "by decree" in row["reading"])
        assert held["load"] > 1.05


@pytest.mark.parametrize("name", [name for name in optimum.SEARCHES if name != "front"])
def test_the_optimum_beats_the_best_start_of_the_paper(name):
    best, paper = RESULTS[name]["verified"][0], PAPERS[name][0]
    if "speed_per_power" in optimum.SEARCHES[name].words:
        assert best["ratio"]["mean"] - (best["ratio"]["spread"] or 0.0) > paper["ratio"]
    else:
        assert optimum.slowest(name, WATCHED, MOTIONS) > paper["speed"]


def test_the_speeds_are_those_of_the_page_on_speeds():
    """Every motion of an optimum in `device` to which a random start leads."""
    speeds = SPEEDS.read_text(encoding="utf-8")
    rows = {name: re.findall(rf"^\| `optimum/{name}`, .*? rad/s \| (.*?) \| ([1-9]\d*) of 64 ", speeds,
                             re.MULTILINE) for name in optimum.OF_DEVICE}
    assert rows == {name: [(motion["words"], str(motion["starts"])) for motion in MOTIONS[name]]
                    for name in optimum.OF_DEVICE}
    assert "not -10600 mm/s" in optimum.about_decree(RESULTS, MOTIONS)


def test_an_optimum_that_does_not_settle_has_no_mean_on_the_page():
    """All starts of `unilateral` go faster over 256 s than any of them over 4 s: the first number is a transient's."""
    assert 0.0 < WATCHED["unilateral"][0]["fastest"] < WATCHED["unilateral"][-1]["slowest"]
    assert "goes at 49.4 to 53.5 m/s" in optimum.about_hills(WATCHED)
    assert "no start settles" in optimum.about_undamped(RESULTS, WATCHED)


def test_the_papers_robots_are_found_again(tmp_path, monkeypatch):
    """The first two starts are run again; the stored best of all starts is at least as good."""
    monkeypatch.setattr(optimum, "BEGINS", optimum.BEGINS[:2])
    for few, all_starts in zip(optimum.papers_robots("thrifty", RESULTS["thrifty"], FOLDER), PAPERS["thrifty"],
                               strict=True):
        assert 0.5 * all_starts["speed"] < few["speed"] <= 1.001 * all_starts["speed"]


def test_the_least_speed_is_kept():
    assert abs(RESULTS["thrifty"]["verified"][0]["speed"]["mean"]) > 0.15
    assert abs(RESULTS["thrifty_grounded"]["verified"][0]["speed"]["mean"]) > 0.05


def test_power_vanishes_in_the_paper_and_speed_does_not():
    first, last = WATCHED["paper"][0], WATCHED["paper"][-1]
    assert last["power"] < first["power"] / 10.0
    assert abs(last["slowest"]) > 0.8 * abs(first["slowest"])


def test_what_is_watched_for_long_is_found_again(monkeypatch):
    """In the scene `paper` the power vanishes over long times while the speed stays.

    Chaos has grown before the first of these seconds ends: a start moved by 1e-15 of itself changes its speed by
    2e-2 m/s. The stored speeds are found again because the bits of a run are the same on every computer; when the
    solver rounds otherwise than before, lasting.json is to be made again.
    """
    monkeypatch.setattr(optimum, "DURATIONS", (4.0, 64.0))
    short, long = optimum.lasting(vibro_ros.load_scene("paper"))
    for end in ("slowest", "fastest"):
        assert short[end] == pytest.approx(WATCHED["paper"][0][end], rel=1e-6)
        assert long[end] == pytest.approx(short[end], rel=0.4)
    assert long["power"] < short["power"] / 10.0
