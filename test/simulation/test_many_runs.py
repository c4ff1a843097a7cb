"""Many scenes at once: the same results, in order, no more of them kept than asked for."""

import dataclasses
import itertools

import numpy as np
import pytest
from many_scenes import SHORT, bits, running, sweep

import vibro_ros
from vibro_ros.simulation import processes


@pytest.mark.parametrize("workers", [1, 2, 3, None])
def test_every_result_is_that_of_simulate_and_in_order(workers):
    """More scenes than workers, of very different length of computation."""
    scenes = [vibro_ros.load_scene(name) for name in ("paper", "no_impact", "device", "rigid", "damped", "no_impact")]
    many = list(vibro_ros.simulate_many(iter(scenes), duration=0.3, rate=200.0, workers=workers))
    assert [bits(run) for run in many] == [bits(vibro_ros.simulate(scene, duration=0.3, rate=200.0))
                                           for scene in scenes]
    assert running() == []


def test_results_are_in_order_when_a_later_one_is_ready_first():
    first, *others = sweep(20, "no_impact")
    slow = first.with_parameters({"motor.speed": 500.0, "effects.upper_contact": "compliant", "upper.gap": -0.005})
    runs = list(vibro_ros.simulate_many([slow, *others], duration=3.0, rate=10.0, workers=3))
    assert runs[0].statistics["steps"] > 5 * runs[1].statistics["steps"]
    assert [run.motor_speed[0] for run in runs] == [500.0] + 19 * [100.0]


@pytest.mark.parametrize("arguments", [
    {"times": np.array([0.0, 0.02, 0.05])}, {**SHORT, "tolerance": 1e-12, "method": "exact"}])
def test_arguments_of_simulate(arguments):
    scenes = list(sweep(3))
    for scene, run in zip(scenes, vibro_ros.simulate_many(scenes, **arguments, workers=2), strict=True):
        assert bits(run) == bits(vibro_ros.simulate(scene, **arguments))


@pytest.mark.parametrize("workers", [1, 2])
def test_results_belong_to_the_user(workers):
    """Who writes to one, or to the times that he has given, changes no other; who keeps an array keeps no others."""
    times = np.linspace(0.0, 0.05, 51)
    wanted = bits(vibro_ros.simulate(vibro_ros.load_scene("unilateral"), times=times))
    scenes = itertools.repeat(vibro_ros.load_scene("unilateral"), 12)
    for run in vibro_ros.simulate_many(scenes, times=times, workers=workers):
        assert bits(run) == wanted
        times *= 2.0
        for field in dataclasses.fields(vibro_ros.simulation.samples.Samples):
            array = getattr(run, field.name)
            assert array.base is None, field.name
            array[:] = np.nan
        run.events["time"] = np.nan


@pytest.mark.parametrize("workers", [1, 2])
def test_no_times_no_samples(workers):
    runs = vibro_ros.simulate_many(sweep(5), times=np.empty(0), workers=workers)
    assert [(len(run.time), len(run.body_position), len(run.events)) for run in runs] == 5 * [(0, 0, 0)]


@pytest.mark.parametrize(("arguments", "message"), [
    ({"duration": 1.0}, "give duration and rate"), ({**SHORT, "workers": 0}, "workers: 0 is no number of processes"),
    ({**SHORT, "workers": 2.0}, "workers: 2.0"), ({**SHORT, "tolerance": -1.0}, "solver.tolerance: -1 is out of"),
    ({**SHORT, "method": "euler"}, "solver.method: 'euler' is unknown")])
def test_wrong_arguments_are_refused_at_the_call(arguments, message):
    with pytest.raises(ValueError, match=message):
        vibro_ros.simulate_many([], **arguments)


@pytest.mark.parametrize("workers", [1, 2])
def test_no_scenes_no_results(workers):
    assert list(vibro_ros.simulate_many([], **SHORT, workers=workers)) == []


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_scenes_without_end_are_taken_as_they_are_needed(workers, monkeypatch):
    """Not even while a busy machine holds one process up: what may be taken then is tested beside `in_processes`."""
    monkeypatch.setattr(processes, "WAITING", 0)
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
        assert taken <= pulled <= taken + 4 * workers
    runs.close()
    assert running() == []


@pytest.mark.parametrize("workers", [1, 2])
def test_reduced_runs_are_what_the_function_returns_of_each(workers):
    """A function without a name can be no other way in another process than by a fork."""
    scenes, weight = list(sweep(7)), 3.0
    found = list(vibro_ros.simulate_many(scenes, **SHORT, workers=workers,
                                         reduce=lambda run: weight * run.body_position[-1]))
    assert found == [weight * vibro_ros.simulate(scene, **SHORT).body_position[-1] for scene in scenes]


COMMANDS = [(0.0, {"motor_speed": 90.0}), (0.02, {"upper_gap": 0.001, "inclined_gap": -0.001}),
            (0.02, {"motor_speed": 50.0}), (0.0315, {"motor_speed": 120.0}), (7.0, {"motor_speed": 0.0})]


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("scene", ["unilateral", "device"])
def test_commands_are_those_of_a_device(scene, workers):
    """Given before the samples at their instants, between samples as well; what comes after the last is left out."""
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


@pytest.mark.parametrize(("commands", "message"), [
    ([(0.1, {}), (0.0, {})], "commands: give ascending"), ([(-0.1, {})], "commands: give ascending"),
    ([(float("nan"), {})], "commands: give ascending"),
    ([(0.0, {"speed": 1.0})], "commands: 'speed' is no command; give motor_speed, upper_gap, inclined_gap")])
def test_commands_that_make_no_sense_are_refused_at_the_call(commands, message):
    with pytest.raises(ValueError, match=message):
        vibro_ros.simulate_many([], **SHORT, commands=commands)
    with pytest.raises(ValueError, match=message):
        vibro_ros.simulate(next(sweep()), **SHORT, commands=commands)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_command_beyond_its_limit_names_the_scene(workers):
    runs = vibro_ros.simulate_many(sweep(2), **SHORT, workers=workers, commands=[(0.0, {"motor_speed": 1e9})])
    with pytest.raises(vibro_ros.SimulationError, match=r"scene 0 \(unilateral\): ValueError: motor.speed: 1e\+09"):
        next(runs)
