"""Programs that are compared, their settings and answers.

1. A `Program` has a name, its settings from coarse to fine, and `prepare(problem, setting)`. `prepare` does all work
   that is not part of the cost, such as compilation, and returns a function without arguments.
2. Each call of that function is one run from the start to the last of `problem.times`, and returns an `Answer`.
3. A program that cannot simulate the problem raises `UnableError`, with a message of one line.
4. A program without dense output has `is_dense` false, and is sampled only at the ends of its steps.

`DEVICE` has the device's own methods, which are part of the package. The benchmark adds others in their own files; a
program that is wrong on purpose can be added in the same way. This module imports only numpy until a run is prepared,
because a program may need another Python.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from vibro_ros import Scene

#: Columns of `Answer.samples`: u, u', w, w', x, x', y, y'.
COLUMNS = ("upper_position", "upper_velocity", "inclined_position", "inclined_velocity", "body_position",
           "body_velocity", "body_height", "body_vertical_velocity")
EVENT_DTYPE = np.dtype([("time", float), ("kind", "U16")])
#: How a program is used: as its documentation recommends, and with settings chosen for the problem.
PLAIN, TUNED = "as documented", "tuned"
#: Speed [rad/s] commanded at t = 0 of a scene whose motor stands still.
DRIVE_SPEED = 100.0
_FORCING_EVENTS = ("motor_ramp_end", "gap_reached")


class UnableError(RuntimeError):
    """A program cannot simulate the problem; the message is one line."""


class Setting(NamedTuple):
    """Setting of a program: a step [s] or a tolerance, its label, its use (`PLAIN` or `TUNED`), and if it is a step."""

    value: float
    label: str
    use: str = TUNED
    is_step: bool = False


class Answer:
    """Result of a run of a program.

    A program may give `samples` and `events` as functions without arguments, which are called when the attribute is
    first read, so that converting a result to this form is not timed as part of the run.
    """

    def __init__(self, samples: np.ndarray | Callable[[], np.ndarray],
                 events: np.ndarray | Callable[[], np.ndarray] | None = None,
                 callbacks: Callable[[], float] | None = None):
        self._samples, self._events = samples, events
        # Returns the part of the run's wall time [s] spent in Python functions that the program calls back.
        self.callbacks = callbacks

    @cached_property
    def samples(self) -> np.ndarray:
        """Positions and velocities at the requested instants [m, m/s], shape (n, 8), in the columns `COLUMNS`; zero for
        coordinates that the problem does not have."""
        return self._samples() if callable(self._samples) else self._samples

    @cached_property
    def events(self) -> np.ndarray | None:
        """`time` [s] and `kind` of the contacts and of the body's changes of state, ordered by time; None from a
        program that locates no events."""
        return self._events() if callable(self._events) else self._events


class Program(NamedTuple):
    """A program to compare; see the module's docstring.

    `prepare` takes a problem (`harness.Problem`) and a `Setting`. `version` returns the program's version. `is_dense`
    is false for a program without output between its steps. `command` is empty for a program that runs in this process;
    else it starts a process that measures one setting. The problem's name, the number of the setting and the time limit
    [s] are appended to it.
    """

    name: str
    settings: tuple[Setting, ...]
    prepare: Callable[[Any, Setting], Callable[[], Answer]]
    version: Callable[[], str] = str
    is_dense: bool = True
    command: tuple[str, ...] = ()


def steps(*values: float) -> tuple[Setting, ...]:
    """Settings with the given steps [s]."""
    return tuple(Setting(value, f"step {value:g} s", is_step=True) for value in values)


def tolerances(*values: float) -> tuple[Setting, ...]:
    """Settings with the given tolerances."""
    return tuple(Setting(value, f"tolerance {value:g}") for value in values)


def event_array(events: Iterable[tuple[float, str]]) -> np.ndarray:
    """Return pairs of instant [s] and kind as an array for `Answer.events`, ordered by time."""
    return ordered_events(np.array([(time, kind) for time, kind in events], dtype=EVENT_DTYPE))


def ordered_events(events: np.ndarray) -> np.ndarray:
    """Return records with the fields `time` and `kind` as an array for `Answer.events`, ordered by time."""
    ordered = np.empty(len(events), EVENT_DTYPE)
    order = np.argsort(events["time"], kind="stable")
    for name in ("time", "kind"):
        ordered[name] = events[name][order]
    return ordered


def drive_speed(scene: "Scene") -> float | None:
    """Speed [rad/s] to command at t = 0, or None if the scene's motor turns from the start."""
    return min(DRIVE_SPEED, scene["motor.max_speed"]) if scene["motor.speed"] == 0.0 else None


def by_device(method: str, scene: "Scene", times: np.ndarray, value: float) -> Answer:
    """Run a `solver.method` of the device at instants [s], shape (n,), with a step [s] or a tolerance `value`."""
    return _device_run(method, scene, np.asarray(times, dtype=float), value)()


def _prepared(method: str) -> Callable[[Any, Setting], Callable[[], Answer]]:
    return lambda problem, setting: _device_run(method, problem.scene, problem.times, setting.value)


def _device_run(method: str, scene: "Scene", times: np.ndarray, value: float) -> Callable[[], Answer]:
    from vibro_ros import SimulationError, Simulator

    parameter = "solver.tolerance" if method == "exact" else "solver.step"
    scene = scene.with_parameters({"solver.method": method, parameter: value, "solver.accounts": False})
    Simulator(scene).advance_to(0.0)  # the tables of a scene are not part of the method's cost

    def run() -> Answer:
        device = Simulator(scene)
        if (speed := drive_speed(scene)) is not None:
            device.command(motor_speed=speed)
        try:
            samples = device.sample(times)
        except SimulationError as error:
            raise UnableError(str(error)) from error
        events = device.take_events()
        return Answer(lambda: np.stack([getattr(samples, column) for column in COLUMNS], axis=1),
                      lambda: ordered_events(events[~np.isin(events["kind"], _FORCING_EVENTS)]))

    return run


def _version() -> str:
    from importlib.metadata import version

    return f"vibro_ros {version('vibro_ros')}"


def _decades(coarsest: float, finest: float) -> Sequence[float]:
    count = round(np.log10(coarsest / finest))
    return [float(f"{coarsest * 10.0**-k:.3g}") for k in range(count + 1)]


#: The device's own methods by name. `exact` has one setting, because a looser tolerance saves nothing.
DEVICE: dict[str, Program] = {
    "exact": Program("exact", (Setting(1e-9, "as it comes", PLAIN),), _prepared("exact"), _version),
    **{name: Program(name, steps(*_decades(1e-3, 1e-7)), _prepared(name), _version)
       for name in ("rk4", "rk4_located")}}
