"""Measurement of errors and costs: one problem, one program, one row for each setting.

The executable `accuracy` and the benchmark only call `rows(problem, program, effort)`. A row has the program's errors
(`errors`, against the problem's reference) and its cost, relative to the device's own Runge-Kutta 4 with steps of
1e-5 s on the same problem, run alternately with the program. A program that is not part of the package runs in its own
process (`Program.command`), so that a crash, an endless loop or a missing library becomes a result. Like `programs`,
this module imports only numpy.
"""

import csv
import json
import math
import os
import signal
import statistics
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from vibro_lab.accuracy.programs import (
    COLUMNS,
    DEVICE,
    UNIT,
    UNIT_STEP,
    Answer,
    Program,
    Setting,
    UnableError,
    by_device,
)

if TYPE_CHECKING:
    from vibro_ros import Scene

#: Samples per second of simulated time in the runs whose cost is measured.
RATE = 1000.0
#: Wall time [s] for which a round repeats a run, at least; its cost is the median.
LEAST_TIME = 0.1
#: Number of instants of a horizon at which errors are evaluated; they lie off all grids of samples and steps.
INSTANTS = 50_000
#: Comparison in a row: trajectories within a horizon, the same within the horizon of a requirement, mean speeds over
#: starts, the reference with an independent program, and the Lyapunov exponent.
TRAJECTORY, REQUIRED, AVERAGE, REFERENCE, EXPONENT = "trajectory", "requirement", "mean speed", "reference", "exponent"
#: Outcomes of a row.
OK, CANNOT, DIVERGES, FAILS, TIMEOUT, ABSENT = "ok", "cannot", "diverges", "fails", "out of time", "absent"
_GOLDEN_RATIO = 0.5 * (math.sqrt(5.0) - 1.0)  # the fractional parts of its multiples fill an interval evenly
COMPILING = 120.0  # s, time for compilation in addition to the limit of a process
_UNIT_SAMPLES = 1001  # largest number of samples of a run of the unit
_REFERENCE_TOLERANCE = 1e-12  # tolerance of exact as the reference
_IGNORED_START = 1e-3  # s, from the start, in which contacts are ignored, because programs may count them differently
_BODY, _HEIGHT = COLUMNS.index("body_position"), COLUMNS.index("body_height")
_MASSES = COLUMNS.index("upper_position"), COLUMNS.index("inclined_position")


@dataclass(frozen=True)
class Effort:
    """Amount of measurement.

    Attributes
    ----------
    repeats : int
        Rounds of each row, each of runs for `LEAST_TIME`; costs are medians.
    horizon : float or None
        Time over which trajectories are compared [s]; None to derive it from the Lyapunov time.
    patience : float
        Wall time [s] of a run after which no finer settings of its program are tried; steps that are expected to take
        longer are skipped. Rounds end after a quarter of it, because the time of a long run has less scatter.
    patience_for_averages : float
        The same time [s] for all starts of a mean speed.
    starts : int
        Number of starts of a mean speed, at least 2; the spread between them does not shrink with their duration.
    duration : float
        Measuring time of each start [s].
    limit : float
        Wall time [s] of a run, without compilation, after which the process of an external program is ended.
    """

    repeats: int = 5
    horizon: float | None = None
    patience: float = 2.0
    patience_for_averages: float = 8.0
    starts: int = 32
    duration: float = 5.0
    limit: float = 60.0


@dataclass(frozen=True)
class Errors:
    """Errors of an answer: the largest differences from a reference at the compared instants.

    Attributes
    ----------
    columns : tuple of float
        Error of each of `COLUMNS` [m, m/s].
    events : float
        Largest distance in time [s] of a contact from the nearest of its kind in the other answer, in both directions,
        so that additional and missing contacts count; infinite if only one answer has contacts of a kind; NaN if the
        program locates no events or there are no contacts.
    speed : float
        Error of the mean speed from t = 0 to the end [m/s].
    """

    columns: tuple[float, ...]
    events: float
    speed: float

    @property
    def body(self) -> float:
        """Largest error of the body's position along the ground [m]."""
        return self.columns[_BODY]

    @property
    def height(self) -> float:
        """Largest error of the body's height above the ground [m]."""
        return self.columns[_HEIGHT]

    @property
    def masses(self) -> float:
        """Largest error of a mass's position along its guide [m]."""
        return float(np.max([self.columns[k] for k in _MASSES]))

    @property
    def finite(self) -> bool:
        """Whether all position errors are finite."""
        return math.isfinite(self.body + self.height + self.masses)


