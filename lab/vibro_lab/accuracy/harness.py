"""The harness: it runs a program on a problem over a horizon, measures error and cost, and makes rows.

The executable `accuracy` and `lab/benchmark/run.py` only call `rows(problem, program, effort)` and write what comes to
a CSV file, from which all pages and diagrams are made.

1. A `Problem` is a scene within a horizon (`SceneProblem`), or a problem of the benchmark with stored values. It says
   at which instants a program is sampled, and judges the program's answer.
2. A `Row` is one setting of one program on one problem, with its errors and its cost.
3. A cost is the wall time [s] for each simulated second. The set-up of a run, such as making the device, has a field of
   its own, because it decides which program is cheap over a tenth of a second and hardly counts over ten (`cost_of`).
4. A program that is not part of the package runs in its own process (`Program.command`), so that a crash, an endless
   loop or a missing library becomes a row.

Like `programs`, this module imports only numpy, because a program may need another Python.
"""

import csv
import json
import math
import os
import platform
import signal
import statistics
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from vibro_lab.accuracy.programs import COLUMNS, Answer, Program, Setting, UnableError, by_device

if TYPE_CHECKING:
    from vibro_ros import Scene

#: Samples per second of simulated time in the runs of a scene whose cost is measured.
RATE = 1000.0
#: Wall time [s] for which a round repeats a run, at least; the time of the run is the median.
LEAST_TIME = 0.1
#: Number of instants of a horizon at which errors are evaluated; they lie off all grids of samples and steps.
INSTANTS = 50_000
#: What a row compares: a trajectory within the horizon of a diagram; the same within the horizon of a requirement; mean
#: speeds over drawn starts; the reference with an independent program; and the Lyapunov exponent.
TRAJECTORY, REQUIRED, AVERAGE, REFERENCE, EXPONENT = "trajectory", "requirement", "mean speed", "reference", "exponent"
#: Outcomes of a row.
OK, CANNOT, DIVERGES, FAILS, TIMEOUT, ABSENT = "ok", "cannot", "diverges", "fails", "out of time", "absent"
_GOLDEN_RATIO = 0.5 * (math.sqrt(5.0) - 1.0)  # the fractional parts of its multiples fill an interval evenly
COMPILING = 120.0  # s, time for compilation in addition to the limit of a process
_REFERENCE_TOLERANCE = 1e-12  # tolerance of exact as the reference
_IGNORED_START = 1e-3  # s, from the start, in which contacts are ignored, because programs may count them differently
_BODY, _HEIGHT = COLUMNS.index("body_position"), COLUMNS.index("body_height")
_MASSES = COLUMNS.index("upper_position"), COLUMNS.index("inclined_position")


@dataclass(frozen=True)
class Effort:
    """Amount of measurement."""

    repeats: int = 5  # rounds of each row, each of runs for `LEAST_TIME`; costs are medians
    horizon: float | None = None  # time over which trajectories are compared [s]; None: from the Lyapunov time
    patience: float = 2.0  # wall time [s] of a run after which rounds end and no finer setting is tried
    patience_for_averages: float = 8.0  # the same time [s] for all starts of a mean speed
    starts: int = 32  # starts of a mean speed by a method of fixed step; `exact` gets four times as many
    duration: float = 5.0  # measuring time of each start [s]
    limit: float = 60.0  # wall time [s] of a run, without compilation, after which an external program's process ends


class Errors(NamedTuple):
    """Errors of an answer: the largest differences from a reference at the compared instants."""

    columns: tuple[float, ...]  # of each of `COLUMNS` [m, m/s]
    # Largest distance in time [s] of a contact from the nearest of its kind in the other answer, in both directions, so
    # that missing contacts count; infinite if only one answer has a kind; NaN if there is nothing to compare.
    events: float
    speed: float  # of the mean speed from t = 0 to the end [m/s]


def errors(answer: Answer, reference: Answer, duration: float) -> Errors:
    """Compute the errors of `answer` against `reference`, both at the same instants, the last at `duration` [s]."""
    differences = np.abs(answer.samples - reference.samples)
    ends = answer.samples[[0, -1], _BODY] - reference.samples[[0, -1], _BODY]
    return Errors(tuple(map(float, differences.max(axis=0))), _event_error(answer, reference),
                  float(abs(ends[1] - ends[0]) / duration))


