"""`make benchmark`: run every program on every problem; write a table, a page and a chart for each problem into
out/benchmark.

A failure is a result, too: a crash, a run out of time, NaN, a body that goes the wrong way. Rows are those of
`vibro_lab.accuracy.harness`; programs that do not come with the package run in processes of their own.
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
from vibro_lab.accuracy.harness import Effort, Problem, Row, rows, run_child
from vibro_lab.accuracy.programs import DEVICE, PLAIN, Answer, Program, Setting, UnableError

ROOT = Path(__file__).resolve().parents[2]
OUTPUT = ROOT / "out" / "benchmark"
#: Programs by name: those of the package, Runge-Kutta 4 by hand, and those of `programs/`.
HERE = DEVICE | {rk4_by_hand.PROGRAM.name: rk4_by_hand.PROGRAM}
NAMES = (*HERE, "heyoka", "cvode", "scipy", "diffrax", "drake", "mujoco", "siconos")
LIMIT, QUICK_LIMIT = 60.0, 30.0  # s, of one run
#: Debian's own Python, for which Debian has the package python3-siconos; pip has no Siconos.
_INTERPRETERS = {"siconos": "/usr/bin/python3"}


def main(words: Sequence[str]) -> int:
    """Run the programs and problems that the command line names, and write table, page and charts."""
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
    """Return the program of that name. For a program outside the package a child process prints the settings, if the
    program is installed.
    """
    if name in HERE:
        return HERE[name]
    # PYTHONPATH, because this repository is not installed in Debian's Python
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
    """Return a row as one line of text."""
    text = f"{row.problem} {row.program} ({row.use}: {row.setting}): {row.outcome}"
    if row.share_error == row.share_error:
        text += f", error {row.share_error:.1e} at {row.cost:.3g}"
    return text + (f" ({row.note})" if row.note else "")


def machine() -> str:
    """Return a description of the machine and the versions on which costs depend."""
    return f"Python {platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
