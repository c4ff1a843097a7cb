"""Jobs of unequal length: a long one stops no other process, and what waits for it is bounded."""

import itertools
import multiprocessing
import time

import numpy as np
import pytest

from vibro_ros.simulation import processes
from vibro_ros.simulation.processes import in_processes

PATIENCE = 60.0  # [s] until a worker that waits for the others gives up
RESULT = 1000  # numbers


@pytest.fixture
def others():
    """Number of jobs that are done besides the first, in all processes."""
    return multiprocessing.get_context("fork").Value("i", 0)


def first_waits(others, enough, patience):
    """A function of numbered items whose item 0 waits until `enough` others are done, and says how many were."""
    def work(item):
        if item > 0:
            with others.get_lock():
                others.value += 1
            return np.full(RESULT, float(item))
        deadline = time.monotonic() + patience
        while others.value < enough and time.monotonic() < deadline:
            time.sleep(0.001)
        return others.value
    return work


@pytest.mark.parametrize("workers", [2, 3])
def test_a_long_job_does_not_stop_the_others(others, workers):
    """Its result is the first that is due. If only four items a process were ahead, it would wait for ever."""
    jobs = in_processes(first_waits(others, 50, PATIENCE), range(60), workers)
    assert next(jobs).outcome() >= 50
    assert [job.outcome()[0] for job in jobs] == list(range(1, 60))


def test_the_results_that_wait_for_a_long_job_are_bounded(others, monkeypatch):
    """Without the bound the other process would go on at once to any number."""
    monkeypatch.setattr(processes, "_LEAST_SIZE", 1)
    monkeypatch.setattr(processes, "WAITING", 40 * 8 * RESULT)
    jobs = in_processes(first_waits(others, 200, 1.0), itertools.count(), 2)
    done = next(jobs).outcome()
    jobs.close()
    assert 30 < done <= 40 + 2 * 2
