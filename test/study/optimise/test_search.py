"""The search finds what is known to be best, its budget holds, and a search that was stopped goes on bit for bit."""

import json
import os
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from vibro_ros.study.optimise import search as module
from vibro_ros.study.optimise.plan import FRONT, Trials
from vibro_ros.study.optimise.search import METHODS, Evaluations, Record, SpentError, by_weights, non_dominated, search

PATIENCE = 120.0  # [s] deadline of what takes a few seconds on an idle machine
BEST = np.array([0.2, 0.9, 0.6])


class Nobody:
    """Is told of progress."""

    def add(self, count):
        """Do nothing."""


def hill(points):
    """Score 1 at `BEST`, less elsewhere."""
    return 1.0 - np.square(points - BEST).sum(axis=1)


@pytest.mark.parametrize("method", METHODS)
def test_finds_the_top_of_a_hill(method):
    tried = []

    def scores(points):
        tried.append(points.copy())
        if sum(map(len, tried)) > 2000:
            raise SpentError
        return hill(points)

    with pytest.raises(SpentError):
        METHODS[method](scores, 3, 0)
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
        return (np.full((trials.starts, 1), hill(robot[None])[0]) for robot in robots)

    monkeypatch.setattr(module, "values_of_many", values_of_many)
    return points


def searched(path, budget, method="cma"):
    record = Record(path, {"method": method})
    evaluations = Evaluations(Cube(), Trials(starts=2), record, budget, 1, Nobody())
    search(method, evaluations, lambda values: float(values.mean()), 3, 5)
    record.close()
    return evaluations.gathered()


@pytest.mark.parametrize("method", METHODS)
def test_a_stopped_search_goes_on_bit_for_bit(tmp_path, simulated, method):
    whole = searched(tmp_path / "whole", 300, method)
    assert 300 <= len(whole.points) < 500  # the last group is not cut
    searched(tmp_path / "parts", 100, method)
    done = len(simulated)
    for budget in (150, 220, 300):
        parts = searched(tmp_path / "parts", budget, method)
    np.testing.assert_array_equal(parts.points, whole.points)
    np.testing.assert_array_equal(parts.values, whole.values)
    assert (tmp_path / "parts").read_bytes() == (tmp_path / "whole").read_bytes()
    assert len(simulated) - len(whole.points) == len(whole.points) and done > len(whole.points)  # nothing twice


class SpeedAndCost:
    """A plan whose speed is the first coordinate and whose cost grows with it."""

    objective, seed, space = FRONT, 0, Cube()

    def speed_and_cost(self, point, values):
        """Speed and cost of a point."""
        return 0.01 + point[0], np.exp(3.0 * point[0]) + 10.0 * np.square(point[1:] - 0.5).sum()


def test_the_front_reaches_from_slow_and_cheap_to_fast_and_dear(tmp_path, simulated):
    record = Record(tmp_path / "record", {})
    evaluations = Evaluations(Cube(), Trials(starts=2), record, 1600, 1, Nobody())
    by_weights(evaluations, SpeedAndCost())
    record.close()
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
    record = tmp_path / "evaluations.jsonl"
    process = subprocess.Popen(command(tmp_path, 100_000), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    while not record.exists() or record.read_bytes().count(b"\n") < 3:
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "the same command goes on from there" in said and "Traceback" not in said
    kept = record.read_bytes()
    groups = [json.loads(line) for line in kept[:kept.rindex(b"\n")].splitlines()[1:]]
    budget = sum(len(group["points"]) for group in groups)
    done = subprocess.run(command(tmp_path, budget), capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    assert record.read_bytes() == kept[:kept.rindex(b"\n") + 1]
    assert (tmp_path / "optimum.yaml").is_file()


def test_a_full_disk_is_one_line_and_what_was_written_stays(tmp_path):
    def no_room():
        resource.setrlimit(resource.RLIMIT_FSIZE, (8000, 8000))

    full = subprocess.run(command(tmp_path, 60), capture_output=True, text=True, timeout=PATIENCE, preexec_fn=no_room)
    assert full.returncode == 1
    last = full.stderr.splitlines()[-1]
    assert last.startswith("study: ") and "File too large" in last and "Traceback" not in full.stderr
    *whole, _ = (tmp_path / "evaluations.jsonl").read_bytes().split(b"\n")
    assert len(whole) > 1  # and what a torn line is to the next search, another test tells
    assert all(json.loads(line) for line in whole)


SEARCH = {"seed": 3, "scene": {"guide.angle": 0.1}}
POINTS = np.array([[0.1, 0.2], [0.3, 1.0 / 3.0]])
VALUES = np.array([[[1.0, np.nan, 3.0]], [[0.1, -0.2, 1e-300]]])


@pytest.fixture
def path(tmp_path):
    """Return a file with two groups."""
    file = tmp_path / "evaluations.jsonl"
    record = Record(file, SEARCH)
    record.append(POINTS, VALUES)
    record.append(POINTS + 0.01, 2.0 * VALUES)
    record.close()
    return file


def opened_and_closed(path, search=SEARCH):
    record = Record(path, search)
    record.close()
    return record


def test_gives_back_every_bit(path):
    record = opened_and_closed(path)
    np.testing.assert_array_equal(record.recorded(0, POINTS), VALUES)
    np.testing.assert_array_equal(record.recorded(1, POINTS + 0.01), 2.0 * VALUES)
    assert record.recorded(2, POINTS) is None


def test_a_torn_last_line_is_cut_at_every_byte_and_the_record_goes_on(path):
    whole = path.read_bytes()
    first = whole[:whole.rindex(b"\n", 0, -1) + 1]
    for end in range(len(first), len(whole)):
        path.write_bytes(whole[:end])
        assert opened_and_closed(path).recorded(1, POINTS + 0.01) is None
        assert path.read_bytes() == first
    record = Record(path, SEARCH)
    record.append(POINTS + 0.01, 2.0 * VALUES)
    record.close()
    assert path.read_bytes() == whole


@pytest.mark.parametrize("line", [b"nonsense", b"[]", b"[" * 100_000, b"\xff\xfe",
                                  b'{"points": [[1e999]], "values": [[[0.0]]]}',
                                  b'{"points": [[0.1], [0.2]], "values": [[[0.0]]]}'])
def test_a_damaged_line_is_named(path, line):
    head, _, last = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(head + line + b"\n" + last)
    with pytest.raises(ValueError, match="line 2 is no group of candidates; delete"):
        Record(path, SEARCH)
    assert path.read_bytes() == head + line + b"\n" + last


@pytest.mark.parametrize("content", [b"", b"\x00" * 100, b'{"search": {"seed": 4}}\n'])
def test_a_file_of_another_kind_or_search_is_refused_and_left(tmp_path, content):
    path = tmp_path / "evaluations.jsonl"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="not the record of this search.*give another --output"):
        Record(path, SEARCH)
    assert path.read_bytes() == content


def test_other_candidates_are_refused(path):
    record = opened_and_closed(path)
    with pytest.raises(ValueError, match="its group 0 is of other candidates"):
        record.recorded(0, POINTS + 1e-12)


def test_a_link_and_a_pipe_are_refused(tmp_path, path):
    link, pipe = tmp_path / "link", tmp_path / "pipe"
    link.symlink_to(path)
    os.mkfifo(pipe)
    for other in (link, pipe):
        with pytest.raises(OSError, match="not a regular file"):
            Record(other, SEARCH)
