"""`simulate_many`: the results of `simulate` in order, failures by scene, bounded memory, no process left behind."""

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
from functools import partial

import numpy as np
import pytest
from real_processes import wait_until

import vibro_ros
from vibro_ros.simulation.workers import AHEAD
from vibro_ros.solver import event_loop
from vibro_ros.solver.methods import Exact

SHORT = {"duration": 0.05, "rate": 1000.0}


def sweep(count=None, scene="unilateral"):
    """Return scenes of rising guide angle, infinitely many unless a number is given."""
    base = vibro_ros.load_scene(scene)
    numbers = itertools.count() if count is None else range(count)
    return (base.with_parameters({"guide.angle": 0.5 + 1e-6 * number}) for number in numbers)


def running():
    """Return the workers that are alive."""
    return [process for process in multiprocessing.active_children() if process.name == "vibro_ros worker"]


def bits(run):
    """Return the bytes of all samples and events of a run, and its statistics without the computing time."""
    fields = [getattr(run, field.name) for field in dataclasses.fields(run) if field.name != "statistics"]
    counts = {name: value for name, value in run.statistics.items() if name != "wall_time"}
    return [field.tobytes() for field in fields], counts


@pytest.mark.parametrize(("workers", "arguments"), [
    *((workers, {"duration": 0.3, "rate": 200.0}) for workers in (1, 2, 3, None)),
    (2, {"times": np.array([0.0, 0.02, 0.05])}), (2, {**SHORT, "tolerance": 1e-12, "method": "exact"})])
def test_every_result_is_that_of_simulate_and_in_order(workers, arguments):
    """More scenes than workers, of very different length of computation."""
    scenes = [vibro_ros.load_scene(name) for name in ("paper", "no_impact", "device", "rigid", "damped", "no_impact")]
    many = list(vibro_ros.simulate_many(iter(scenes), **arguments, workers=workers))
    assert [bits(run) for run in many] == [bits(vibro_ros.simulate(scene, **arguments)) for scene in scenes]
    assert running() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_results_belong_to_the_user(workers):
    """Changing a result or the given times changes no other result; an array that is kept keeps no others."""
    times = np.linspace(0.0, 0.05, 51)
    expected = bits(vibro_ros.simulate(vibro_ros.load_scene("unilateral"), times=times))
    scenes = itertools.repeat(vibro_ros.load_scene("unilateral"), 12)
    for run in vibro_ros.simulate_many(scenes, times=times, workers=workers):
        assert bits(run) == expected
        times *= 2.0
        for field in dataclasses.fields(vibro_ros.simulation.samples.Samples):
            array = getattr(run, field.name)
            assert array.base is None or array.base.nbytes == array.nbytes, field.name
            array[:] = np.nan
        run.events["time"] = np.nan


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_scenes_without_end_are_taken_as_they_are_needed(workers):
    pulled = 0

    def counted():
        nonlocal pulled
        for scene in sweep():
            pulled += 1
            yield scene

    runs = vibro_ros.simulate_many(counted(), **SHORT, workers=workers)
    assert pulled == 0
    for taken in range(1, 30):
        next(runs)
        assert taken <= pulled <= taken + AHEAD * workers
    runs.close()
    assert running() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_reduced_runs_are_what_the_function_returns_of_each(workers):
    """A lambda can reach another process only by a fork."""
    scenes, weight = list(sweep(7)), 3.0
    reduced = list(vibro_ros.simulate_many(scenes, **SHORT, workers=workers,
                                           reduce=lambda run: weight * run.body_position[-1]))
    assert reduced == [weight * vibro_ros.simulate(scene, **SHORT).body_position[-1] for scene in scenes]