def errors(answer: Answer, reference: Answer, duration: float) -> Errors:
    """Compute the errors of `answer` against `reference`, both at the same instants, the last at `duration` [s]."""
    off = np.abs(answer.samples - reference.samples)
    ends = answer.samples[[0, -1], _BODY] - reference.samples[[0, -1], _BODY]
    return Errors(tuple(map(float, off.max(axis=0))), _event_error(answer, reference),
                  float(abs(ends[1] - ends[0]) / duration))


def _event_error(answer: Answer, reference: Answer) -> float:
    found, expected = _contacts(answer), _contacts(reference)
    if answer.events is None or not len(answer.events) or not expected:
        return math.nan
    if found.keys() != expected.keys():
        return math.inf
    return max(max(_farthest(found[kind], expected[kind]), _farthest(expected[kind], found[kind])) for kind in expected)


def _farthest(some: np.ndarray, others: np.ndarray) -> float:
    """Largest distance [s] of an instant in `some` from the nearest in `others`; both are ascending."""
    after = np.searchsorted(others, some)
    later, earlier = others[np.minimum(after, len(others) - 1)], others[np.maximum(after - 1, 0)]
    return float(np.minimum(np.abs(later - some), np.abs(some - earlier)).max())


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

    `compared` has one of these values:

    - `TRAJECTORY`: the errors are the largest within `horizon` [s].
    - `REQUIRED`: the same, within the horizon of a requirement.
    - `AVERAGE`: `mean` is the mean speed of one of the `motions` that starts of `horizon` seconds lead to. `spread` is
      half its 95 % interval, NaN for one start. `repeats` starts lead to it, of which `starts_forwards` go forwards.
      Each motion has a row.
    - `REFERENCE`: the errors are those of `exact` against the named program.
    - `EXPONENT`: `mean` and `spread` are the largest Lyapunov exponent and half its 95 % interval [1/s].

    `cost` is relative to the unit, `wall_time` in seconds; lengths in m, times in s, speeds in m/s. `share_error` is
    the largest error of the columns by which a problem is judged, as a share of the span of its reference.
    """

    problem: str
    compared: str
    program: str
    use: str
    setting: str
    value: float
    horizon: float
    repeats: int = 0
    wall_time: float = math.nan
    cost: float = math.nan
    body_error: float = math.nan
    height_error: float = math.nan
    mass_error: float = math.nan
    event_error: float = math.nan
    speed_error: float = math.nan
    share_error: float = math.nan
    mean: float = math.nan
    spread: float = math.nan
    starts_forwards: int = 0
    motions: int = 1
    outcome: str = OK
    note: str = ""
    version: str = ""

    @property
    def path_error(self) -> float:
        """Largest error [m] of the body's position along the ground or of its height."""
        return float(np.maximum(self.body_error, self.height_error))

    @property
    def position_error(self) -> float:
        """Largest error [m] of body position, height and mass positions; NaN if one is NaN."""
        return float(np.maximum(self.path_error, self.mass_error))

    def with_errors(self, off: Errors) -> "Row":
        """Return this row with the given errors."""
        return replace(self, body_error=off.body, height_error=off.height, mass_error=off.masses,
                       event_error=off.events, speed_error=off.speed)


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
        off = errors(answer, self.reference(times), float(times[-1]))
        if not off.finite:
            return replace(row, outcome=DIVERGES, note="positions not finite", cost=math.nan, wall_time=math.nan)
        return row.with_errors(off)


