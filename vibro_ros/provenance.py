"""Where numbers come from: what a recording must say for somebody to compute it again, bit for bit."""

import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

import numba
import numpy as np

from vibro_ros.model.parameters import Value

NO_SEED = "none"
"""Seed of a run: nothing in the device is random."""


def provenance(parameters: Mapping[str, Value], start: int) -> dict[str, str]:
    """All that fixes the bits of a run besides its commands, as custom data of a bag.

    Parameters
    ----------
    parameters : mapping
        Every parameter of the device and its scene.
    start : int
        ROS time [ns] of simulated time 0.
    """
    return {"parameters": json.dumps(dict(parameters)), "solver": _solver(parameters), **software(),
            "start": str(start), "seed": NO_SEED}


def _solver(parameters: Mapping[str, Value]) -> str:
    """The method that ran, and its step if it has one."""
    method = parameters["solver.method"]
    return method if method == "exact" else f"{method}, step {parameters['solver.step']:g} s"


def software() -> dict[str, str]:
    """`version` of this package and `platform` that it runs on: between two of them bits may differ."""
    return {"version": _version(), "platform": f"{platform.machine()}, Python {platform.python_version()}, "
                                               f"numpy {np.__version__}, numba {numba.__version__}"}


def _version() -> str:
    try:
        return version("vibro_ros")
    except PackageNotFoundError:  # run from a source folder that was never installed
        return "unknown"
