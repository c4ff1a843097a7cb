"""What accuracy costs: one problem, one program, a row for each setting.

`rows(problem, program, effort)` is all that the executable `accuracy` and the benchmark call. A row has the program's
error (`errors`, against the problem's reference) and its cost, a ratio to the device's own Runge-Kutta 4 of 1e-5 s on
the same problem, run in turn. A program that does not ship runs in a process of its own (`Program.command`), so that a
crash, an endless loop or an absent library is a result. Like `programs`, this file needs numpy alone.
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

from vibro_ros.accuracy.programs import (
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
    from vibro_ros.model.scene import Scene

#: Samples per second of robot time in the runs whose cost is measured.
RATE = 1000.0
#: Time [s] that the median cost of a round is taken over, at least.
LEAST_TIME = 0.1
#: Instants at which errors are looked for, in each horizon; they lie off all grids of samples and steps.
INSTANTS = 50_000
#: What a row compares: trajectories within a horizon, the same within the horizon of a requirement, mean speeds over
#: starts, the reference with an independent program, and how fast motions part.
TRAJECTORY, REQUIRED, AVERAGE, REFERENCE, EXPONENT = "trajectory", "requirement", "mean speed", "reference", "exponent"
#: Outcomes of a row.
OK, CANNOT, DIVERGES, FAILS, TIMEOUT, ABSENT = "ok", "cannot", "diverges", "fails", "out of time", "absent"
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # multiples of it lie in all parts of an interval alike
COMPILING = 120.0  # s, that a process may take beyond its limit
_OF_UNIT = 1001  # samples that the unit is run for at most
_FINEST = 1e-12  # tolerance of exact as the reference
_BEGINNING = 1e-3  # s, within which contacts may count as events or not
_BODY, _HEIGHT = COLUMNS.index("body_position"), COLUMNS.index("body_height")
_MASSES = COLUMNS.index("upper_position"), COLUMNS.index("inclined_position")


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes
    ----------
    repeats : int
        Rounds of each row, each of runs for `LEAST_TIME`; costs are medians.
    horizon : float or None
        Time over which trajectories are compared [s]; by the Lyapunov time if None.
    patience : float
        Time [s] of one run after which its program's settings go no finer; steps that are expected to take longer are
        not tried. Nothing is repeated after a quarter of it: a long run's time has less scatter.
    patience_for_averages : float
        The same time [s] for all starts of a mean speed.
    starts : int
        Starts of a mean speed, at least 2; the spread between them does not shrink with their duration.
    duration : float
        Time of each start that counts [s].
    limit : float
        Time [s] of one run after which the process of a program that does not ship is ended; compiling is apart.
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
    """Distances of an answer from a reference, each the largest at the instants compared.

    Attributes
    ----------
    columns : tuple of float
        By `COLUMNS` [m, m/s].
    events : float
        Largest distance in time [s] of a contact from the nearest of its kind in the other answer, both ways, so that
        a contact too many or too few counts too; infinite where one answer has none of a kind; NaN where the
        program locates no events or nothing touches.
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
        """Whether the positions are numbers at all."""
        return math.isfinite(self.body + self.height + self.masses)


def errors(answer: Answer, reference: Answer, duration: float) -> Errors:
    """Errors of `answer` at the instants that it shares with `reference`, the last of them at `duration` [s]."""
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
    """The largest distance [s] of an instant in `some` from the nearest in `others`; both ascend."""
    after = np.searchsorted(others, some)
    later, earlier = others[np.minimum(after, len(others) - 1)], others[np.maximum(after - 1, 0)]
    return float(np.minimum(np.abs(later - some), np.abs(some - earlier)).max())


def _contacts(answer: Answer) -> dict[str, np.ndarray]:
    """Instants [s] of contacts by kind, ascending; kinds without one are left out."""
    if answer.events is None:
        return {}
    events = answer.events[answer.events["time"] > _BEGINNING]
    kinds = (kind for kind in np.unique(events["kind"]) if kind.endswith("_contact"))
    return {str(kind): np.sort(events["time"][events["kind"] == kind]) for kind in kinds}