COMMANDS = [(0.0, {"motor_speed": 90.0}), (0.02, {"upper_gap": 0.001, "inclined_gap": -0.001}),
            (0.02, {"motor_speed": 50.0}), (0.0315, {"motor_speed": 120.0}), (7.0, {"motor_speed": 0.0})]


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("scene", ["unilateral", "device"])
def test_commands_are_those_of_a_device(scene, workers):
    """Commands act before samples at their instants, and between samples; those after the last are ignored."""
    times = np.linspace(0.0, 0.05, 51)
    scene = vibro_ros.load_scene(scene)
    device, rows, waiting = vibro_ros.Simulator(scene), [], list(COMMANDS)
    for instant in times:
        while waiting[0][0] <= instant:
            at, command = waiting.pop(0)
            device.advance_to(at)
            device.command(**command)
        device.advance_to(instant)
        rows.append(dataclasses.astuple(device.state))
    events = device.take_events()
    events = events.take(np.argsort(events["time"], kind="stable"))
    for run in vibro_ros.simulate_many([scene, scene], times=times, workers=workers, commands=COMMANDS):
        columns = [getattr(run, field.name) for field in dataclasses.fields(device.state)]
        assert np.array_equal(np.stack(columns, axis=1), rows)
        assert np.array_equal(run.events, events)
        assert bits(run) == bits(vibro_ros.simulate(scene, times=times, commands=iter(COMMANDS)))


@pytest.mark.parametrize(("arguments", "message"), [
    ({"rate": None}, "give duration and rate"), ({"workers": 0}, "workers: 0 is no number of processes"),
    ({"workers": 2.0}, "workers: 2.0"), ({"tolerance": -1.0}, "solver.tolerance: -1 is out of"),
    ({"method": "euler"}, "solver.method: 'euler' is unknown"),
    *[({"commands": wrong}, "commands: give ascending") for wrong in (
        [(0.1, {}), (0.0, {})], [(-0.1, {})], [(float("nan"), {})], {0.1: {}, 0.0: {}})],
    *[({"commands": wrong}, "commands: give the commands by instants .* such as {0.5: {") for wrong in (
        {"motor_speed": 1.0}, {0.5: 3.0}, [0.5], 0.5, [(0.5, "fast")])],
    ({"commands": [(0.0, {"speed": 1.0})]},
     "commands: 'speed' is no command; give motor_speed, upper_gap, inclined_gap")])
def test_wrong_arguments_are_refused_at_the_call(arguments, message):
    with pytest.raises(ValueError, match=message):
        vibro_ros.simulate_many([], **SHORT | arguments)
    if "workers" not in arguments:
        with pytest.raises(ValueError, match=message):
            vibro_ros.simulate(next(sweep()), **SHORT | arguments)


def test_a_mapping_of_commands_is_a_list_of_pairs():
    commands = {0.01: {"motor_speed": 80.0}, 0.02: {"motor_speed": 60.0, "upper_gap": 0.001}}
    mapped, paired, none = (bits(vibro_ros.simulate(next(sweep()), duration=0.1, rate=1000.0, commands=given))
                            for given in (commands, list(commands.items()), ()))
    assert mapped == paired != none


def failing_at(number):
    """Return scenes of which one has a motor speed at which `lost_roots` makes it fail."""
    for index, scene in enumerate(sweep()):
        yield scene.with_parameters({"upper.gap": 0.001, "motor.speed": 7.0}) if index == number else scene


@pytest.fixture
def lost_roots(monkeypatch):
    """Make every run at a motor speed of 7 rad/s fail at its first event; workers are forks and inherit this."""
    advance = Exact.advance

    def lose(stepper, state, times, *rest):
        status, taken, count = advance(stepper, state, times, *rest)
        lost = state.now["drive"]["speed"][0] == 7.0 and len(times)
        return (event_loop.ROOT_LOST if lost else status), taken, count

    monkeypatch.setattr(Exact, "advance", lose)


def ending():
    """Return three scenes and an error."""
    yield from sweep(3)
    raise KeyError("no more")


@pytest.mark.parametrize(("scenes", "arguments", "done", "error", "message"), [
    (partial(failing_at, 9), {}, 9, vibro_ros.SimulationError,
     r"^scene 9 \(unilateral, guide.angle = 0.500009, upper.gap = 0.001, motor.speed = 7.0\): at 0.0.* the search for "
     "a guard's root did not end"),
    (partial(sweep, 2), {"commands": [(0.0, {"motor_speed": 1e9})]}, 0, vibro_ros.SimulationError,
     r"scene 0 \(unilateral\): ValueError: motor.speed: 1e\+09"),
    (partial(sweep, 3), {"reduce": lambda run: (number for number in run.time), "workers": 2}, 0,
     vibro_ros.SimulationError, r"scene 0 .* cannot be handed over: TypeError: .*generator"),
    (lambda: ["paper"], {}, 0, TypeError, "scene 0: 'paper' is not a Scene; vibro_ros.load_scene makes one"),
    (ending, {}, 3, KeyError, "no more")], ids=["root", "command", "result", "name", "iterable"])
