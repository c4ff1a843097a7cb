"""Run one program on one problem in a process of its own: `python -m benchmark.child PROGRAM PROBLEM SETTING LIMIT`.

`SETTING` is the index of one of the program's settings; without further arguments the process prints these settings. A
run that takes longer than `LIMIT` [s], not counting compilation, ends the process by SIGALRM. The last line of the
output is the result in JSON.
"""

import json
import signal
import sys
from collections.abc import Callable
from importlib import import_module

from benchmark.problems import load
from vibro_lab.accuracy.harness import Effort, measure_setting, print_row
from vibro_lab.accuracy.programs import Answer, Program

#: Of a run: the machine's noise matters less than that ten programs come to an end.
EFFORT = Effort(repeats=3)


def limited(prepare: Callable[..., Callable[[], Answer]], limit: float) -> Callable[..., Callable[[], Answer]]:
    """Return `prepare` with a limit: a run that takes longer than `limit` [s] ends this process by SIGALRM. Compilation
    has no limit.
    """
    def prepared(problem, setting):
        run = prepare(problem, setting)

        def limited_run():
            signal.setitimer(signal.ITIMER_REAL, limit)
            answer = run()
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            return answer

        return limited_run

    return prepared


def main(name: str, *arguments: str) -> None:
    """Print the settings of a program, or the row of one of them."""
    module = import_module(f"benchmark.programs.{name}")
    if not arguments:
        print(json.dumps(module.SETTINGS), flush=True)
        return
    problem, setting, limit = arguments
    program = Program(name, module.SETTINGS, limited(module.prepare, float(limit)), module.version)
    print_row(measure_setting(load(problem), program, program.settings[int(setting)], EFFORT))


if __name__ == "__main__":
    main(*sys.argv[1:])
