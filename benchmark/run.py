"""`make benchmark`: every program on every problem, into out/benchmark: a table, a page and a chart a problem.

What goes wrong is a result: a crash, a run out of time, numbers that are none, a body that goes the wrong way. Rows are
those of `vibro_ros.accuracy.harness`; programs that do not ship run in processes of their own.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmark import problems, report, rk4_by_hand
from vibro_ros.accuracy.harness import Effort, Problem, Row, rows, run_child
from vibro_ros.accuracy.programs import DEVICE, PLAIN, Answer, Program, Setting, UnableError

ROOT = Path(__file__).resolve().parents[1]
OUTPUT = ROOT / "out" / "benchmark"
#: Programs by name: those that ship, Runge-Kutta 4 by hand, and those of `programs/`.
HERE = DEVICE | {rk4_by_hand.PROGRAM.name: rk4_by_hand.PROGRAM}
NAMES = (*HERE, "heyoka", "cvode", "scipy", "diffrax", "drake", "mujoco", "siconos")
LIMIT, QUICK_LIMIT = 60.0, 30.0  # s, of one run
#: Debian's own Python, where python3-siconos is, unlike what pip brings.
_INTERPRETERS = {"siconos": "/usr/bin/python3"}


def main(words: Sequence[str]) -> int:
    """Run what is asked for, and write table, page and charts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"problems ({', '.join(problems.names())}) and "
                        f"programs ({', '.join(NAMES)}) to run (default: all)")
    parser.add_argument("--quick", action="store_true", help=f"at most {QUICK_LIMIT:g} s a run, not {LIMIT:g}")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder (default: out/benchmark)")
    options = parser.parse_args(words)
    if strange := set(options.names) - {*problems.names(), *NAMES}:
        parser.error(f"{', '.join(sorted(strange))}: neither a problem nor a program of the benchmark")
    chosen = [name for name in problems.names() if name in options.names] or problems.names()
    programs = [program(name) for name in NAMES if name in options.names or not {*NAMES} & {*options.names}]
    options.output.mkdir(parents=True, exist_ok=True)
    effort = Effort(repeats=3, limit=QUICK_LIMIT if options.quick else LIMIT)
    found: list[Row] = []
    begun = time.monotonic()
    try:
        for number, name in enumerate(chosen):
            for one in programs:
                for row in rows(problems.load(name), one, effort):
                    found.append(row)
                    print(f"{time.monotonic() - begun:5.0f} s  problem {number + 1} of {len(chosen)}  {described(row)}",
                          flush=True)
    except KeyboardInterrupt:
        print("benchmark: stopped; what was measured is kept", file=sys.stderr)
    report.write(options.output, found, machine())
    print(f"benchmark: {options.output / report.PAGE}")
    return 0


def program(name: str) -> Program:
    """The program of that name; a child tells the settings of one that does not ship, unless it is absent."""
    if name in HERE:
        return HERE[name]
    # PYTHONPATH, because Debian's Python has nothing of this repository installed
    command = ("env", f"PYTHONPATH={ROOT}", _INTERPRETERS.get(name, sys.executable), "-m", "benchmark.child", name)
    absent = Program(name, (Setting(0.0, "", PLAIN),), _not_here, command=command)
    try:
        found = run_child(command, LIMIT)
    except subprocess.TimeoutExpired:
        return absent
    if found.returncode:
        return absent
    return absent._replace(settings=tuple(Setting(*one) for one in json.loads(found.stdout.splitlines()[-1])))


def _not_here(problem: Problem, setting: Setting) -> Callable[[], Answer]:
    raise UnableError("it runs in a process of its own alone")


def described(row: Row) -> str:
    """A row in a line of words."""
    text = f"{row.problem} {row.program} ({row.use}: {row.setting}): {row.outcome}"
    if row.share_error == row.share_error:
        text += f", error {row.share_error:.1e} at {row.cost:.3g}"
    return text + (f" ({row.note})" if row.note else "")


def machine() -> str:
    """What costs depend on."""
    return f"Python {platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