@pytest.mark.parametrize("workers", [1, 2])
def test_a_failing_scene_is_named_after_all_results_before_it(
        lost_roots, workers, scenes, arguments, done, error, message):
    runs = vibro_ros.simulate_many(scenes(), **{**SHORT, "workers": workers, **arguments})
    assert [next(runs).time[-1] for _ in range(done)] == done * [0.05]
    with pytest.raises(error, match=message):
        next(runs)
    assert running() == [] and list(runs) == []


def test_workers_work_at_the_same_time():
    """Each worker waits with its first result until four have one; fewer at a time would wait for ever."""
    barrier, met = multiprocessing.get_context("fork").Barrier(4, timeout=60.0), set()

    def meet(_):
        if not met:
            barrier.wait()
            met.add(True)
        return os.getpid()

    pids = list(vibro_ros.simulate_many(sweep(100), times=np.zeros(1), workers=4, reduce=meet))
    assert len(pids) == 100 and len(set(pids)) == 4 and os.getpid() not in pids


def test_a_worker_killed_while_sending_a_result_is_an_error_and_no_hang():
    """Results of 37 MB are being transferred for most of the time."""
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
    """Each process is in the middle of a run of five minutes."""
    runs = vibro_ros.simulate_many(itertools.chain(sweep(1, "no_impact"), sweep()), times=np.array([300.0]), workers=2)
    began = time.monotonic()
    next(runs)
    assert len(running()) == 2
    del runs
    gc.collect()
    assert running() == []
    assert time.monotonic() - began < 20.0


def test_nothing_runs_once_the_last_result_is_there():
    """A caller that counts the scenes, such as zip, never requests one more result, and may keep the iterator."""
    runs = vibro_ros.simulate_many(sweep(12), workers=2, **SHORT)
    for _, _run in zip(range(12), runs, strict=False):
        pass
    assert not running()


INTERRUPTED = """
import os, signal
from vibro_ros.process import entry_point
from vibro_ros.simulation.workers import in_processes
entry_point.interrupt_on_signals()
def swallowing():
    for number in range(100):
        try:
            if number == 3:
                os.kill(os.getpid(), signal.SIGINT)
        except:
            pass
        yield number
items = {items}
try:
    print(len(list(in_processes(abs, items, {workers}))))
except KeyboardInterrupt:
    print("interrupted")
"""
IN_A_FORK = "(os.register_at_fork(before=lambda: os.kill(os.getpid(), signal.SIGINT)), *range(3))[1:]"


@pytest.mark.parametrize(("items", "workers"), [(IN_A_FORK, 2), ("swallowing()", 1), ("swallowing()", 2)],
                         ids=["hook of a fork", "swallowed, 1", "swallowed, 2"])
def test_a_stop_signal_in_a_hook_of_a_fork_or_that_a_library_swallows_is_not_lost(items, workers):
    run = subprocess.run([sys.executable, "-c", INTERRUPTED.format(items=items, workers=workers)], capture_output=True,
                         text=True, timeout=60.0)
    assert (run.returncode, run.stdout) == (0, "interrupted\n"), run.stderr


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
    wait_until(lambda: not any(map(alive, workers)), "the workers' end", 10.0)


def alive(pid):
    """Whether a process runs, and does not merely wait to be reaped."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("workers", [1, 2])
def test_results_that_are_not_kept_need_no_memory(workers):
    """40 runs of 20 000 samples, 3.7 MB each, are taken one by one. In memory are at most the runs that may be ahead of
    the next one, and those being transferred, as bytes and as arrays.
    """
    base = vibro_ros.load_scene("no_impact")
    runs = vibro_ros.simulate_many(itertools.repeat(base, 40), duration=2.0, rate=1e4, workers=workers)
    first = next(runs)
    size = sum(getattr(first, field.name).nbytes for field in dataclasses.fields(first) if field.name != "statistics")
    tracemalloc.start()
    assert sum(1 for _ in runs) == 39
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < ((AHEAD + 2) * workers + 3) * size
