"""Samples followed by the simulator, when the commands that the robot received are unknown.

A sample says where everything is and how fast, so that the simulator goes on from it and says where everything was
until the next sample. It counts as exact if it lands on that sample to within `AGREEMENT`. The commands need not be
known: the motor's speed and the plates' places at the next sample say where they were sent.
"""

import functools
import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.recordings.rerun import LONGEST_PAUSE
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.samples import resets
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.view.machine import quantities
from vibro_ros.view.motion import is_place
from vibro_ros.view.recorded import Track
from vibro_ros.view.stretch import AGREEMENT, LONGEST, ExactRun, quiet_device

DRIFT = 2e-11
"""Distance [m, rad] from a recorded position, beyond which the simulation goes on from what was recorded."""
_STAMP = 2e-9  # s, of a stamp's rounding and of its difference's
#: Change of the speed [rad/s] that a lagging motor is sent to, which is rounding of published speeds.
_NO_COMMAND = 1e-9
_TRIED = 100  # samples by which a scene is recognised


def state_of(scene: Scene) -> list[str]:
    """Fields of `Samples` that say where a robot of this scene is, and how fast."""
    known = quantities(scene)
    return [name for name in UNITS if name in known]


class Following(ExactRun):
    """Follows samples with a device, from sample to sample; the device's own time is 0 where it was last put.

    The device is overwritten. `samples` are all that `state_of` names, finite, at the ascending `times` [s].
    """

    def __init__(self, device: Simulator, samples: Mapping[str, np.ndarray], times: np.ndarray):
        super().__init__()
        self._device, self._samples, self._times = device, samples, times
        self._state = state_of(device.scene)
        self._positions = [name for name in self._state if is_place(name)]
        self._failed, self._first_fault = 0, ""
        self._since: int | None = None  # the sample at which the device was put where it was published
        self._plates: dict[str, float] = {}  # where they were sent [m]

    def follow(self) -> None:
        """Go through all samples."""
        of_crank = self._samples["crank_angle"], self._samples["motor_speed"]
        for k, is_reset in enumerate(resets(self._times, *of_crank)):
            if is_reset:
                self._end(k)
                self.resets.append(float(self._times[k + 1]))
            elif self._times[k + 1] - self._times[k] > LONGEST_PAUSE:  # a spoilt stamp would ask for years
                self._fail(k, "nothing is known")
            else:
                self._pass(k)
        self._end(len(self._times) - 1)
        if self._failed:
            more = f" (and {self._failed - 1} intervals more)" if self._failed > 1 else ""
            self.faults.append(self._first_fault + more)

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
        self.note(self._device.take_events(), math.inf, self._offset)
        if distance > DRIFT:
            self._end(k + 1)
        elif self._device.time - self.begin >= LONGEST:
            self.close(self._device.scene, float(self._times[k + 1]) - self._offset, self._offset)
            self.open(self._device)

    @property
    def _offset(self) -> float:
        return float(self._times[self._since or 0])

    def _put(self, k: int) -> None:
        device = self._device
        device.reset()
        device.set_state(**{name: float(self._samples[name][k]) for name in self._state})
        scene = device.scene
        self._plates = {side: scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] for side in scene.plates}
        self._since = k
        self.open(device)

    def _go(self, k: int) -> float:
        """Go to the sample after k; the greatest distance from a published position [m, rad] there."""
        device = self._device
        command = self._motor(k)
        for side, sent in self._plates.items():
            place = float(self._samples[f"{side}_plate_position"][k + 1])
            if place != sent:
                self._plates[side] = place
                command[f"{side}_gap"] = place - device.scene[f"crank.{side}_rod"]
        if command:
            self.command(device, command)
        device.advance_to(max(device.time, float(self._times[k + 1]) - self._offset))
        state = device.state
        return max(abs(getattr(state, name) - float(self._samples[name][k + 1])) for name in self._positions)

    def _motor(self, k: int) -> dict[str, float]:
        """Command after which the motor has the speed [rad/s] of the sample after k; none if it will anyway."""
        scene, speed = self._device.scene, float(self._samples["motor_speed"][k + 1])
        if scene["effects.motor"] == "lag":
            now, left = self._device.state.motor_speed, math.exp(
                -float(self._times[k + 1] - self._times[k]) / scene["motor.time_constant"])
            target = min(max((speed - now * left) / (1.0 - left), -scene["motor.max_speed"]), scene["motor.max_speed"])
            if abs(target - self._device.commanded_motor_speed) <= _NO_COMMAND:
                return {}
            return {"motor_speed": target}
        return {} if self._device.commanded_motor_speed == speed else {"motor_speed": speed}

    def _end(self, k: int) -> None:
        """Let nothing be known from the sample k on."""
        if self._since is not None:
            self.close(self._device.scene, float(self._times[k]) - self._offset, self._offset)
        self._since = None
        self._device.take_events()

    def _fail(self, k: int, fault: str) -> None:
        self._first_fault = self._first_fault or f"from {self._times[k]:.6g} s to {self._times[k + 1]:.6g} s {fault}"
        self._failed += 1
        self._end(k)


def common_samples(tracks: Mapping[str, Track], names: Sequence[str]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Recorded quantities at the instants [s] at which all of `names` were recorded, and these instants."""
    times = functools.reduce(lambda one, other: np.intersect1d(one, other, assume_unique=True),
                             [tracks[name].times for name in names])
    return {name: tracks[name].values[np.searchsorted(tracks[name].times, times)] for name in names}, times


def recognised(scenes: Iterable[Scene], tracks: Mapping[str, Track]) -> Scene | None:
    """The scene that lands on most of the samples where the crank turns fastest; None if none does on half of them."""
    best, most = None, 0.5
    for scene in scenes:
        names = state_of(scene)
        if {name for name in tracks if name in UNITS} != set(names):
            continue
        samples, times = common_samples(tracks, names)
        if len(times) < 2:
            continue
        first = max(0, min(int(np.argmax(np.abs(samples["motor_speed"]))), len(times) - _TRIED))
        tried = slice(first, first + _TRIED)
        trial = Following(quiet_device(scene), {name: column[tried] for name, column in samples.items()},
                          regular(times[tried]))
        trial.follow()
        share = sum(one.end - one.begin for one in trial.stretches) / float(np.ptp(times[tried]))
        if share > most:
            best, most = scene, share
    return best


def regular(times: np.ndarray) -> np.ndarray:
    """The instants [s] of a robot's samples, whose stamps are rounded to nanoseconds: in that time a mass moves by
    more than `AGREEMENT`."""
    pauses = np.diff(times)
    if len(pauses) == 0:
        return times
    period = float(pauses[pauses < 1.5 * np.median(pauses)].mean())
    even = times[0] + np.rint((times - times[0]) / period) * period
    return even if np.abs(even - times).max() <= _STAMP else times
