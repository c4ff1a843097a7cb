"""The study of basins: known motions, impossible starts, and refusals; `test_table.py` has interruptions."""

import numpy as np
import pandas
import pytest

import vibro_ros
from vibro_lab.orbits.attractors import share_of
from vibro_lab.study.basins import main

RARE = ["--scene", "damped", "--set", "effects.normal_force=printed", "--set", "mass.inclined=0.25", "--set",
        "guide.angle=1.3962634015954636"]
GRID = [*RARE, "--over", "body_velocity=-2:2:20", "--over", "crank_angle=0:6:15", "--workers", "1"]


def test_the_rare_motion_is_found_among_300_starts(tmp_path, capsys):
    """A51. -35 mm/s and, where the body is thrown backwards, -236 mm/s; both orbits close, and each start's motion is
    the one to which a plain run settles.
    """
    assert main([*GRID, "--output", str(tmp_path)]) == 0
    motions, starts = (pandas.read_parquet(tmp_path / name) for name in ("attractors.parquet", "starts.parquet"))
    assert (motions["mean_speed"] * 1e3).round(1).tolist() == [-34.8, -236.5] and motions["turns"].tolist() == [1, 1]
    assert motions["starts"].sum() == 300 == len(starts) and motions["starts"][1] < 150
    assert (starts["attractor"].value_counts().sort_index().tolist() == motions["starts"].tolist())
    numbers, speeds = (starts[name].to_numpy().reshape(20, 15) for name in ("attractor", "body_velocity"))
    assert speeds[:, 0] == pytest.approx(np.linspace(-2.0, 2.0, 20))
    assert set(numbers[0]) != set(numbers[-1]) and np.all(numbers[-1] == 1)
    scene = vibro_ros.load_scene("damped").with_parameters({
        "effects.normal_force": "printed", "mass.inclined": 0.25, "guide.angle": 1.3962634015954636})
    for number in (1, 2):
        start = starts[starts["attractor"] == number].iloc[0]
        device = vibro_ros.Simulator(scene)
        device.set_state(**{name: float(start[name]) for name in starts.columns[:2]})
        device.advance_to(10.0)
        begun = device.state.body_position
        device.advance_to(10.0 + 20 * 2.0 * np.pi / 100.0)
        speed = (device.state.body_position - begun) / (device.time - 10.0)
        assert speed == pytest.approx(motions["mean_speed"][number - 1], abs=1e-6)
    largest = [complex(real[0], imaginary[0]) for real, imaginary in zip(
        motions["multipliers_real"], motions["multipliers_imaginary"], strict=True)]
    assert all(0.0 < abs(multiplier) < 1.0 for multiplier in largest)
    rate = np.log(np.abs(largest)) / (2.0 * np.pi / 100.0)
    assert motions["lyapunov_exponent"].tolist() == pytest.approx(rate.tolist())
    assert "motion 2: -236.51 mm/s, again after 1 turn" in capsys.readouterr().out


def test_starts_that_cannot_be_are_counted_and_have_no_motion(tmp_path, capsys):
    words = ["--scene", "rigid", "--set", "motor.speed=100", "--over", "upper_position=0.05:0.07:4", "--over",
             "body_velocity=0:1:2", "--workers", "1", "--output", str(tmp_path)]
    assert main(words) == 0
    table = pandas.read_parquet(tmp_path / "starts.parquet")
    beyond = table["upper_position"] > 0.06
    assert beyond.sum() == 4 and ((table["attractor"] == -1) == beyond).all()
    assert "4 starts cannot be, or could not go on, such as: no such start: upper_position" in capsys.readouterr().out


def test_a_scene_without_losses_settles_nowhere(tmp_path, capsys):
    words = ["--scene", "no_impact", "--over", "upper_velocity=0:1:2", "--over", "crank_angle=0:1:2", "--workers", "1",
             "--output", str(tmp_path)]
    assert main(words) == 0
    output = capsys.readouterr().out
    assert "4 starts had not settled within 4096 turns" in output
    assert pandas.read_parquet(tmp_path / "starts.parquet")["attractor"].tolist() == [0, 0, 0, 0]
    assert len(pandas.read_parquet(tmp_path / "attractors.parquet")) == 0


def test_chaos_is_one_motion_beside_a_periodic_one(tmp_path):
    """`device` at 120 rad/s."""
    words = ["--scene", "device", "--set", "motor.speed=120", "--over", "upper_velocity=-7:7:8", "--over",
             "crank_angle=0:6:5", "--workers", "1", "--output", str(tmp_path)]
    assert main(words) == 0
    motions = pandas.read_parquet(tmp_path / "attractors.parquet")
    assert motions["turns"].tolist() == [0, 2] and motions["lyapunov_exponent"][0] > 0.2
    assert motions["lyapunov_spread"][1] == 0.0 < motions["lyapunov_spread"][0] < motions["lyapunov_exponent"][0]
    assert motions["lyapunov_exponent"][1] < 0.0 and motions["starts"].sum() == 40
    assert [len(row) for row in motions["multipliers_real"]] == [0, 7]


def test_a_tolerance_that_rounding_breaks_is_said_once(tmp_path, capsys):
    words = [*RARE, "--set", "upper.plate.stiffness=1e12", "--over", "upper_velocity=0:1:2", "--over",
             "crank_angle=0:1:2", "--workers", "1"]
    assert main([*words, "--output", str(tmp_path)]) == 0
    assert capsys.readouterr().err.count("solver.tolerance") == 1


@pytest.mark.parametrize(("words", "message"), [
    (["--over", "speed=0:1:2"], "--over speed: is no coordinate of this scene's start; give one of upper_position"),
    (["--over", "body_velocity"], "--over body_velocity: has 1 parts; give LOW:HIGH:COUNT"),
    (["--over", "body_velocity=0:1"], "give NAME=LOW:HIGH:COUNT; for random starts use vibro_lab.attractors"),
    (["--over", "body_velocity=0:1e7:2"], "give numbers up to 1e+06"),
    (["--over", "body_velocity=0:1:3"], "--over: body_velocity; give two different coordinates"),
    (["--over", "body_velocity=0:1:3", "--over", "body_velocity=0:2:3"], "give two different coordinates"),
    (["--turns", "4"], "--turns 4 and --most-turns 4096"),
    (["--set", "effects.upper_mass=false", "--set", "effects.inclined_mass=false"], "nothing moves in it but")])
def test_bad_words_are_refused_in_one_line(refusal, words, message):
    assert message in refusal(main, *RARE, *words)


@pytest.mark.parametrize(("successes", "of", "low", "high"), [
    (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)])
def test_intervals_are_those_of_a_published_table(successes, of, low, high):
    """A50. R. G. Newcombe, Stat. Med. 17 (1998) 857, table I, method 3."""
    share, *interval = share_of(successes, of)
    assert share == successes / of and interval == pytest.approx([low, high], abs=5e-5)
