"""Provenance: the data that a recording must store so that its run can be computed again, bit for bit."""

import functools
import hashlib
import json
import pkgutil
import platform
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from vibro_ros.model.parameters import SCENE_PARAMETERS, Value
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene

# Subpackages and modules whose text decides the numbers that a robot publishes.
_PACKAGE = "vibro_ros"
_ROOMS = ("model", "sensors", "solver")
_MODULES = (
    *(("messages", name) for name in ("codec", "frames", "robot_messages", "topics", "urdf")),
    *(("simulation", name) for name in (
        "actuators", "checkpoint", "crank_angle", "disturbances", "given_state", "motion", "readout", "samples",
        "simulator")))


def provenance(parameters: Mapping[str, Value], start: int) -> dict[str, str]:
    """Return all that decides the bits of a run besides its commands, as custom data of a bag.

    `parameters` are those of the device and its scene: ``sensors.seed`` decides all that is random in a run, the errors
    of the sensors. `start` is the ROS time [ns] of simulated time 0.
    """
    method = parameters["solver.method"]
    solver = method if method == "exact" else f"{method}, step {parameters['solver.step']:g} s"
    return {"parameters": json.dumps(dict(parameters)), "solver": solver, **software(), "tables": tables(parameters),
            "start": str(start), "seed": str(int(parameters["sensors.seed"]))}


@functools.cache
def software() -> dict[str, str]:
    """Return the software that decides bits; with equal entries and equal `tables`, bits are equal.

    `version` of this package; `platform`; `sources`, a digest of the modules that decide the bits.
    """
    try:
        installed = version("vibro_ros")
    except PackageNotFoundError:  # run from a source folder that was never installed
        installed = "unknown"
    return {"version": installed, "platform": f"{platform.machine()}, Python {platform.python_version()}, "
                                               f"numpy {np.__version__}",
            "sources": _digest(_sources())}


def tables(parameters: Mapping[str, Value]) -> str:
    """Return a digest of the tables to which the scene in `parameters` compiles here: sines, cosines, rates and
    solutions of linear equations, whose bits are the same on every computer."""
    names = {parameter.name for parameter in SCENE_PARAMETERS}
    system = compile_scene(Scene("", {name: value for name, value in parameters.items() if name in names})).system
    return _digest(array.tobytes() for array in _arrays(system))


def _arrays(table: tuple) -> Iterator[np.ndarray]:
    for entry in table:
        if isinstance(entry, tuple):
            yield from _arrays(entry)
        else:
            yield np.ascontiguousarray(entry)


def _sources() -> Iterator[bytes]:
    """Yield names and texts of the modules that decide the bits, independent of the kind of line ends."""
    of_rooms = [(room, name) for room in _ROOMS for name in sorted(
        module.name for module in pkgutil.iter_modules(import_module(f"{_PACKAGE}.{room}").__path__))
        if not name.startswith("core")]  # the compiled kernels
    for room, name in (*((room, f"{name}.py") for room, name in (*of_rooms, *_MODULES)), ("solver", "vectors.h")):
        text = pkgutil.get_data(f"{_PACKAGE}.{room}", name) or b""
        yield from (name.encode(), b"\n".join(text.splitlines()))


def _digest(parts: Iterator[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(b"%d " % len(part))
        digest.update(part)
    return digest.hexdigest()[:16]
