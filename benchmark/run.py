"""`make benchmark`: every program on every problem, each run in a process of its own, into out/benchmark/results.json.

What goes wrong is a result: a crash, a run out of time, numbers that are none, a body that goes the wrong way. Costs
are ratios to Runge-Kutta 4 of 1e-5 s, compiled, which is timed on the same problem in each of the processes.
"""

import argparse
import json
import math
import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmark import problems
from benchmark.child import unit_seconds
from benchmark.contract import DIVERGED, FALLS, PLAIN

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "out" / "benchmark" / "results.json"
RUNNERS = ("exact", "rk4", "heyoka", "cvode", "scipy", "diffrax", "drake", "mujoco", "siconos")
LIMIT = 60.0  # s, of one process
_QUICK_LIMIT = 30.0
#: Debian's own Python, where python3-siconos is, unlike what pip brings.
_INTERPRETERS = {"siconos": "/usr/bin/python3"}


def main(words: Sequence[str]) -> int:
    """Run what is asked for, and write results, page and charts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"problems ({', '.join(problems.names())}) and "
                        f"programs ({', '.join(RUNNERS)}) to run (default: all)")
    parser.add_argument("--quick", action="store_true", help=f"at most {_QUICK_LIMIT:g} s a run instead of {LIMIT:g} s")
    parser.add_argument("--output", type=Path, default=RESULTS.parent, help="folder (default: out/benchmark)")
    options = parser.parse_args(words)
    if strange := set(options.names) - {*problems.names(), *RUNNERS}:
        parser.error(f"{', '.join(sorted(strange))}: neither a problem nor a program of the benchmark")
    chosen = [name for name in problems.names() if name in options.names] or problems.names()
    runners = [name for name in RUNNERS if name in options.names] or list(RUNNERS)
    options.output.mkdir(parents=True, exist_ok=True)
    rows = []
    begun = time.monotonic()
    try:
        for row in measured(chosen, runners, _QUICK_LIMIT if options.quick else LIMIT):
            rows.append(row)
            print(f"{time.monotonic() - begun:5.0f} s  {row.pop('progress')}  {described(row)}", flush=True)
    except KeyboardInterrupt:
        print("benchmark: stopped; what was measured is kept", file=sys.stderr)
    from benchmark import report

    report.write(options.output, rows, machine())
    print(f"benchmark: {options.output / 'benchmark.md'}")
    return 0


def measured(names: Sequence[str], runners: Sequence[str], limit: float) -> Iterator[dict]:
    """Rows of the results, one after the other as they are measured."""
    known = {runner: settings(runner) for runner in runners}
    plan = [(name, runner, number, setting) for name in names for runner in runners
            for number, setting in enumerate(known[runner])]
    absent: dict[str, str] = {}
    for done, (name, runner, number, setting) in enumerate(plan, 1):
        problem = problems.load(name)
        row = {"problem": name, "runner": runner, **setting, "progress": f"{done}/{len(plan)}"}
        if runner not in absent:
            found = run_child(runner, name, number, limit)
            if "absent" in found:
                absent[runner] = found["absent"]
            row |= judged(problem, found)
            if "cost" in found:  # an interpreter of its own has no numba to time the unit
                row["cost"] = found["cost"] or found["seconds"] / unit_seconds(problem)
        if runner in absent:
            row |= {"outcome": "absent", "why": absent[runner]}
        yield row


def settings(runner: str) -> list[dict]:
    """Kind and label of each of a runner's settings, from a process of its own, or of one that is absent."""
    found = _child(runner, ["-m", "benchmark.child", runner], LIMIT)
    if found.returncode:
        return [{"kind": PLAIN, "label": ""}]
    return [{"kind": kind, "label": label} for kind, label in json.loads(found.stdout.splitlines()[-1])]


def run_child(runner: str, name: str, number: int, limit: float) -> dict:
    """What `benchmark.child` prints, or what became of it: `absent`, `out of time`, `crashed`."""
    try:
        found = _child(runner, ["-m", "benchmark.child", runner, name, str(number)], limit)
    except subprocess.TimeoutExpired:
        return {"outcome": "out of time", "why": f"more than {limit:g} s"}
    if found.returncode == 0:
        return json.loads(found.stdout.splitlines()[-1])
    last = (found.stderr.strip().splitlines() or [""])[-1]
    if "ModuleNotFoundError" in last or "ImportError" in last or found.returncode == 127:
        return {"absent": last}
    if found.returncode < 0:
        last = signal.Signals(-found.returncode).name
    return {"outcome": "fails", "why": last[:200]}


def _child(runner: str, words: Sequence[str], limit: float) -> subprocess.CompletedProcess:
    """A process in which the runner's program is, in a group of its own, so that nothing of it stays behind."""
    command = _command(runner, words)
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        process = subprocess.Popen(command, cwd=ROOT, env=environment, text=True, start_new_session=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    except OSError as error:
        return subprocess.CompletedProcess(command, 127, "", str(error))
    try:
        out, err = process.communicate(timeout=limit)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _command(runner: str, words: Sequence[str]) -> list[str]:
    return [_INTERPRETERS.get(runner, sys.executable), *words]


def judged(problem: problems.Problem, found: dict) -> dict:
    """Outcome, error and counts of events of what a process has found."""
    row = {key: found[key] for key in ("outcome", "why", "version") if key in found}
    if "unable" in found:
        return row | {"outcome": "cannot", "why": found["unable"]}
    if "states" not in found:
        return row
    states = [[math.nan if number is None else number for number in line] for line in found["states"]]
    fallen = problem.falls_through(states)
    judged_only = {problems.COLUMNS.index(column) for column in problem.judged}
    states = [[number if k in judged_only else 0.0 for k, number in enumerate(line)] for line in states]
    if len(states) != len(problem.times):
        return row | {"outcome": "fails", "why": f"{len(states)} of {len(problem.times)} samples"}
    error = problem.error(states)
    if math.isnan(error) or error > DIVERGED and not fallen:
        return row | {"outcome": "diverges"}
    row |= {"outcome": FALLS if fallen else "ok", "error": error}
    if found["events"] is not None:
        row["missed"] = {kind: [found["events"].get(kind, 0), event["count"]] for kind, event in problem.events.items()
                         if kind in found["events"] or kind.endswith("contact")}
        row["missed"] = {kind: counts for kind, counts in row["missed"].items() if counts[0] != counts[1]}
    last, true = states[-1][4], float(problem.values["x"][-1])
    if problem.judged == ("x",) and last * true < 0.0:
        row["outcome"] = "wrong sign"
    return row


def described(row: dict) -> str:
    """A row in a line of words."""
    text = f"{row['problem']} {row['runner']} ({row['kind']}: {row['label']}): {row['outcome']}"
    if "error" in row:
        text += f", error {row['error']:.1e}"
    if "cost" in row:
        text += f" at {row['cost']:.3g}"
    if row.get("missed"):
        text += f", {row['missed']}"
    return text + (f" ({row['why']})" if row.get("why") else "")


def machine() -> str:
    """What the numbers depend on."""
    return f"Python {platform.python_version()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