def _event_error(answer: Answer, reference: Answer) -> float:
    measured, expected = _contacts(answer), _contacts(reference)
    if answer.events is None or not len(answer.events) or not expected:
        return math.nan
    if measured.keys() != expected.keys():
        return math.inf
    return max(max(_farthest(measured[kind], expected[kind]), _farthest(expected[kind], measured[kind]))
               for kind in expected)


def _farthest(instants: np.ndarray, others: np.ndarray) -> float:
    """Largest distance [s] of one of `instants` from the nearest of `others`; both are ascending."""
    after = np.searchsorted(others, instants)
    later, earlier = others[np.minimum(after, len(others) - 1)], others[np.maximum(after - 1, 0)]
    return float(np.minimum(np.abs(later - instants), np.abs(instants - earlier)).max())


def _contacts(answer: Answer) -> dict[str, np.ndarray]:
    """Instants [s] of contacts by kind, ascending; kinds without contacts are left out."""
    if answer.events is None:
        return {}
    events = answer.events[answer.events["time"] > _IGNORED_START]
    kinds = (kind for kind in np.unique(events["kind"]) if kind.endswith("_contact"))
    return {str(kind): np.sort(events["time"][events["kind"] == kind]) for kind in kinds}


@dataclass(frozen=True)
class Row:
    """Result of one setting of one program on one problem; NaN where a number does not apply.

    `compared` says what the row holds:

    - `TRAJECTORY`, `REQUIRED`: cost, and the largest errors within `horizon` [s];
    - `AVERAGE`: `mean` [m/s] of `repeats` drawn starts of `horizon` seconds that lead to one of `motions` motions. Nine
      of ten of these starts lie from `low` to `high`; `starts_forwards` of them go forwards. Each motion has a row;
    - `REFERENCE`: the errors are those of `exact` against the named program;
    - `EXPONENT`: the largest Lyapunov exponent [1/s] and its 95 % interval.

    Lengths are in m, times in s, speeds in m/s.
    """

    problem: str
    compared: str
    program: str
    use: str  # `PLAIN` or `TUNED`
    setting: str
    value: float  # step [s] or tolerance
    horizon: float  # simulated time [s]
    repeats: int = 0  # rounds of the cost, or starts
    cost: float = math.nan  # wall time [s] for each simulated second, without set-up
    set_up: float = math.nan  # wall time [s] of a run before its first step
    body_error: float = math.nan  # of the body's position along the ground
    height_error: float = math.nan
    mass_error: float = math.nan  # of a mass's position along its guide, the larger
    event_error: float = math.nan
    speed_error: float = math.nan
    share_error: float = math.nan  # of the judged columns, as a share of the span of the reference
    mean: float = math.nan
    low: float = math.nan
    high: float = math.nan
    starts_forwards: int = 0
    motions: int = 1
    outcome: str = OK
    note: str = ""
    version: str = ""  # of the program
    measured_on: str = ""  # interpreter, machine and date

    @property
    def wall_time(self) -> float:
        """Wall time [s] of a whole run, with its set-up."""
        return self.set_up + self.cost * self.horizon

    @property
    def path_error(self) -> float:
        """Largest error [m] of the body's position along the ground or of its height."""
        return float(np.maximum(self.body_error, self.height_error))

    @property
    def position_error(self) -> float:
        """Largest error [m] of body position, height and mass positions; NaN if one is NaN."""
        return float(np.maximum(self.path_error, self.mass_error))

    def with_errors(self, errors: Errors) -> "Row":
        """Return this row with the given errors."""
        return replace(self, body_error=errors.columns[_BODY], height_error=errors.columns[_HEIGHT],
                       mass_error=float(np.max([errors.columns[k] for k in _MASSES])), event_error=errors.events,
                       speed_error=errors.speed)


