"""The search finds what is known to be best, its budget holds, and a search that was stopped goes on bit for bit."""

import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow.parquet as pq
import pytest

from vibro_ros.study.optimise import search as module
from vibro_ros.study.optimise.plan import FRONT, Trials
from vibro_ros.study.optimise.search import Evaluations, SpentError, by_cma, by_weights, non_dominated, search

PATIENCE = 120.0  # [s] deadline of what takes a few seconds on an idle machine
BEST = np.array([0.2, 0.9, 0.6])


class Nobody:
    """Is told of progress."""

    def add(self, count):
        """Do nothing."""


def hill(points):
    """Score 1 at `BEST`, less elsewhere."""
    return 1.0 - np.square(points - BEST).sum(axis=1)


def test_finds_the_top_of_a_hill():
    tried = []

    def scores(points):
        tried.append(points.copy())
        if sum(map(len, tried)) > 2000:
            raise SpentError
        return hill(points)

    with pytest.raises(SpentError):
        by_cma(scores, 3, 0)
    every = np.concatenate(tried)
    assert ((every >= 0.0) & (every <= 1.0)).all()
    assert every[np.argmax(hill(every))] == pytest.approx(BEST, abs=0.01)


class Cube:
    """A space whose robots are their points."""

    dimension = 3

    def buildable(self, point):
        """Return the point."""
        return point


@pytest.fixture
def simulated(monkeypatch):
    """Replace simulation by the hill; returns the points that were simulated."""
    points = []

    def values_of_many(robots, trials, workers):
        points.extend(robots)
        return (np.full((trials.starts, 4), hill(robot[None])[0]) for robot in robots)

    monkeypatch.setattr(module, "values_of_many", values_of_many)
    return points


def contents(folder):
    """Files of a search and what they hold."""
    return {file.name: file.read_bytes() for file in folder.glob("*.parquet")}


def searched(path, budget, seed=5):
    path.mkdir(exist_ok=True)
    files = module.candidate_files(path, {"seed": seed}, 3, 2)
    evaluations = Evaluations(Cube(), Trials(starts=2), files, budget, 1, Nobody())
    search(evaluations, lambda values: float(values.mean()), 3, seed)
    return evaluations.gathered()


def test_a_stopped_search_goes_on_bit_for_bit(tmp_path, simulated):
    whole = searched(tmp_path / "whole", 300)
    assert 300 <= len(whole.points) < 500  # the last group is not cut
    searched(tmp_path / "parts", 100)
    done = len(simulated)
    for budget in (150, 220, 300):
        parts = searched(tmp_path / "parts", budget)
    np.testing.assert_array_equal(parts.points, whole.points)
    np.testing.assert_array_equal(parts.values, whole.values)
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")
    assert len(simulated) - len(whole.points) == len(whole.points) and done > len(whole.points)  # nothing twice


class SpeedAndCost:
    """A plan whose speed is the first coordinate and whose cost grows with it."""

    objective, seed, space = FRONT, 0, Cube()

    def speed_and_cost(self, point, values):
        """Speed and cost of a point."""
        return 0.01 + point[0], np.exp(3.0 * point[0]) + 10.0 * np.square(point[1:] - 0.5).sum()


def test_the_front_reaches_from_slow_and_cheap_to_fast_and_dear(tmp_path, simulated):
    files = module.candidate_files(tmp_path, {}, 3, 2)
    evaluations = Evaluations(Cube(), Trials(starts=2), files, 1600, 1, Nobody())
    by_weights(evaluations, SpeedAndCost())
    pairs = np.array([SpeedAndCost().speed_and_cost(point, None) for point in evaluations.gathered().points])
    front = pairs[non_dominated(pairs)]
    assert front[0, 1] < 1.1 and front[-1, 0] > 0.99  # the cheapest, the fastest
    assert (np.diff(front, axis=0) > 0.0).all()


def test_non_dominated():
    pairs = np.array([[1.0, 5.0], [2.0, 4.0], [3.0, 9.0], [3.0, 8.0], [0.5, np.inf], [-1.0, 0.1], [2.0, 4.0]])
    assert non_dominated(pairs) == [1, 3]
    assert non_dominated(np.empty((0, 2))) == []


def command(folder, budget):
    return [sys.executable, "-m", "vibro_ros.study.study", "optimise", "--quick", "--budget", str(budget), "--starts",
            "2", "--output", str(folder), *(word for name in FIXED for word in ("--fix", name))]


FIXED = [f"{side}.{part}.{kind}" for side in ("upper", "inclined") for part in ("spring", "plate")
         for kind in ("stiffness", "damping")]


def test_ctrl_c_keeps_what_is_done_and_the_same_command_goes_on(tmp_path):
    folder = tmp_path / "candidates"
    process = subprocess.Popen(command(tmp_path, 100_000), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    while len(contents(folder)) < 3:
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "the same command goes on from there" in said and "Traceback" not in said
    kept = contents(folder)
    budget = sum(pq.read_metadata(folder / name).num_rows for name in kept)
    done = subprocess.run(command(tmp_path, budget), capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert contents(folder) == kept
    assert (tmp_path / "optimum.yaml").is_file()


def test_other_candidates_and_another_search_are_refused(tmp_path, simulated):
    searched(tmp_path, 40)
    with pytest.raises(ValueError, match="is of another study .design.seed is 5 there, 6 here"):
        searched(tmp_path, 40, 6)
    (tmp_path / "others").mkdir()
    files = module.candidate_files(tmp_path / "others", {}, 3, 2)
    files.write(0, [{"point": BEST, "values": np.zeros(2 * 4)}])
    with pytest.raises(RuntimeError, match="is of other candidates than this version proposes"):
        Evaluations(Cube(), Trials(starts=2), files, 10, 1, Nobody())(BEST[None] + 1e-12)
