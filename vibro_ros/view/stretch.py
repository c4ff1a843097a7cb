"""A device on its way from one instant to another, which can be sampled as often as wanted."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator, ToleranceWarning

#: A command at an instant of the device's own time [s]: arguments of `Simulator.command`.
Command = tuple[float, dict[str, float]]


class Stretch(NamedTuple):
    """A device from one sample to a later one.

    Attributes
    ----------
    scene : Scene
        What is simulated.
    start : ndarray, shape (n,)
        Checkpoint at the begin, before the commands there.
    begin, end : float
        Device's own time [s].
    offset : float
        What is added to it to get robot time [s].
    commands : tuple of Command
        From `begin` to before `end`; the device took each of them.
    """

    scene: Scene
    start: np.ndarray
    begin: float
    end: float
    offset: float
    commands: tuple[Command, ...] = ()

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


@contextmanager
def quiet() -> Iterator[None]:
    """No warning of a tolerance that a scene cannot keep: its robot has given it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)
        yield


def quiet_device(scene: Scene) -> Simulator:
    """The device of a scene, without that warning."""
    with quiet():
        return Simulator(scene)


def sampled(device: Simulator, times: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Quantities `names` at ascending `times` [s] of the device's own, shape (n, names)."""
    samples = device.sample(times)
    return np.column_stack([getattr(samples, name) for name in names])
