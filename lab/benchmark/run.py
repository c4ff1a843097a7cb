"""`make benchmark` and `make accuracy`: run programs on problems and on scenes, and write rows, pages and charts.

Problems have reference values of 60 digits, and all programs try them; scenes are the shipped robots, which the
device's own methods, heyoka and Runge-Kutta by hand simulate. All rows are those of `vibro_lab.accuracy.harness`, and
`report` makes both pages from them. A failure is a result, too: a crash, a run out of time, NaN, a body that goes the
wrong way. A run replaces only the rows that it measures again, so that the pages can be made in parts.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from benchmark import problems, report, rk4_by_hand
from benchmark.costs import SCENES
from vibro_lab.accuracy.accuracy import measure
from vibro_lab.accuracy.harness import Effort, Problem, Row, read_rows, row_writer, rows, run_child
from vibro_lab.accuracy.programs import DEVICE, PLAIN, Answer, Program, Setting, UnableError
from vibro_lab.accuracy.scene_rows import OWN_CHECK

ROOT = Path(__file__).resolve().parents[2]
OUTPUT = ROOT / "out" / "benchmark"
#: Programs by name: those of the package, Runge-Kutta 4 by hand, and those of `programs/`.
HERE = DEVICE | {rk4_by_hand.PROGRAM.name: rk4_by_hand.PROGRAM}
NAMES = (*HERE, "heyoka", "cvode", "scipy", "diffrax", "drake", "mujoco", "siconos")
GROUPS = {"problems": problems.names(), "scenes": sorted(SCENES)}
LIMIT, QUICK_LIMIT = 60.0, 30.0  # s, of one run
#: Debian's own Python, for which Debian has the package python3-siconos; pip has no Siconos.
_INTERPRETERS = {"siconos": "/usr/bin/python3"}
#: Effort of a scene, and that of the scene whose mean speeds by finer steps are shown.
ON_SCENES = Effort(repeats=3, patience_for_averages=3.0)
CLOSER = {report.CLOSER: replace(ON_SCENES, starts=64, patience_for_averages=60.0)}


def main(words: Sequence[str]) -> int:
    """Run the programs, problems and scenes that the command line names, and write rows, pages and charts."""
    known = (*GROUPS, *GROUPS["problems"], *GROUPS["scenes"], *NAMES)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="problems, scenes and programs to run: of "
                        f"{', '.join(known)} (default: all problems by all programs)")
    parser.add_argument("--quick", action="store_true", help=f"at most {QUICK_LIMIT:g} s a run, not {LIMIT:g}")
    parser.add_argument("--output", type=Path, default=OUTPUT, help="folder (default: out/benchmark)")
    options = parser.parse_args(words)
    if unknown := set(options.names) - set(known):
        parser.error(f"{', '.join(sorted(unknown))}: no problem, no scene and no program of the benchmark")
    chosen = {group: [name for name in members if {name, group} & {*options.names}]
              for group, members in GROUPS.items()}
    if not any(chosen.values()):
        chosen["problems"] = GROUPS["problems"]
    effort = Effort(repeats=3, limit=QUICK_LIMIT if options.quick else LIMIT)
    programs = [name for name in NAMES if name in options.names or not {*NAMES} & {*options.names}]
    try:
        for name in chosen["problems"]:
            _keep(options.output / report.PROBLEM_ROWS, rows_of_problem(name, programs, effort))
        for name in chosen["scenes"]:
            _keep(options.output / report.SCENE_ROWS, rows_of_scene(name))
    except KeyboardInterrupt:
        print("benchmark: stopped; what was measured is kept", file=sys.stderr)
    for group, file in (("problems", report.PROBLEM_ROWS), ("scenes", report.SCENE_ROWS)):
        if chosen[group] and (options.output / file).exists():
            print("\n".join(f"benchmark: {page}" for page in report.publish(options.output, file)))
    return 0


def rows_of_problem(name: str, programs: Sequence[str], effort: Effort) -> Iterator[Row]:
    """Yield the rows of a problem by the programs of the names `programs`."""
    began = time.monotonic()
    for program_name in programs:
        for row in rows(problems.load(name), program(program_name), effort):
            print(f"{time.monotonic() - began:5.0f} s  {described(row)}", flush=True)
            yield row


def rows_of_scene(name: str) -> Iterator[Row]:
    """Yield the rows of a scene by the programs that simulate scenes; heyoka checks the reference."""
    from benchmark.programs.heyoka import ON_SCENES as HEYOKA  # heyoka, which is not installed with the package

    checks = [(HEYOKA, HEYOKA.settings[-1]), OWN_CHECK]
    yield from measure(name, HERE | {HEYOKA.name: HEYOKA}, CLOSER.get(name, ON_SCENES), lambda row: None, checks)


def _keep(file: Path, measured: Iterator[Row]) -> None:
    """Write rows into a file in place of the earlier rows of the same problem, of a benchmark's problem by program."""
    file.parent.mkdir(parents=True, exist_ok=True)
    earlier, new = read_rows(file) if file.exists() else [], list[Row]()
    try:
        for row in measured:
            new.append(row)
    finally:
        def key(row: Row) -> tuple[str, str]:
            return row.problem, row.program if file.name == report.PROBLEM_ROWS.name else ""

        measured_keys = {key(row) for row in new}
        kept = [*(row for row in earlier if key(row) not in measured_keys), *new]
        order = list(dict.fromkeys(row.program for row in kept))
        if file.name == report.PROBLEM_ROWS.name:
            kept.sort(key=lambda row: (row.problem, order.index(row.program)))
        else:
            kept.sort(key=lambda row: row.problem)
        with row_writer(file) as write:
            for row in kept:
                write(row)


def program(name: str) -> Program:
    """Return the program of that name. For a program outside the package a child process prints the settings, if the
    program is installed.
    """
    if name in HERE:
        return HERE[name]
    # PYTHONPATH, because this repository is not installed in Debian's Python
    command = ("env", f"PYTHONPATH={ROOT / 'lab'}:{ROOT}", _INTERPRETERS.get(name, sys.executable), "-m",
               "benchmark.child", name)
    absent = Program(name, (Setting(0.0, "", PLAIN),), _not_here, command=command)
    try:
        process = run_child(command, LIMIT)
    except subprocess.TimeoutExpired:
        return absent
    if process.returncode:
        return absent
    return absent._replace(settings=tuple(Setting(*cells) for cells in json.loads(process.stdout.splitlines()[-1])))


def _not_here(problem: Problem, setting: Setting) -> Callable[[], Answer]:
    raise UnableError("it runs in a process of its own alone")


def described(row: Row) -> str:
    """Return a row as one line of text."""
    text = f"{row.problem} {row.program} ({row.use}: {row.setting}): {row.outcome}"
    if row.share_error == row.share_error:
        text += f", error {row.share_error:.1e} at {row.cost:.3g} s/s"
    return text + (f" ({row.note})" if row.note else "")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
