"""Workers of many runs: a failure is named, results are not kept, and however a run ends no process is left."""

import dataclasses
import gc
import itertools
import multiprocessing
import os
import signal
import subprocess
import sys
import time
import tracemalloc

import numpy as np
import pytest
from many_scenes import SHORT, running, sweep

import vibro_ros
from vibro_ros.solver import event_loop
from vibro_ros.solver.methods import Exact


def failing_at(number):
    """Scenes of which one differs from the others, and fails where `lost_roots` makes it."""
    for index, scene in enumerate(sweep()):
        yield scene.with_parameters({"upper.gap": 0.001, "motor.speed": 7.0}) if index == number else scene


@pytest.fixture
def lost_roots(monkeypatch):
    """At a motor speed of 7 rad/s every run ends at its first event: workers are forks and inherit it."""
    advance = Exact.advance

    def lose(stepper, state, times, *rest):
        status, taken, count = advance(stepper, state, times, *rest)
        lost = state.now["drive"]["speed"][0] == 7.0 and len(times)
        return (event_loop.ROOT_LOST if lost else status), taken, count

    monkeypatch.setattr(Exact, "advance", lose)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_scene_that_fails_is_named_and_those_before_it_are_not_lost(lost_roots, workers):
    runs = vibro_ros.simulate_many(failing_at(9), **SHORT, workers=workers)
    assert [next(runs).time[-1] for _ in range(9)] == 9 * [0.05]
    with pytest.raises(vibro_ros.SimulationError) as error:
        next(runs)
    assert str(error.value).startswith("scene 9 (unilateral, guide.angle = 0.500009, upper.gap = 0.001, "
                                       "motor.speed = 7.0): at 0.0")
    assert "the search for a guard's root did not end" in str(error.value)
    assert running() == []
    assert list(runs) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_the_iterable_comes_after_the_results_before_it(workers):
    def ending():
        yield from sweep(3)
        raise KeyError("no more")

    runs = vibro_ros.simulate_many(ending(), **SHORT, workers=workers)
    assert len([next(runs) for _ in range(3)]) == 3
    with pytest.raises(KeyError, match="no more"):
        next(runs)
    assert running() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_a_name_is_no_scene(workers):
    with pytest.raises(TypeError, match="scene 0: 'paper' is not a Scene; vibro_ros.load_scene makes one"):
        next(vibro_ros.simulate_many(["paper"], **SHORT, workers=workers))
    assert running() == []


def test_a_result_that_cannot_be_handed_over_is_an_error_that_says_so():
    runs = vibro_ros.simulate_many(sweep(3), **SHORT, workers=2, reduce=lambda run: (number for number in run.time))
    with pytest.raises(vibro_ros.SimulationError, match=r"scene 0 .* cannot be handed over: TypeError: .*generator"):
        list(runs)
    assert running() == []


def test_a_worker_that_is_killed_is_an_error_and_no_hang():
    runs = vibro_ros.simulate_many(sweep(), **SHORT, workers=2)
    next(runs)
    assert len(running()) == 2
    os.kill(running()[0].pid, signal.SIGKILL)
    ended = r"scene \d+ \(unilateral.*\): its process ended with exit code -9"
    with pytest.raises(vibro_ros.SimulationError, match=ended):
        for _ in range(20):
            next(runs)
    assert running() == []


def test_workers_work_at_the_same_time_and_evenly():
    """Each waits with its result until four have one, so that fewer at a time would wait for ever."""
    barrier = multiprocessing.get_context("fork").Barrier(4, timeout=60.0)

    def meet(_):
        barrier.wait()
        return os.getpid()

    pids = list(vibro_ros.simulate_many(sweep(100), times=np.zeros(1), workers=4, reduce=meet))
    assert [pids.count(pid) for pid in set(pids)] == [25, 25, 25, 25]
    assert os.getpid() not in pids


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_the_function_names_the_scene(workers):
    runs = vibro_ros.simulate_many(sweep(3), **SHORT, workers=workers, reduce=lambda run: 1 / 0)
    with pytest.raises(vibro_ros.SimulationError, match=r"scene 0 \(unilateral\): ZeroDivisionError: division by zero"):
        next(runs)


def test_a_worker_that_is_killed_while_it_hands_over_is_an_error_and_no_hang():
    """Results of 37 MB: most of the time they are under way."""
    for delay in (0.02, 0.05, 0.1):
        runs = vibro_ros.simulate_many(sweep(scene="no_impact"), duration=2.0, rate=1e5, workers=2)
        next(runs)
        time.sleep(delay)  # while nobody takes what the workers have
        os.kill(running()[0].pid, signal.SIGKILL)
        with pytest.raises(vibro_ros.SimulationError, match="its process ended with exit code -9"):
            for _ in range(20):
                next(runs)
        assert running() == []


def test_an_iterator_that_is_dropped_leaves_nothing_running():
    """A run of five minutes is under way in each process."""
    runs = vibro_ros.simulate_many(itertools.chain(sweep(1, "no_impact"), sweep()), times=np.array([300.0]), workers=2)
    began = time.monotonic()
    next(runs)
    assert len(running()) == 2
    del runs
    gc.collect()
    assert running() == []
    assert time.monotonic() - began < 20.0


def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    program = ("import itertools, os, signal, multiprocessing, vibro_ros\n"
               "scenes = itertools.repeat(vibro_ros.load_scene('no_impact'))\n"
               "runs = vibro_ros.simulate_many(scenes, duration=0.01, rate=1000.0, workers=3)\n"
               "next(runs)\n"
               "print(*(child.pid for child in multiprocessing.active_children()), flush=True)\n"
               "os.kill(os.getpid(), signal.SIGKILL)\n")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    workers = [int(word) for word in done.stdout.split()]
    assert (done.returncode, len(workers)) == (-signal.SIGKILL, 3), done.stderr
    deadline = time.monotonic() + 10.0
    while any(alive(pid) for pid in workers) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not any(alive(pid) for pid in workers)


def alive(pid):
    """Whether a process runs, and does not merely wait to be reaped."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("workers", [1, 2])
def test_results_that_are_not_kept_need_no_memory(workers):
    """40 runs of 20 000 samples, 3.7 MB each, taken one by one: no more at a time than those that wait."""
    base = vibro_ros.load_scene("no_impact")
    runs = vibro_ros.simulate_many(itertools.repeat(base, 40), duration=2.0, rate=1e4, workers=workers)
    first = next(runs)
    size = sum(getattr(first, field.name).nbytes for field in dataclasses.fields(first) if field.name != "statistics")
    tracemalloc.start()
    assert sum(1 for _ in runs) == 39
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < (4 * workers + 4) * size  # those ahead; the one being taken, as bytes and as arrays
