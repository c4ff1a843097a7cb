"""The exact motion between the samples that a live robot publishes.

A sample says where everything is and how fast, so that the simulator goes on from it and says where everything was
until the next sample. It counts as exact if it lands on that sample to within `AGREEMENT`. What the robot was told need
not be known: the motor's speed and the plates' places at the next sample tell where they were sent.
"""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.view.assembly import Assembly, Span, spans
from vibro_ros.view.contacts import Impact, as_json, impacts_of, instants_of
from vibro_ros.view.interpolation import interpolated
from vibro_ros.view.machine import shown
from vibro_ros.view.motion import Document
from vibro_ros.view.recorded import RATES, Track
from vibro_ros.view.resimulation import AGREEMENT
from vibro_ros.view.stretch import Command, Stretch

DRIFT = 2e-11
"""Distance [m, rad] from a published position, beyond which the simulation goes on from what was published."""
_STAMP = 2e-9  # s, of a stamp's rounding and of its difference's
#: Change of the speed [rad/s] that a lagging motor is sent to, which is rounding of published speeds.
NO_COMMAND = 1e-9
PLACES = ("position", "height", "angle")


class Between:
    """Makes motions of the samples of one robot.

    Parameters
    ----------
    scene : Scene
        What the robot simulates, as its parameters are now.
    """

    def __init__(self, scene: Scene):
        self._device = Simulator(scene)
        self._names = shown(scene)
        self._state = [name for name in UNITS if name in self._names]

    def motion(self, samples: Mapping[str, np.ndarray]) -> Document:
        """The motion from the first of some samples to the last.

        Parameters
        ----------
        samples : mapping of str to ndarray, each of shape (n,)
            Fields of `Samples`: ``time`` [s], ascending, and what was published of the others, with NaN or without the
            field where something was not.

        Returns
        -------
        header, payload : dict, bytes
            The document, see `motion`. ``why`` names the first reason why not all is exact.
        """
        samples = _finite(samples)
        times, found = _regular(samples["time"]), _Found([], [], [], [], [])
        if missing := [name for name in self._state if name not in samples]:
            found.faults.append(f"{missing[0]} is not published")
        elif len(times) > 1:
            _Following(self._device, self._state, samples, times, found).follow()
        rest = [interpolated(_tracks(samples, times), self._names, begin, end)
                for begin, end in _not_exact(found.stretches, times, found.resets)]
        made = Assembly(self._names, found.stretches, found.instants, rest)
        made.write()
        exact = made.resolved and not any(len(borders) for borders, _ in rest)
        return made.writer.document({
            "exact": exact, "why": "" if exact else _why(found.faults), "exact_spans": spans(found.stretches),
            "impacts": as_json(found.impacts), "resets": found.resets})


class _Found(NamedTuple):
    """What comes of following the samples."""

    stretches: list[Stretch]
    instants: list[np.ndarray]
    impacts: list[Impact]
    resets: list[float]
    faults: list[str]