@dataclass(frozen=True)
class Row:
    """One setting of one program on one problem; NaN where a number does not apply.

    `compared` is `TRAJECTORY` (the errors are distances within `horizon`), `REQUIRED` (the same, within the horizon of
    a requirement), `AVERAGE` (`mean` is the speed of one of the `motions` that starts of `horizon` seconds lead
    to, with its 95 % interval `spread`, NaN of one start, over the `repeats` starts that do, of which `starts_forwards`
    go forwards; several motions have a row each), `REFERENCE` (the errors are those of `exact` against the program
    named) or `EXPONENT` (`mean` and `spread` are the largest Lyapunov exponent). `cost` is a ratio to the
    unit's, `wall_time` in seconds; lengths in m, times in s, speeds in m/s. `share_error` is the largest error of the
    columns that a problem is judged by, as a share of the span of its reference.
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
        """Largest error [m] of the body's path: along the ground or above it."""
        return float(np.maximum(self.body_error, self.height_error))

    @property
    def position_error(self) -> float:
        """Largest error [m] of any position: of body, height or a mass; NaN if one is no number."""
        return float(np.maximum(self.path_error, self.mass_error))

    def with_errors(self, off: Errors) -> "Row":
        """This row with so many errors."""
        return replace(self, body_error=off.body, height_error=off.height, mass_error=off.masses,
                       event_error=off.events, speed_error=off.speed)


@contextmanager
def row_writer(path: Path) -> Iterator[Callable[[Row], None]]:
    """Give a function that appends a `Row` to a new CSV file, on disk before it returns."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Row)])

        def write(row: Row) -> None:
            # more digits than any text shows: who makes the text from the rows again gets the same one
            writer.writerow(f"{cell:.10g}" if isinstance(cell, float) else cell for cell in astuple(row))
            file.flush()

        file.flush()
        yield write


def read_rows(path: Path) -> list[Row]:
    """The rows of a file that `row_writer` has written."""
    types = {field.name: {"str": str, "int": int, "float": float}[str(getattr(field.type, "__name__", field.type))]
             for field in fields(Row)}
    with path.open(encoding="utf-8") as lines:
        return [Row(**{name: types[name](cell) for name, cell in line.items()}) for line in csv.DictReader(lines)]


def off_every_grid(horizon: float, count: int) -> np.ndarray:
    """Instants [s], shape (count + 1,), from 0 to `horizon`, ascending: one in each part of it, nowhere the same part.

    On a grid an error between its instants would go unseen, and one between a method's steps as well.
    """
    k = np.arange(count)
    instants = (k + np.mod(_GOLDEN * k, 1.0)) * (horizon / count)
    return np.append(instants, horizon)


class Problem(Protocol):
    """What programs run on: a scene within a horizon, here, or one of the benchmark with stored values."""

    @property
    def name(self) -> str:
        """In rows."""

    @property
    def scene(self) -> Any:
        """A `Scene` with the same equations, motion and start."""

    @property
    def times(self) -> np.ndarray:
        """Instants [s], ascending from 0, at which a run is sampled, shape (n,)."""

    def at(self, times: np.ndarray) -> "Problem":
        """The same problem, sampled at other instants [s]."""

    def instants(self, program: Program, setting: Setting) -> np.ndarray:
        """Instants [s] at which errors are looked for."""

    def judge(self, row: "Row", answer: Answer, times: np.ndarray) -> "Row":
        """The row with the errors of an answer at instants [s], and the outcome that they mean."""


@dataclass(frozen=True)
class SceneProblem:
    """A scene within a horizon, judged by `exact` at its finest; see `Problem`."""

    scene: "Scene"
    times: np.ndarray

    @classmethod
    def within(cls, scene: "Scene", horizon: float) -> "SceneProblem":
        """The scene from 0 to `horizon` [s], sampled at `RATE`."""
        return cls(scene, np.arange(max(1, round(horizon * RATE)) + 1) / RATE)

    @property
    def name(self) -> str:
        """Of the scene."""
        return self.scene.name

    def at(self, times: np.ndarray) -> "SceneProblem":
        """The same scene, sampled at other instants [s]."""
        return replace(self, times=times)

    def instants(self, program: Program, setting: Setting) -> np.ndarray:
        """Off every grid, or the ends of each second step of a program that knows nothing between them."""
        horizon = float(self.times[-1])
        if program.is_dense:
            return off_every_grid(horizon, INSTANTS)
        return np.arange(round(horizon / (2.0 * setting.value)) + 1) * (2.0 * setting.value)

    def reference(self, times: np.ndarray) -> Answer:
        """The true answer at instants [s]."""
        return by_device("exact", self.scene, times, _FINEST)

    def judge(self, row: Row, answer: Answer, times: np.ndarray) -> Row:
        """The row with the errors of an answer at instants [s]."""
        off = errors(answer, self.reference(times), float(times[-1]))
        if not off.finite:
            return replace(row, outcome=DIVERGES, note="positions not finite", cost=math.nan, wall_time=math.nan)
        return row.with_errors(off)


def rows(problem: Problem, program: Program, effort: Effort, compared: str = TRAJECTORY) -> Iterator[Row]:
    """A row for each setting, from coarse to fine, until one takes longer than the effort's patience."""
    before, seconds = math.inf, 0.0
    for number, setting in enumerate(program.settings):
        if setting.is_step and seconds * before / setting.value > effort.patience and math.isfinite(before):
            return
        begun = time.perf_counter()
        row = (_in_child(problem, program, setting, number, effort) if program.command
               else measured(problem, program, setting, effort))
        yield replace(row, compared=compared)
        done = math.isfinite(row.wall_time)
        seconds = row.wall_time if done else time.perf_counter() - begun
        before = setting.value if done else math.inf
        if row.outcome == ABSENT or seconds > effort.patience and not program.command:
            return


