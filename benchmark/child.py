"""One program on one problem with one setting, in a process of its own: `python -m benchmark.child PROGRAM PROBLEM N`.

Without problem and number: the settings of the program. The last line of its output is the result in JSON.
"""

import json
import sys
from importlib import import_module

from benchmark.problems import load
from vibro_ros.accuracy.harness import Effort, measured, print_row
from vibro_ros.accuracy.programs import Program

#: Of a run: the machine's noise matters less than that ten programs come to an end.
EFFORT = Effort(repeats=3)

if __name__ == "__main__":
    name, *asked = sys.argv[1:]
    module = import_module(f"benchmark.programs.{name}")
    program = Program(name, module.SETTINGS, module.prepare, module.version)
    if asked:
        print_row(measured(load(asked[0]), program, program.settings[int(asked[1])], EFFORT))
    else:
        print(json.dumps(program.settings), flush=True)
