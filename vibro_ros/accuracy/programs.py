"""What is compared: programs that simulate a problem, their settings, and what they answer.

1. A `Program` is a name, its settings from coarse to fine, and `prepare(problem, setting)`. `prepare` compiles what is
   not to be counted and returns a function without arguments.
2. Each call of that function is one run from the start to the last of `problem.times`, and returns an `Answer`.
3. What the program cannot do, it says by `UnableError`, in one line.
4. A program that knows nothing between its steps is not `is_dense`, and is asked for ends of steps alone.

`DEVICE` are the device's own methods, which ship. The benchmark adds others in files of their own; a wrong one is added
the same way. This file imports numpy alone before a run is prepared, because a program may live in another Python.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from vibro_ros.model.scene import Scene

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
    """One use of a program: a step [s] or a tolerance, in words, and whether it is `PLAIN` or `TUNED`."""

    value: float
    label: str
    use: str = TUNED
    is_step: bool = False


@dataclass(frozen=True)
class Answer:
    """What a program found at the instants that it was asked for.

    Attributes
    ----------
    samples : ndarray, shape (n, 8)
        Positions and velocities there [m, m/s], by `COLUMNS`; zero for what the problem does not have.
    events : structured ndarray, shape (events,), or None
        By time: `time` [s] and `kind` of the contacts and of the body's changes of state; None from a program that
        locates no events.
    callbacks : callable, or None
        Gives the part of the run's wall time [s] that went into functions in Python which the program calls back.
    """

    samples: np.ndarray
    events: np.ndarray | None = None
    callbacks: Callable[[], float] | None = None


class Program(NamedTuple):
    """A program to compare; see the module.

    `prepare` takes a problem (`harness.Problem`) and a `Setting`. `version` is what the program says of itself.
    `is_dense` is false of a program that knows nothing between its steps. `command` is empty of a program that runs in
    this process; else the command of a process that measures one setting, to which the problem's name and the number
    of the setting are added.
    """

    name: str
    settings: tuple[Setting, ...]
    prepare: Callable[[Any, Setting], Callable[[], Answer]]
    version: Callable[[], str] = str
    is_dense: bool = True
    command: tuple[str, ...] = ()


def steps(*values: float) -> tuple[Setting, ...]:
    """Settings of so many steps [s]."""
    return tuple(Setting(value, f"step {value:g} s", is_step=True) for value in values)


def tolerances(*values: float) -> tuple[Setting, ...]:
    """Settings of so many tolerances."""
    return tuple(Setting(value, f"tolerance {value:g}") for value in values)


def event_array(found: Iterable[tuple[float, str]]) -> np.ndarray:
    """Instants [s] and kinds as `Answer.events`."""
    events = np.array([(time, kind) for time, kind in found], dtype=EVENT_DTYPE)
    return events[np.argsort(events["time"], kind="stable")]


def drive_speed(scene: "Scene") -> float | None:
    """Speed [rad/s] to command at t = 0, or None if the motor turns by itself."""
    return min(DRIVE_SPEED, scene["motor.max_speed"]) if scene["motor.speed"] == 0.0 else None


def by_device(method: str, scene: "Scene", times: np.ndarray, value: float) -> Answer:
    """A `solver.method` of the device itself, at instants [s], shape (n,), with a step [s] or a tolerance."""
    return _device_run(method, scene, np.asarray(times, dtype=float), value)()


def _prepared(method: str) -> Callable[[Any, Setting], Callable[[], Answer]]:
    return lambda problem, setting: _device_run(method, problem.scene, problem.times, setting.value)


def _device_run(method: str, scene: "Scene", times: np.ndarray, value: float) -> Callable[[], Answer]:
    from vibro_ros.simulation.motion import SimulationError
    from vibro_ros.simulation.simulator import Simulator

    parameter = "solver.tolerance" if method == "exact" else "solver.step"
    scene = scene.with_parameters({"solver.method": method, parameter: value, "solver.accounts": False})
    Simulator(scene).advance_to(0.0)  # what is compiled once a scene or once a process is not the method's cost

    def run() -> Answer:
        device = Simulator(scene)
        if (speed := drive_speed(scene)) is not None:
            device.command(motor_speed=speed)
        try:
            samples = device.sample(times)
        except SimulationError as error:
            raise UnableError(str(error)) from error
        events = [(event["time"], event["kind"]) for event in device.take_events()
                  if event["kind"] not in _FORCING_EVENTS]
        return Answer(np.stack([getattr(samples, column) for column in COLUMNS], axis=1), event_array(events))

    return run


def _version() -> str:
    from importlib.metadata import version

    return f"vibro_ros {version('vibro_ros')}"


def _decades(coarsest: float, finest: float) -> Sequence[float]:
    count = round(np.log10(coarsest / finest))
    return [float(f"{coarsest * 10.0**-k:.3g}") for k in range(count + 1)]


#: Name to program: the device's own methods. `exact` has one setting, because a looser tolerance saves nothing.
DEVICE: dict[str, Program] = {
    "exact": Program("exact", (Setting(1e-9, "as it comes", PLAIN),), _prepared("exact"), _version),
    **{name: Program(name, steps(*_decades(1e-3, 1e-7)), _prepared(name), _version)
       for name in ("rk4", "rk4_located")}}
#: What costs are ratios to: the device's own Runge-Kutta 4 with steps of 1e-5 s.
UNIT, UNIT_STEP = "rk4", 1e-5
UNIT_IN_WORDS = "the device's own Runge-Kutta 4 (`solver.method: rk4`) of 1e-5 s"
