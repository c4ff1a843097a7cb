"""Every method to compare, as one table: name to `ComparedMethod`, a callable of scene, instants and setting.

>>> answer = METHODS["rk4"](scene, times, 1e-5)

A scene whose motor stands still at t = 0 is commanded `DRIVE_SPEED` then, by every method. To compare with another
method, also a wrong one, add it to a copy of the table: ``METHODS | {"mine": ComparedMethod(function, "step",
(1e-4,))}``; for other settings, `dataclasses.replace` its `ladder`.
"""

import math
import time as wall_clock
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vibro_ros.accuracy import tables_by_scipy as scipy_tables
from vibro_ros.accuracy.tables_by_scipy import UnableError
from vibro_ros.model.scene import Scene
from vibro_ros.model.support import unsupported
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator

#: Columns of `Answer.samples`: u, u', w, w', x, x', y, y'.
COLUMNS = ("upper_position", "upper_velocity", "inclined_position", "inclined_velocity", "body_position",
           "body_velocity", "body_height", "body_vertical_velocity")
#: Speed [rad/s] commanded at t = 0 of a scene whose motor stands still.
DRIVE_SPEED = 100.0
EVENT_DTYPE = np.dtype([("time", float), ("kind", "U16")])
_FORCING_EVENTS = ("motor_ramp_end", "gap_reached")
_MOST_EVALUATIONS = 6e4  # of a right-hand side in Python, some 4 s; in a run of at most a second, or per second


@dataclass(frozen=True)
class Answer:
    """What a method found, and at what cost.

    Attributes
    ----------
    times : ndarray, shape (n,)
        Instants [s].
    samples : ndarray, shape (n, 8)
        Positions and velocities there [m, m/s], by `COLUMNS`; zero for what the scene does not have.
    events : structured ndarray, shape (events,)
        By time: `time` [s] and `kind` of the contacts and of the body's changes of state; empty where a method has
        none.
    steps : int
        Steps, of whatever kind the method takes.
    evaluations : int
        Evaluations of the accelerations; 0 where there is no such thing.
    wall_time : float
        Seconds for the integration and its samples, compilation excluded.
    """

    times: np.ndarray
    samples: np.ndarray
    events: np.ndarray
    steps: int
    evaluations: int
    wall_time: float


@dataclass(frozen=True)
class ComparedMethod:
    """A method of the table.

    Attributes
    ----------
    run : callable
        Gives an `Answer` from a scene, instants [s] (ascending from 0, shape (n,)) and a setting; raises `UnableError`
        where it cannot.
    setting : str
        What the setting is: `step` [s] or `tolerance`.
    ladder : tuple of float
        Settings from coarse to fine for a study.
    compiled : bool
        Whether it may meet a need for least: a right-hand side in Python costs a hundred times as much.
    """

    run: Callable[..., Answer]
    setting: str
    ladder: tuple[float, ...]
    compiled: bool = False

    def __call__(self, scene: Scene, times: np.ndarray, setting: float) -> Answer:
        """See `run`."""
        return self.run(scene, np.asarray(times, dtype=float), setting)


def drive_speed(scene: Scene) -> float | None:
    """Speed [rad/s] to command at t = 0, or None if the motor turns by itself."""
    return min(DRIVE_SPEED, scene["motor.max_speed"]) if scene["motor.speed"] == 0.0 else None


def event_array(found: Iterable[tuple[float, str]]) -> np.ndarray:
    """Instants [s] and kinds as `Answer.events`."""
    events = np.array([(time, kind) for time, kind in found], dtype=EVENT_DTYPE)
    return events[np.argsort(events["time"], kind="stable")]


def by_simulator(name: str, evaluations: int, scene: Scene, times: np.ndarray, setting: float) -> Answer:
    """A `solver.method` of the device itself, with `evaluations` of the accelerations a step."""
    if name == "moreau" and (lacking := unsupported(scene, name)):
        raise UnableError(lacking)
    parameter = "solver.tolerance" if name == "exact" else "solver.step"
    scene = scene.with_parameters({"solver.method": name, parameter: setting, "solver.audit": False})
    Simulator(scene).advance_to(0.0)  # what is compiled once a scene or once a process is not the method's cost
    device = Simulator(scene)
    if drive_speed(scene) is not None:
        device.command(motor_speed=drive_speed(scene))
    began = wall_clock.perf_counter()
    try:
        samples = device.sample(times)
    except SimulationError as error:
        raise UnableError(str(error)) from error
    wall_time = wall_clock.perf_counter() - began
    events = device.take_events()
    found = [(event["time"], event["kind"]) for event in events if event["kind"] not in _FORCING_EVENTS]
    steps = device.statistics["steps"]
    return Answer(times, np.stack([getattr(samples, column) for column in COLUMNS], axis=1), event_array(found), steps,
                  steps * evaluations, wall_time)


def by_scipy(name: str, integrate: Callable, scene: Scene, times: np.ndarray, setting: float,
             most_evaluations: float = _MOST_EVALUATIONS) -> Answer:
    """One of scipy's solvers on the scene's tables, integrated as `tables_by_scipy.located` does.

    It gives up after `most_evaluations` a second of the run, and not before as many in all.
    """
    tables = scipy_tables.Tables(scene, drive_speed(scene))
    tables.slope(0.0, tables.start, tables.first_mode)
    work = scipy_tables.Work(most_evaluations * max(1.0, times[-1]))
    began = wall_clock.perf_counter()
    with np.errstate(all="ignore"):  # what overflows fails, or is refused by the step control
        states, found = integrate(name, tables, times, setting, work)
    wall_time = wall_clock.perf_counter() - began
    forms, samples = tables.model.forms, np.zeros((len(times), len(COLUMNS)))
    columns = [COLUMNS.index(f"{side}_position") for side in forms.guides]
    columns += [COLUMNS.index("body_position")] * forms.body_moves + [COLUMNS.index("body_height")] * forms.body_hops
    for i, column in enumerate(columns):
        samples[:, column], samples[:, column + 1] = states[:, i], states[:, len(columns) + i]
    return Answer(times, scipy_tables.finite(samples), event_array(found), work.steps, work.evaluations, wall_time)


def ladder(coarsest: float, finest: float) -> tuple[float, ...]:
    """Powers of ten, two a decade, from coarse to fine."""
    count = round(2.0 * math.log10(coarsest / finest)) + 1
    return tuple(coarsest * 10.0 ** (-0.5 * k) for k in range(count))


#: Name to method: the device's own, and scipy's with event location.
METHODS: dict[str, ComparedMethod] = {
    "exact": ComparedMethod(partial(by_simulator, "exact", 0), "tolerance", (1e-9,), True),
    **{name: ComparedMethod(partial(by_simulator, name, evaluations), "step", ladder(1e-3, 1e-7), True)
       for name, evaluations in (("rk4", 4), ("rk4_located", 4), ("semi_implicit_euler", 1), ("moreau", 1))},
    **{name: ComparedMethod(partial(by_scipy, name, scipy_tables.located), "tolerance", ladder(1e-3, 1e-12))
       for name in scipy_tables.SOLVERS},
}


#: What costs are ratios to: the device's own Runge-Kutta 4 with steps of 1e-5 s.
BASELINE = ComparedMethod(METHODS["rk4"].run, "step", (1e-5,))
#: Name to method of a study: every method with one setting a decade, or every second decade where a right-hand side in
#: Python is slow, and the baseline.
STUDIED: dict[str, ComparedMethod] = {
    name: replace(method, ladder=method.ladder[::2 if method.setting == "step" else 4])
    for name, method in METHODS.items()} | {
    "baseline": BASELINE}
