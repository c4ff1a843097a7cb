"""The numbers of a summary, compared with a recording of which every number is known."""

import json
import re
from dataclasses import replace

import pytest
from robot_bag import robot_bag

import vibro_ros
from vibro_ros.bag.reader import BagError, read_bag
from vibro_ros.recordings import replay
from vibro_ros.recordings.summary import as_caption, as_text, summarise

# numbers below are sums and differences of a few hundred doubles: 1e-9 is far above their rounding
exactly = pytest.approx


def lines_of(summary) -> list[str]:
    return [" ".join(line.split()) for line in as_text(summary).splitlines()]


@pytest.fixture(scope="module")
def summary(known_run):
    return summarise(read_bag(known_run(gap=(1.0, 1.2))))


def test_every_number_of_a_known_recording(summary):
    assert summary["duration"] == exactly(4.0, rel=1e-12)
    assert summary["displacement"] == exactly(-1.0, rel=1e-9)
    assert summary["path_length"] == exactly(1.0, rel=1e-9)
    assert summary["mean_speed"] == exactly(-0.25, rel=1e-9)
    assert summary["crank_turns"] == exactly(40.0, rel=1e-9)
    assert summary["impacts"] == {"upper": 60, "inclined": 30}
    assert summary["impacts_per_turn"] == {"upper": exactly(1.5, rel=1e-9), "inclined": exactly(0.75, rel=1e-9)}
    # 2 W + 1 W/s · t over 4 s; the mean over samples, some of them missing early, is above 4 W
    assert summary["mean_power"] == exactly(4.0, rel=1e-9)
    for topic in ("/odom", "/joint_states", "/ground_contact", "/motor_power"):
        statistics = summary["topics"][topic]
        assert (statistics["messages"], statistics["gaps"]) == (801 - 39, 1)
        assert (statistics["period"], statistics["largest_gap"]) == (exactly(0.005, rel=1e-9), exactly(0.2, rel=1e-9))


@pytest.mark.parametrize(("missing", "gaps"), [(1, 0), (2, 1)])
def test_pause_of_two_periods_is_no_gap_and_of_three_is_one(known_run, missing, gaps):
    odom = summarise(read_bag(known_run(gap=(1.0, 1.0025 + 0.005 * missing))))["topics"]["/odom"]
    assert (odom["messages"], odom["gaps"]) == (801 - missing, gaps)


def test_namespaced_robot_is_summed_up_alike(known_run):
    plain = summarise(read_bag(known_run("plain")))
    named = summarise(read_bag(known_run("named", namespace="/robot1")))
    assert named["topics"]["/robot1/odom"] == plain["topics"]["/odom"]
    for key in ("duration", "displacement", "mean_speed", "impacts_per_turn", "mean_power"):
        assert named[key] == plain[key]


@pytest.mark.parametrize(("recorder", "mean"), [
    ({"parameters": json.dumps({"mass.body": 1.0, "mass.upper": 0.1, "mass.inclined": 0.08})}, 11.6 / (1.18 * 9.81)),
    ({}, None), ({"parameters": "[1"}, None), ({"parameters": '{"mass.body": "heavy"}'}, None),
    ({"parameters": '{"gravity": 0.0}'}, None)])
def test_the_load_of_the_ground_needs_the_robots_masses(known_run, recorder, mean):
    bag = replace(read_bag(known_run()), metadata=recorder)
    assert summarise(bag)["load"] == {"mean": mean and exactly(mean, rel=1e-12), "unloaded": 0.0}


def test_numbers_that_one_sample_does_not_define_are_none(known_run):
    summary = summarise(read_bag(known_run(count=1)))
    assert (summary["mean_speed"], summary["mean_power"]) == (None, None)
    assert summary["impacts_per_turn"] == {"upper": None, "inclined": None}
    assert "mean speed -" in lines_of(summary)


def test_text_and_caption_carry_the_numbers_with_units(summary):
    lines = lines_of(summary)
    for line in ("scene device", "duration 4.000 s", "resets 0", "displacement -1.0000 m", "path 1.0000 m",
                 "mean speed -250.00 mm/s", "crank turns 40.0", "upper impacts 60", "inclined impacts 30",
                 "upper impacts per turn 1.50", "mean power 4.000 W", "samples with N <= 0 0.0 %",
                 "/odom 762 5.00 ms 200.00 ms 1"):
        assert line in lines
    minus = "\N{MINUS SIGN}"
    assert as_caption(summary) == (
        f"duration 4.000 s  ·  displacement {minus}1.0000 m  ·  mean speed {minus}250.00 mm/s  ·  upper impacts per "
        "turn 1.50  ·  inclined impacts per turn 0.75  ·  mean power 4.000 W")


@pytest.mark.parametrize("options, reason", [
    ({"without": ("impacts",)}, "topic impacts is missing"),
    ({"count": 0}, "/odom holds no message; record a robot that runs"),
    ({"joints": ["upper_mass", "upper_plate"]}, "/joint_states lacks crank.position, crank.velocity; report on"),
], ids=["topic", "empty", "joint"])
def test_topics_and_joints_that_a_summary_needs_are_named(known_run, options, reason):
    with pytest.raises(BagError, match=reason):
        summarise(read_bag(known_run(**options)))


@pytest.mark.parametrize(("parameters", "index"), [
    ({"effects.normal_force": "hop", "body.inertia": 1e-3}, 0.0), ({"effects.normal_force": "hop"}, 0.0),
    ({"effects.normal_force": "weight"}, None), ({}, None)])
def test_the_pitch_index_needs_a_hop_and_the_robots_parameters(known_run, parameters, index):
    """The masses of a body in the air stand still and do not turn it, so the index is 0. Old bags lack the index's
    parameters.
    """
    bag = replace(read_bag(known_run()), metadata={"parameters": json.dumps(parameters)})
    height = bag["odom"]["position"][:, 2]
    height[:] = 0.001
    height[0] = 0.0
    summary = summarise(bag)
    assert summary["validity"] == {"pitch_index": index, "current_share": None}
    assert ("pitch index 0.000" in lines_of(summary)) == (index is not None)


def test_a_summary_warns_where_the_model_is_not_valid(summary):
    lines = lines_of(summary | {"validity": {"pitch_index": 0.8, "current_share": 1.5}})
    assert "pitch index 0.800" in lines and "rms / continuous current 1.500" in lines
    warnings = [line for line in lines if line.startswith("warning ")]
    assert ["pitch index 0.8 is above 0.2" in line for line in warnings] == [True, False] and "overheats" in warnings[1]


def test_a_replay_with_changes_prints_only_the_differences(tmp_path, capsys):
    running = vibro_ros.load_scene("damped").with_parameters({"motor.speed": 100.0})
    folder = robot_bag(tmp_path / "run", running, 400)
    assert replay.main([str(folder), "--set", "ground.friction=0.0"]) == 0
    head, *rows, written = capsys.readouterr().out.splitlines()
    assert head.split() == ["recorded", "replayed", "difference"] and written == str(tmp_path / "run_replay")
    assert rows[0].split() == ["ground.friction", "0.2", "0.0"]
    numbers = {name: [float(word) for word in words] for name, *words in (re.split(" {2,}", row) for row in rows[1:])}
    moved = [vibro_ros.read_bag(path)["odom"]["position.x"] for path in (folder, written)]
    expected = [x[-1] - x[0] for x in moved]
    assert numbers["displacement [m]"] == pytest.approx([*expected, expected[1] - expected[0]], rel=1e-5)
    assert all(recorded != replayed for recorded, replayed, _ in numbers.values()) and "crank turns" not in numbers
