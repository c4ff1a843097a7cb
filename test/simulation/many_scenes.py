"""Scenes for many runs at once, the bits of a result, and the workers that are alive."""

import dataclasses
import itertools
import multiprocessing

import vibro_ros

SHORT = {"duration": 0.05, "rate": 1000.0}


def sweep(count=None, scene="unilateral"):
    """Scenes of rising guide angle; without end unless counted."""
    base = vibro_ros.load_scene(scene)
    numbers = itertools.count() if count is None else range(count)
    return (base.with_parameters({"guide.angle": 0.5 + 1e-6 * number}) for number in numbers)


def running():
    """Workers that are alive."""
    return [process for process in multiprocessing.active_children() if process.name == "vibro_ros worker"]


def bits(run):
    fields = [getattr(run, field.name) for field in dataclasses.fields(run) if field.name != "statistics"]
    counts = {name: value for name, value in run.statistics.items() if name != "wall_time"}
    return [field.tobytes() for field in fields], counts