def rows(problem: Problem, program: Program, effort: Effort, compared: str = TRAJECTORY) -> Iterator[Row]:
    """Yield a row for each setting, from coarse to fine, until one takes longer than the effort's patience."""
    before, seconds = math.inf, 0.0
    for number, setting in enumerate(program.settings):
        if setting.is_step and seconds * before / setting.value > effort.patience and math.isfinite(before):
            return
        begun = time.perf_counter()
        row = (_in_child(problem, program, setting, number, effort) if program.command
               else measure_setting(problem, program, setting, effort))
        yield replace(row, compared=compared)
        done = math.isfinite(row.wall_time)
        seconds = row.wall_time if done else time.perf_counter() - begun
        before = setting.value if done else math.inf
        if row.outcome == ABSENT or seconds > effort.patience and not program.command:
            return


def row_of(problem: Problem, program: Program, setting: Setting, compared: str = TRAJECTORY) -> Row:
    """Return a row without results."""
    return Row(problem.name, compared, program.name, setting.use, setting.label, setting.value,
               float(problem.times[-1]))


def measure_setting(problem: Problem, program: Program, setting: Setting, effort: Effort) -> Row:
    """Measure one setting in this process, and return its row."""
    row = replace(row_of(problem, program, setting), version=program.version())
    walls: list[float] = []
    ratios: list[float] = []
    try:
        instants = problem.instants(program, setting)
        answer = program.prepare(problem.at(instants), setting)()  # first, so that compilation is not part of the cost
        run = program.prepare(problem, setting)
        while len(walls) < effort.repeats and sum(walls) <= effort.patience / 4.0:
            walls.append(median_time(run))
            ratios.append(walls[-1] / unit_seconds(problem))
    except UnableError as error:
        return replace(row, outcome=CANNOT, note=str(error))
    return problem.judge(replace(row, repeats=len(walls), cost=statistics.median(ratios),
                                  wall_time=statistics.median(walls)), answer, instants)


def unit_seconds(problem: Problem) -> float:
    """Measure the wall time [s] of the unit of cost on a problem; NaN in a Python without numba."""
    times = problem.times[:_UNIT_SAMPLES]
    try:
        run = DEVICE[UNIT].prepare(problem.at(times), Setting(UNIT_STEP, ""))
    except ModuleNotFoundError:
        return math.nan
    return seconds(run) * float(problem.times[-1] / times[-1])


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


def _in_child(problem: Problem, program: Program, setting: Setting, number: int, effort: Effort) -> Row:
    """Measure one setting in its own process; returns its row, or a row with the outcome of the failed process."""
    row = row_of(problem, program, setting)
    try:
        done = run_child([*program.command, problem.name, str(number), str(effort.limit)], effort.limit + COMPILING)
    except subprocess.TimeoutExpired:
        return replace(row, outcome=TIMEOUT, note=f"more than {effort.limit + COMPILING:g} s, with compiling")
    if done.returncode == 0:
        row = Row(**json.loads(done.stdout.splitlines()[-1]))
        # another interpreter may lack numba, and cannot time the unit
        cost = row.wall_time / unit_seconds(problem) if math.isnan(row.cost) and row.wall_time > 0.0 else row.cost
        return replace(row, cost=cost)
    last = (done.stderr.strip().splitlines() or [""])[-1]
    if "ModuleNotFoundError" in last or "ImportError" in last or done.returncode == 127:
        return replace(row, outcome=ABSENT, note=last)
    if done.returncode == -signal.SIGALRM:
        return replace(row, outcome=TIMEOUT, note=f"more than {effort.limit:g} s")
    if done.returncode < 0:
        last = signal.Signals(-done.returncode).name
    return replace(row, outcome=FAILS, note=last[:200])


def print_row(row: Row) -> None:
    """Print a row as the last line of a child process, which `rows` reads."""
    print(json.dumps(asdict(row)), flush=True)


def run_child(command: Sequence[str], limit: float) -> subprocess.CompletedProcess[str]:
    """Run a command in its own process group, end all its processes, and return the completed process.

    Raises
    ------
    subprocess.TimeoutExpired
        When it takes longer than `limit` [s].
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
