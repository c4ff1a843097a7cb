"""One program on one problem with one setting, in a process of its own: `python -m benchmark.child RUNNER PROBLEM N`.

Without problem and number: kind and label of each of its settings.

The last line of its output is the result in JSON. Its cost is the median of runs for `SPENT` s, after a short one that
does not count; it is a ratio to the unit, which is timed just before and after in the same process.
"""

import json
import math
import statistics
import sys
import time
from dataclasses import replace
from importlib import import_module

from benchmark.contract import TUNED, Setting, UnableError
from benchmark.problems import Problem, load

#: Time [s] that runs are repeated for, and how often at most.
SPENT, MOST = 0.3, 15
UNIT_STEP = 1e-5  # s


def measure(runner: str, problem_name: str, number: int) -> dict:
    """The result: `states`, `events`, `version`, `cost` in units and in `seconds`, or `unable` with the reason."""
    module = import_module(f"benchmark.runners.{runner}")
    problem, setting = load(problem_name), module.SETTINGS[number]
    try:
        module.prepare(replace(problem, times=problem.times[:2]), setting)()  # compiles what is compiled at first use
        run = module.prepare(problem, setting)
        units = [unit_seconds(problem)]
        costs: list[float] = []
        while sum(costs) < SPENT and len(costs) < MOST:
            began = time.perf_counter()
            answer = run()
            costs.append(time.perf_counter() - began)
        units.append(unit_seconds(problem))
    except UnableError as error:
        return {"unable": str(error), "version": module.version()}
    states = [[number if math.isfinite(number) else None for number in map(float, row)] for row in answer.states]
    return {"states": states, "events": answer.events, "version": module.version(),
            "cost": statistics.median(costs) / statistics.mean(units) if all(units) else None,
            "seconds": statistics.median(costs)}


def unit_seconds(problem: Problem) -> float:
    """Wall time [s] of the unit, Runge-Kutta 4 of `UNIT_STEP` on this problem; 0 where there is no numba."""
    try:
        from benchmark.runners import rk4
    except ModuleNotFoundError:
        return 0.0
    run, times = rk4.prepare(problem, Setting(TUNED, "", UNIT_STEP)), []
    for _ in range(3):
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


if __name__ == "__main__":
    asked = sys.argv[1:]
    print(json.dumps(measure(asked[0], asked[1], int(asked[2])) if asked[1:] else
                     [setting[:2] for setting in import_module(f"benchmark.runners.{asked[0]}").SETTINGS]), flush=True)
