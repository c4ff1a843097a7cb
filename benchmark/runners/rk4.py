"""Runge-Kutta 4 of fixed step, compiled by numba; 1e-5 s is the unit of cost."""

from importlib.metadata import version as _version

import numpy as np

from benchmark.contract import PLAIN, TUNED, Answer, Setting
from benchmark.equations import machine, rk4, start

SETTINGS = [Setting(PLAIN if step > 5e-6 else TUNED, f"{step:g} s", step) for step in (1e-4, 1e-5, 1e-6, 1e-7)]


def version():
    """What compiles it."""
    return f"numba {_version('numba')}"


def prepare(problem, setting):
    """A run with a step that divides the sampling period."""
    numbers, times = machine(problem), problem.times
    per_row = round(times[1] / setting.value)

    def run():
        rows = np.empty((len(times), 8))
        rk4(start(problem), numbers, times[1] / per_row, per_row, rows)
        return Answer(rows)

    rk4(start(problem), numbers, 1e-6, 1, np.empty((2, 8)))
    return run
