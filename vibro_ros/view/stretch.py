"""Stretches of a run that the simulator computes again, each of which can be sampled as often as wanted."""

import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.sensors.device import new_device
from vibro_ros.simulation.simulator import Simulator, ToleranceWarning
from vibro_ros.view.motion import Impact, impacts_of

AGREEMENT = 1e-9
"""Distance [m, rad] from every recorded position within which a run computed again counts as the same; besides
1e-12 of the position itself."""
LONGEST = 1.0
"""Longest stretch [s]: what is sampled of it fits in memory, and Ctrl-C is heard after each."""
MOST_EVENTS = 20_000
"""Events in a stretch, beyond which it is not cut at each of them: that would be more than a picture can show."""

#: A command at an instant of the device's own time [s]: arguments of `Simulator.command`.
Command = tuple[float, dict[str, float]]
Span = tuple[float, float]
"""Begin and end [s]."""
Progress = Callable[[float], object]
"""Is given the share of the work that is done, from 0 to 1."""


class Stretch(NamedTuple):
    """A device from one sample to a later one, by its own time [s]; `offset` is added to it to get robot time [s].

    `start` is a checkpoint at the begin, before the commands there; the device took each of the commands, which lie
    from `begin` to before `end`.
    """

    scene: Scene
    start: np.ndarray
    begin: float
    end: float
    offset: float
    commands: tuple[Command, ...] = ()

    @property
    def span(self) -> Span:
        """Begin and end in robot time [s]."""
        return self.begin + self.offset, self.end + self.offset

    def values(self, device: Simulator, times: np.ndarray, names: Sequence[str]) -> np.ndarray:
        """Quantities `names` at ascending `times` [s] of the device's own, shape (n, names); overwrites `device`."""
        device.restore(self.start)
        parts, done = [], 0
        for instant, command in self.commands:
            upto = int(np.searchsorted(times, instant))
            if upto > done:
                parts.append(sampled(device, times[done:upto], names))
            device.advance_to(instant)
            device.command(**command)
            done = upto
        parts.append(sampled(device, times[done:], names))
        device.take_events()
        return np.concatenate(parts)


class ExactRun:
    """Gathers the stretches of a device that passes through recorded samples, and the events in them.

    All times are robot time [s]: `stretches` are all that is exact, `instants` those of every event, and of both ends
    of a contact, `impacts` those in exact stretches, `resets` the samples at which the robot stood at its start again.
    `faults` say what ended an exact stretch.
    """

    def __init__(self):
        self.stretches: list[Stretch] = []
        self.instants: list[np.ndarray] = []
        self.impacts: list[Impact] = []
        self.resets: list[float] = []
        self.faults: list[str] = []

    def open(self, device: Simulator) -> None:
        """Begin a stretch where the device is."""
        self._start, self.begin, self.commands = device.checkpoint(), device.time, list[Command]()

    def command(self, device: Simulator, command: dict[str, float]) -> None:
        """Give the device a command within the stretch."""
        device.command(**command)
        self.commands.append((device.time, command))

    def close(self, scene: Scene, end: float, offset: float) -> None:
        """End the stretch at a device's own time [s]."""
        if end > self.begin:
            commands = tuple(one for one in self.commands if one[0] < end)
            self.stretches.append(Stretch(scene, self._start, self.begin, end, offset, commands))

    def note(self, events: np.ndarray, end: float, offset: float) -> None:
        """Keep the events, of dtype `EVENT_DTYPE`, that are over by a device's own time `end` [s]."""
        durations = np.where(np.isfinite(events["duration"]), events["duration"], 0.0)
        events = events[events["time"] + durations <= end][:MOST_EVENTS]
        times = events["time"] + offset
        self.instants.append(np.concatenate([times, (times + events["duration"])[events["duration"] > 0.0]]))
        self.impacts += impacts_of(events, offset)


def spans(stretches: Sequence[Stretch]) -> list[Span]:
    """Begin and end [s] of what is exact, stretches that meet as one."""
    found: list[Span] = []
    for begin, end in (one.span for one in stretches):
        if found and begin <= found[-1][1]:
            begin = found.pop()[0]
        found.append((begin, end))
    return found


def quiet() -> warnings.catch_warnings:
    """A context without the warning of a tolerance that a scene cannot keep: its robot has given it."""
    return warnings.catch_warnings(action="ignore", category=ToleranceWarning)


def quiet_device(scene: Scene) -> Simulator:
    """The device of a scene, without that warning."""
    with quiet():
        return new_device(scene)


def sampled(device: Simulator, times: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Quantities `names` at ascending `times` [s] of the device's own, shape (n, names)."""
    samples = device.sample(times)
    return np.column_stack([getattr(samples, name) for name in names])