class _Following:
    """Follows samples with a device, from sample to sample; the device's own time is 0 where it was last put."""

    def __init__(self, device: Simulator, state: list[str], samples: Mapping[str, np.ndarray], times: np.ndarray,
                 found: _Found):
        self._device, self._state, self._samples, self._times, self._found = device, state, samples, times, found
        self._positions = [name for name in state if name.endswith(PLACES)]
        self._since: int | None = None  # the sample at which the device was put where it was published
        self._start, self._commands = np.empty(0), list[Command]()
        self._plates: dict[str, float] = {}  # where they were sent [m]

    def follow(self) -> None:
        """Go through all samples."""
        for k in range(len(self._times) - 1):
            if self._samples["crank_angle"][k + 1] < self._samples["crank_angle"][k]:
                self._end(k)
                self._found.resets.append(float(self._times[k + 1]))
            else:
                self._pass(k)
        self._end(len(self._times) - 1)

    def _pass(self, k: int) -> None:
        """Go from the sample k to the next one; where that fails, from where sample k was published."""
        try:
            if self._since is None:
                self._put(k)
            distance = self._go(k)
            if distance > AGREEMENT and self._since != k:
                self._end(k)
                self._put(k)
                distance = self._go(k)
        except (ValueError, SimulationError) as error:
            self._fail(k, str(error))
            return
        if distance > AGREEMENT:
            self._fail(k, f"the simulator is {distance:.2g} m or rad off at the next sample")
            return
        events = self._device.take_events()
        self._found.instants.append(instants_of(events, self._offset))
        self._found.impacts.extend(impacts_of(events, self._offset))
        if distance > DRIFT:
            self._end(k + 1)

    @property
    def _offset(self) -> float:
        return float(self._times[self._since or 0])

    def _put(self, k: int) -> None:
        """Put the device where sample k was published."""
        device = self._device
        device.reset()
        device.set_state(**{name: float(self._samples[name][k]) for name in self._state if name in UNITS})
        scene = device.scene
        self._plates = {side: scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] for side in scene.plates}
        self._since, self._start, self._commands = k, device.checkpoint(), []

    def _go(self, k: int) -> float:
        """Go to the sample after k; the greatest distance from a published position [m, rad] there."""
        device, begin = self._device, float(self._times[self._since or 0])
        if command := {**self._motor(k), **dict(self._gaps(k))}:
            self._commands.append((device.time, command))
            device.command(**command)
        device.advance_to(max(device.time, float(self._times[k + 1]) - begin))
        state = device.state
        return max(abs(getattr(state, name) - float(self._samples[name][k + 1])) for name in self._positions)

    def _motor(self, k: int) -> dict[str, float]:
        """Command after which the motor has the speed [rad/s] of the sample after k; none if it will anyway."""
        scene, speed = self._device.scene, float(self._samples["motor_speed"][k + 1])
        if scene["effects.motor"] == "lag":
            now, left = self._device.state.motor_speed, math.exp(
                -float(self._times[k + 1] - self._times[k]) / scene["motor.time_constant"])
            target = min(max((speed - now * left) / (1.0 - left), 0.0), scene["motor.max_speed"])
            if abs(target - self._device.commanded_motor_speed) <= NO_COMMAND:
                return {}
            return {"motor_speed": target}
        return {} if self._device.commanded_motor_speed == speed else {"motor_speed": speed}

    def _gaps(self, k: int) -> Iterator[tuple[str, float]]:
        """Commands after which the plates stand where they do in the sample after k."""
        for side, sent in self._plates.items():
            place = float(self._samples[f"{side}_plate_position"][k + 1])
            if place != sent:
                self._plates[side] = place
                yield f"{side}_gap", place - self._device.scene[f"crank.{side}_rod"]

    def _end(self, k: int) -> None:
        """End the stretch at the sample k."""
        if self._since is not None and k > self._since:
            end, scene = float(self._times[k]) - self._offset, self._device.scene
            commands = tuple(one for one in self._commands if one[0] < end)
            self._found.stretches.append(Stretch(scene, self._start, 0.0, end, self._offset, commands))
        self._since = None
        self._device.take_events()

    def _fail(self, k: int, fault: str) -> None:
        self._found.faults.append(f"between {self._times[k]:.6f} s and {self._times[k + 1]:.6f} s {fault}")
        self._end(k)


def _finite(samples: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The samples by ascending time, without fields that nobody published; of the state, no instant is left open."""
    times = np.asarray(samples["time"], dtype=float)
    columns = {name: np.asarray(column, dtype=float) for name, column in samples.items()}
    columns = {name: column for name, column in columns.items() if np.isfinite(column).any()}
    whole = np.isfinite(times)
    for name in UNITS:
        whole &= np.isfinite(columns.get(name, times))
    order = np.flatnonzero(whole)
    order = order[np.unique(times[order], return_index=True)[1]]
    return {**{"time": times[order]}, **{name: column[order] for name, column in columns.items() if name != "time"}}


def _regular(times: np.ndarray) -> np.ndarray:
    """The instants [s] of a robot's samples, whose stamps are rounded to nanoseconds: in that time a mass moves by
    more than `AGREEMENT`."""
    pauses = np.diff(times)
    if len(pauses) == 0:
        return times
    period = float(pauses[pauses < 1.5 * np.median(pauses)].mean())
    even = times[0] + np.rint((times - times[0]) / period) * period
    return even if np.abs(even - times).max() <= _STAMP else times


def _tracks(samples: Mapping[str, np.ndarray], times: np.ndarray) -> dict[str, Track]:
    return {name: Track(times, values, samples.get(RATES.get(name, ""))) for name, values in samples.items()
            if name != "time"}


def _not_exact(stretches: list[Stretch], times: np.ndarray, resets: list[float]) -> Iterator[Span]:
    """Begin and end [s] of what no stretch covers; nothing is between a reset and the sample before."""
    if not len(times):
        return
    begin, last = float(times[0]), float(times[-1])
    for one in [*spans(stretches), (last, last)]:
        after = [time for time in times[(times > begin) & (times <= one[0])].tolist() if time not in resets]
        if after:
            yield begin, one[0]
        begin = one[1]


def _why(faults: list[str]) -> str:
    first = faults[0] if faults else "the pieces do not follow every step of the method"
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return f"{first}{more}; there the motion is interpolated between the samples"