@contextmanager
def row_writer(path: Path) -> Iterator[Callable[[Row], None]]:
    """Context manager that gives a function to append a `Row` to a new CSV file; the function flushes the file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Row)])

        def write(row: Row) -> None:
            # more digits than any text shows, so that a text made from the file is the same
            writer.writerow(f"{cell:.10g}" if isinstance(cell, float) else cell for cell in astuple(row))
            file.flush()

        file.flush()
        yield write


def read_rows(path: Path) -> list[Row]:
    """Read the rows of a file written by `row_writer`."""
    types = {field.name: {"str": str, "int": int, "float": float}[str(getattr(field.type, "__name__", field.type))]
             for field in fields(Row)}
    with path.open(encoding="utf-8") as lines:
        return [Row(**{name: types[name](cell) for name, cell in line.items()}) for line in csv.DictReader(lines)]


def off_every_grid(horizon: float, count: int) -> np.ndarray:
    """Return instants [s], shape (count + 1,), from 0 to `horizon`, ascending.

    There is one in each of `count` equal parts of the horizon, at a different place of every part, and the end. On a
    grid, errors between its instants or between a method's steps would remain undetected.
    """
    k = np.arange(count)
    instants = (k + np.mod(_GOLDEN_RATIO * k, 1.0)) * (horizon / count)
    return np.append(instants, horizon)


class Problem(Protocol):
    """Interface of a problem: a scene within a horizon (`SceneProblem`), or a benchmark problem with stored values."""

    @property
    def name(self) -> str:
        """Name of the problem in rows."""

    @property
    def scene(self) -> Any:
        """`Scene` with the same equations, motion and start."""

    @property
    def times(self) -> np.ndarray:
        """Instants [s], ascending from 0, at which a run is sampled, shape (n,)."""

    def at(self, times: np.ndarray) -> "Problem":
        """Return the same problem, sampled at other instants [s]."""

    def instants(self, program: Program, setting: Setting) -> np.ndarray:
        """Instants [s] at which errors are evaluated."""

    def judge(self, row: "Row", answer: Answer, times: np.ndarray) -> "Row":
        """Return the row with the errors of an answer at instants [s], and the resulting outcome."""


@dataclass(frozen=True)
class SceneProblem:
    """A scene within a horizon, whose reference is `exact` at its finest tolerance; see `Problem`."""

    scene: "Scene"
    times: np.ndarray

    @classmethod
    def within(cls, scene: "Scene", horizon: float) -> "SceneProblem":
        """Return the problem of a scene from 0 to `horizon` [s], sampled at `RATE`."""
        return cls(scene, np.arange(max(1, round(horizon * RATE)) + 1) / RATE)

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    def at(self, times: np.ndarray) -> "SceneProblem":
        """Return the same problem, sampled at other instants [s]."""
        return replace(self, times=times)

    def instants(self, program: Program, setting: Setting) -> np.ndarray:
        """Instants off every grid; for a program without dense output the ends of every second step."""
        horizon = float(self.times[-1])
        if program.is_dense:
            return off_every_grid(horizon, INSTANTS)
        return np.arange(round(horizon / (2.0 * setting.value)) + 1) * (2.0 * setting.value)

    def reference(self, times: np.ndarray) -> Answer:
        """Return the reference answer at instants [s]."""
        return by_device("exact", self.scene, times, _REFERENCE_TOLERANCE)

    def judge(self, row: Row, answer: Answer, times: np.ndarray) -> Row:
        """Return the row with the errors of an answer at instants [s], or its outcome if positions are not finite."""
        judged = row.with_errors(errors(answer, self.reference(times), float(times[-1])))
        if not math.isfinite(judged.position_error):
            return replace(row, outcome=DIVERGES, note="positions not finite", cost=math.nan, set_up=math.nan)
        return judged


def rows(problem: Problem, program: Program, effort: Effort, compared: str = TRAJECTORY) -> Iterator[Row]:
    """Yield a row for each setting, from coarse to fine, until one takes longer than the effort's patience."""
    last_step, duration = math.inf, 0.0
    for number, setting in enumerate(program.settings):
        if setting.is_step and duration * last_step / setting.value > effort.patience and math.isfinite(last_step):
            return
        begun = time.perf_counter()
        row = (_in_child(problem, program, setting, number, effort) if program.command
               else measure_setting(problem, program, setting, effort))
        yield replace(row, compared=compared)
        is_timed = math.isfinite(row.wall_time)
        duration = row.wall_time if is_timed else time.perf_counter() - begun
        last_step = setting.value if is_timed else math.inf
        if row.outcome == ABSENT or duration > effort.patience and not program.command:
            return


def row_of(problem: Problem, program: Program, setting: Setting, compared: str = TRAJECTORY) -> Row:
    """Return a row without results."""
    return Row(problem.name, compared, program.name, setting.use, setting.label, setting.value,
               float(problem.times[-1]), measured_on=machine())


