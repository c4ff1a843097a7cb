"""The search finds a known optimum, keeps within its budget, and continues bit for bit after an interruption."""

import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow.parquet as pq
import pytest

from vibro_lab.study import optimise as module
from vibro_lab.study.execution import Execution
from vibro_lab.study.optimise import FRONT, Effort, non_dominated, proposals, searched
from vibro_lab.study.trials import MEASURED, Trials

PATIENCE = 120.0  # [s] deadline of what takes a few seconds on an idle machine
BEST = np.array([0.2, 0.9, 0.6])


class Counting:
    """A progress bar that counts."""

    count = 0

    def add(self, count):
        """Add `count`."""
        self.count += count


def hill(points):
    """Score that is 1 at `BEST` and less elsewhere."""
    return 1.0 - np.square(points - BEST).sum(axis=-1)


def test_finds_the_top_of_a_hill():
    search, tried = proposals(3, 0), []
    points = next(search)
    while sum(map(len, tried)) < 2000:
        tried.append(points)
        points = search.send(hill(points))
    every = np.concatenate(tried)
    assert ((every >= 0.0) & (every <= 1.0)).all()
    assert every[np.argmax(hill(every))] == pytest.approx(BEST, abs=0.01)
    assert len(tried[-1]) > len(tried[0])  # a later run has larger groups


class Cube:
    """A space whose robots are points of the unit cube."""

    dimension, scene = 3, {"solver.method": "exact"}

    def buildable(self, point):
        """Return the point."""
        return point


class Hill:
    """A plan in which a robot's values are the hill at its point."""

    objective, space, run_time = "speed", Cube(), 1.0

    def __init__(self, budget, seed=5):
        self.effort, self.seed = Effort(budget=budget, trials=Trials(starts=2)), seed

    def identity(self):
        """Return what distinguishes searches."""
        return {"seed": self.seed}

    def score(self, values):
        """Return the mean."""
        return float(values.mean())


@pytest.fixture
def simulated(monkeypatch):
    """Replace simulation by the hill; returns the list of simulated points."""
    points = []

    def values_of(point, trials):
        points.append(point)
        return np.full((trials.starts, len(MEASURED)), hill(point))

    monkeypatch.setattr(module, "values_of", values_of)
    return points


def contents(folder):
    """Return the files of a search and their contents."""
    return {file.name: file.read_bytes() for file in folder.glob("*.parquet")}


def found_in(path, plan):
    path.mkdir(exist_ok=True)
    return searched(plan, path, Execution(1), Counting())


def test_a_stopped_search_goes_on_bit_for_bit(tmp_path, simulated):
    whole = found_in(tmp_path / "whole", Hill(300))
    assert 300 <= len(whole.points) < 500  # the last group is not cut
    found_in(tmp_path / "parts", Hill(100))
    done = len(simulated)
    for budget in (150, 220, 300):
        parts = found_in(tmp_path / "parts", Hill(budget))
    np.testing.assert_array_equal(parts.points, whole.points)
    np.testing.assert_array_equal(parts.values, whole.values)
    assert contents(tmp_path / "parts") == contents(tmp_path / "whole")
    assert len(simulated) - len(whole.points) == len(whole.points) and done > len(whole.points)  # nothing twice


class SpeedAndCost(Hill):
    """A plan whose speed is the first coordinate and whose cost grows with it."""

    objective = FRONT

    def speed_and_cost(self, point, values):
        """Speed and cost of a point."""
        return 0.01 + point[0], np.exp(3.0 * point[0]) + 10.0 * np.square(point[1:] - 0.5).sum()


def test_the_front_reaches_from_slow_and_cheap_to_fast_and_dear(tmp_path, simulated):
    plan = SpeedAndCost(1600)
    candidates = found_in(tmp_path, plan)
    pairs = np.array([plan.speed_and_cost(point, None) for point in candidates.points])
    front = pairs[non_dominated(pairs)]
    assert front[0, 1] < 1.1 and front[-1, 0] > 0.99  # the cheapest, the fastest
    assert (np.diff(front, axis=0) > 0.0).all()


def test_non_dominated():
    pairs = np.array([[1.0, 5.0], [2.0, 4.0], [3.0, 9.0], [3.0, 8.0], [0.5, np.inf], [-1.0, 0.1], [2.0, 4.0]])
    assert non_dominated(pairs) == [1, 3]
    assert non_dominated(np.empty((0, 2))) == []


def command(folder, budget):
    return [sys.executable, "-m", "vibro_lab.study.command", "optimise", "--quick", "--budget", str(budget), "--starts",
            "2", "--output", str(folder), *(word for name in FIXED for word in ("--fix", name))]


FIXED = [f"{side}.{part}.{kind}" for side in ("upper", "inclined") for part in ("spring", "plate")
         for kind in ("stiffness", "damping")]


@pytest.mark.process
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


def test_another_search_is_refused(tmp_path, simulated):
    found_in(tmp_path, Hill(40))
    with pytest.raises(ValueError, match="is of another study .design.seed is 5 there, 6 here"):
        found_in(tmp_path, Hill(40, seed=6))
