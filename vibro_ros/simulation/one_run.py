"""One scene from its start to its end: samples, events and statistics."""

import inspect
import math
import time as wall_clock
from collections.abc import Iterable, Mapping

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.sample_times import sample_times
from vibro_ros.simulation.samples import Run, Samples
from vibro_ros.simulation.simulator import Simulator

#: Instants [s], ascending, and what is commanded then, by the names of `Simulator.command`.
Commands = Iterable[tuple[float, Mapping[str, float]]]
_NAMES = tuple(inspect.signature(Simulator.command).parameters)[1:]


def simulate(scene: Scene, duration: float | None = None, rate: float | None = None,
             times: np.ndarray | None = None, tolerance: float | None = None, method: str | None = None,
             commands: Commands = ()) -> Run:
    """Simulate `scene` from its start.

    Parameters
    ----------
    scene : Scene
        What to simulate.
    duration : float
        Length of the run [s]; with `rate`.
    rate : float
        Samples per second, the first at t = 0.
    times : ndarray, shape (n,)
        Instants to sample [s], ascending, not negative; instead of `duration` and `rate`.
    tolerance, method : float [m], str
        Override the scene's `solver.tolerance` and `solver.method`.
    commands : iterable of (float, mapping)
        Instants [s], ascending, and what is commanded then: `motor_speed` [rad/s], `upper_gap`, `inclined_gap` [m].
        A sample at such an instant is taken after the command; commands after the last sample are not given.

    Returns
    -------
    Run
        The samples, the events up to the last one, and statistics.

    Raises
    ------
    ValueError
        For times that are not finite, negative or not ascending, an unknown method or tolerance, and a command beyond
        its limit.
    SimulationError
        If the run cannot go on.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("damped")
    >>> run = vibro_ros.simulate(scene, duration=1.0, rate=1000.0, commands=[(0.5, {"motor_speed": 120.0})])
    >>> len(run.time), f"{run.body_position[-1]:.6f} m"
    (1001, '-0.042608 m')
    >>> blows = run.events[run.events["kind"] == "upper_contact"]
    >>> f"{len(blows)} blows, the hardest {blows['peak_force'].max():.0f} N"
    '18 blows, the hardest 3493 N'
    """
    times, commands = sample_times(duration, rate, times), checked_commands(commands)
    if overrides := overriding(tolerance, method):
        scene = scene.with_parameters(overrides)
    began = wall_clock.perf_counter()
    device = Simulator(scene)
    samples = _commanded_samples(device, times, commands) if commands else device.sample(times)
    wall_time = wall_clock.perf_counter() - began
    events = device.take_events()
    events = events.take(np.argsort(events["time"], kind="stable"))
    return Run(**vars(samples), events=events, statistics={**device.statistics, "wall_time": wall_time})


def _commanded_samples(device: Simulator, times: np.ndarray, commands: Commands) -> Samples:
    """Sample `device` at `times`, giving each command before the samples at its instant."""
    parts, done = [], 0
    for instant, command in commands:
        upto = int(np.searchsorted(times, instant))
        if upto == len(times):
            break
        parts.append(device.sample(times[done:upto]))
        device.advance_to(instant)
        device.command(**command)
        done = upto
    parts.append(device.sample(times[done:]))
    return Samples(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def checked_commands(commands: Commands) -> tuple[tuple[float, dict[str, float]], ...]:
    """Copy of `commands`; a ValueError for instants and names that make no sense."""
    copied = tuple((float(instant), dict(command)) for instant, command in commands)
    instants = [0.0, *(instant for instant, _ in copied)]
    if not all(map(math.isfinite, instants)) or sorted(instants) != instants:
        raise ValueError("commands: give ascending, finite instants, none below 0 s")
    for name in (name for _, command in copied for name in command):
        if name not in _NAMES:
            raise ValueError(f"commands: {name!r} is no command; give {', '.join(_NAMES)}")
    return copied


def overriding(tolerance: float | None, method: str | None) -> dict[str, object]:
    """Parameters of the scene that the arguments of `simulate` override."""
    overrides = {"solver.tolerance": tolerance, "solver.method": method}
    return {name: value for name, value in overrides.items() if value is not None}