def measure_setting(problem: Problem, program: Program, setting: Setting, effort: Effort) -> Row:
    """Measure one setting in this process, and return its row."""
    row = replace(row_of(problem, program, setting), version=program.version())
    try:
        instants, whole = problem.instants(program, setting), program.prepare(problem, setting)
        # first, so that compilation is not part of the cost
        answer = whole() if instants is problem.times else program.prepare(problem.at(instants), setting)()
        cost, set_up, rounds = cost_of(problem, whole, program.prepare(problem.at(problem.times[:2]), setting), effort)
    except UnableError as error:
        return replace(row, outcome=CANNOT, note=str(error))
    return problem.judge(replace(row, cost=cost, set_up=set_up, repeats=rounds), answer, instants)


def cost_of(problem: Problem, whole_run: Callable[[], object], short_run: Callable[[], object],
            effort: Effort) -> tuple[float, float, int]:
    """Return the cost of a program [s for each simulated second], its set-up [s], and the number of rounds.

    Whole runs alternate with short ones, which end at the second sampled instant and consist of little but set-up. The
    cost is the difference of their times for each second between the two ends; the set-up is what the short run takes
    beyond that. Both are medians over rounds.
    """
    end, early = float(problem.times[-1]), float(problem.times[1])
    costs, set_ups, spent = list[float](), list[float](), 0.0
    while len(costs) < effort.repeats and spent <= effort.patience / 4.0:  # a long run scatters less
        long_time, short_time = median_time(whole_run), median_time(short_run)
        costs.append((long_time - short_time) / (end - early) if end > early else long_time / end)
        set_ups.append(max(0.0, short_time - costs[-1] * early))
        spent += long_time
    return statistics.median(costs), statistics.median(set_ups), len(costs)


def seconds(function: Callable[[], object]) -> float:
    """Measure the wall time [s] of one call."""
    began = time.perf_counter()
    function()
    return time.perf_counter() - began


def median_time(function: Callable[[], object]) -> float:
    """Median wall time [s] of as many calls as fit into `LEAST_TIME`.

    The time of a single run of milliseconds would depend on cold caches and on other load of the machine.
    """
    began, times = time.perf_counter(), list[float]()
    while not times or time.perf_counter() - began < LEAST_TIME:
        times.append(seconds(function))
    return statistics.median(times)


def machine() -> str:
    """Return what a cost depends on beside the program: interpreter, machine and date."""
    return (f"Python {platform.python_version()}, numpy {np.__version__}; {platform.system()} {platform.machine()}, "
            f"{os.cpu_count()} cores; {datetime.now(UTC):%Y-%m-%d}")


def _in_child(problem: Problem, program: Program, setting: Setting, number: int, effort: Effort) -> Row:
    """Measure one setting in its own process; returns its row, or a row with the outcome of the failed process."""
    row = row_of(problem, program, setting)
    try:
        process = run_child([*program.command, problem.name, str(number), str(effort.limit)], effort.limit + COMPILING)
    except subprocess.TimeoutExpired:
        return replace(row, outcome=TIMEOUT, note=f"more than {effort.limit + COMPILING:g} s, with compiling")
    if process.returncode == 0:
        return Row(**json.loads(process.stdout.splitlines()[-1]))
    last = (process.stderr.strip().splitlines() or [""])[-1]
    if "ModuleNotFoundError" in last or "ImportError" in last or process.returncode == 127:
        return replace(row, outcome=ABSENT, note=last)
    if process.returncode == -signal.SIGALRM:
        return replace(row, outcome=TIMEOUT, note=f"more than {effort.limit:g} s")
    if process.returncode < 0:
        last = signal.Signals(-process.returncode).name
    return replace(row, outcome=FAILS, note=last[:200])


def print_row(row: Row) -> None:
    """Print a row as the last line of a child process, which `rows` reads."""
    print(json.dumps(asdict(row)), flush=True)


def run_child(command: Sequence[str], limit: float) -> subprocess.CompletedProcess[str]:
    """Run a command in its own process group, end all its processes, and return the completed process.

    It raises `subprocess.TimeoutExpired` if the command takes longer than `limit` [s].
    """
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        process = subprocess.Popen(command, env=environment, text=True, start_new_session=True,
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