def row_of(problem: Problem, program: Program, setting: Setting, compared: str = TRAJECTORY) -> Row:
    """A row without numbers."""
    return Row(problem.name, compared, program.name, setting.use, setting.label, setting.value,
               float(problem.times[-1]))


def measured(problem: Problem, program: Program, setting: Setting, effort: Effort) -> Row:
    """The row of one setting, measured in this process."""
    row = replace(row_of(problem, program, setting), version=program.version())
    walls: list[float] = []
    ratios: list[float] = []
    try:
        instants = problem.instants(program, setting)
        answer = program.prepare(problem.at(instants), setting)()  # first, so that compiling at first use is no cost
        run = program.prepare(problem, setting)
        while len(walls) < effort.repeats and sum(walls) <= effort.patience / 4.0:
            walls.append(typical(run))
            ratios.append(walls[-1] / unit_seconds(problem))
    except UnableError as error:
        return replace(row, outcome=CANNOT, note=str(error))
    return problem.judge(replace(row, repeats=len(walls), cost=statistics.median(ratios),
                                  wall_time=statistics.median(walls)), answer, instants)


def unit_seconds(problem: Problem) -> float:
    """Wall time [s] of the unit of cost on this problem, now; NaN in a Python without numba."""
    times = problem.times[:_OF_UNIT]
    try:
        run = DEVICE[UNIT].prepare(problem.at(times), Setting(UNIT_STEP, ""))
    except ModuleNotFoundError:
        return math.nan
    return seconds(run) * float(problem.times[-1] / times[-1])


def seconds(function: Callable[[], object]) -> float:
    """Wall time [s] of one call."""
    began = time.perf_counter()
    function()
    return time.perf_counter() - began


def typical(function: Callable[[], object]) -> float:
    """Median wall time [s] of as many calls as fit into `LEAST_TIME`.

    A single run of milliseconds would be measured with caches that the run before it left cold, or with what else the
    machine did just then.
    """
    began, times = time.perf_counter(), list[float]()
    while not times or time.perf_counter() - began < LEAST_TIME:
        times.append(seconds(function))
    return statistics.median(times)


def _in_child(problem: Problem, program: Program, setting: Setting, number: int, effort: Effort) -> Row:
    """The row of one setting, measured in a process of its own, or what became of that process."""
    row = row_of(problem, program, setting)
    try:
        done = run_child([*program.command, problem.name, str(number), str(effort.limit)], effort.limit + COMPILING)
    except subprocess.TimeoutExpired:
        return replace(row, outcome=TIMEOUT, note=f"more than {effort.limit + COMPILING:g} s, with compiling")
    if done.returncode == 0:
        row = Row(**json.loads(done.stdout.splitlines()[-1]))
        # an interpreter of its own has no numba to time the unit
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
    """What a child prints as its last line."""
    print(json.dumps(asdict(row)), flush=True)


def run_child(command: Sequence[str], limit: float) -> subprocess.CompletedProcess[str]:
    """A finished process, in a group of its own, so that nothing of it stays behind.

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
