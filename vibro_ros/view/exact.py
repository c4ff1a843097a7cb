"""The exact motion between samples: a device walks from sample to sample, and where it has been is kept.

A sample says where everything is and how fast. As long as the inputs that the robot received are known, the device gets
them, from the run's start, a reset or a checkpoint on: it goes *as the run did*. Where they are not known, or do not
lead to the next sample - one was lost, another version or computer rounds differently - the device is *put* where a
sample says, and goes on with the commands that explain the next sample: the motor's speed and the plates' places there
say where they were sent. An interval counts as exact if the device reaches the sample at its end to within `AGREEMENT`.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.operations import FAULT, PUSH, RESET, SET, STATE, TIMEOUT, read_operation
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, TOPICS, commands_in
from vibro_ros.model.scene import Scene
from vibro_ros.recordings.rerun import LONGEST_PAUSE, Rerun
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.samples import resets
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.view.drawing import quantities
from vibro_ros.view.motion import ExactInterval, Impact, Progress, Span, impacts_of, is_place
from vibro_ros.view.recorded import Input, Signal

AGREEMENT = 1e-9
"""Distance [m, rad] from every recorded position within which a computed motion counts as the same; of a run with known
inputs besides 1e-12 of the position itself."""
DRIFT = 2e-11
"""Distance [m, rad] from a recorded position, beyond which a device that was put goes on from what was recorded."""
LONGEST = 1.0
"""Longest interval [s]: what is sampled of it fits in memory, and Ctrl-C is heard after each."""
MOST_EVENTS = 20_000
"""Events between two samples, beyond which the motion is not cut at each: a picture cannot show so many."""
_STAMP = 2e-9  # s, of a stamp's rounding and of its difference's
_ROUNDING = 1e-9  # rad/s, a change of the speed that a lagging motor is sent to, which is rounding of published speeds


class ExactMotion:
    """Walks through samples at ascending `times` [s], NaN where a quantity was not recorded; overwrites `device`.

    `inputs` are by the number of the sample after which they came. `rerun` is the recorded run computed again, whose
    device walks, and `ticks` the run's own numbers of the samples; without it the device is put where a sample says.
    `is_known` says whether the device stands where the first sample was taken.

    All results are robot time [s]: `intervals` are all that is exact, `instants` those of every event, and of both ends
    of a contact, `impacts` those in exact intervals, `resets` the samples at which the robot stood at its start again,
    `run_since` when it first went as the run did, None for never. `faults` say what ended an exact interval.
    """

    def __init__(self, device: Simulator, samples: Mapping[str, np.ndarray], times: np.ndarray,
                 rerun: Rerun | None = None, ticks: np.ndarray | None = None,
                 inputs: Mapping[int, Sequence[Input]] | None = None, is_known: bool = False):
        self.intervals: list[ExactInterval] = []
        self.instants: list[np.ndarray] = []
        self.impacts: list[Impact] = []
        self.resets: list[float] = []
        self.faults: list[str] = []
        self.run_since = float(times[0]) if is_known else None
        self._device, self._samples, self._times = device, samples, times
        self._rerun, self._ticks, self._inputs = rerun, ticks, inputs or {}
        self._state = state_of(device.scene)
        self._places = [name for name in samples if is_place(name)]
        self._is_placed = self._follows_run = is_known  # somewhere that is known; there as the run did
        self._put_at = 0  # the sample at which the device was put
        self._plates: dict[str, float] = {}  # where they were sent since [m]
        self._failed, self._first_fault = 0, ""
        if is_known:
            self._open()

    def walk(self, progress: Progress = lambda share: None) -> None:
        """Go through all samples."""
        last = len(self._times) - 1
        jumps = np.zeros(max(0, last), bool)
        if {"crank_angle", "motor_speed"} <= set(self._samples):
            jumps = resets(self._times, self._samples["crank_angle"], self._samples["motor_speed"])
        if self._follows_run:  # a sample is taken before its inputs, at 0 s too
            self._device.advance_to(self._own_time(0))
        for k in range(last + 1):
            if k % 1000 == 0:
                progress(k / len(self._times))
            was_reset = self._receive(k)
            if k == last:
                self._end(k)
            elif jumps[k] and not was_reset:
                self._end(k)
                self.resets.append(float(self._times[k + 1]))
            elif self._times[k + 1] - self._times[k] > LONGEST_PAUSE:  # a spoilt stamp would ask for years
                self._end(k, "nothing was recorded for more than 10 s")
                self._fail(k, "nothing is known")
            else:
                self._pass(k)
        if self._failed:
            more = f" (and {self._failed - 1} intervals more)" if self._failed > 1 else ""
            self.faults.append(self._first_fault + more)

    def _pass(self, k: int) -> None:
        """Go from the sample k to the next one from where the device stands; else from where sample k was published."""
        if self._is_placed:
            fault = self._step(k)
            if not fault:
                return
            self._end(k, fault)
        try:
            self._put(k)
            fault = self._step(k)
        except (ValueError, SimulationError) as error:
            fault = str(error)
        if fault:
            self._end(k)
            self._fail(k, fault)

    def _step(self, k: int) -> str:
        """Go to the sample after k; why that is not where it was recorded, empty if it is."""
        try:
            if not self._follows_run and (commands := self._explained(k)):
                self._command(commands)
            self._device.advance_to(max(self._device.time, self._own_time(k + 1)))
        except (ValueError, SimulationError) as error:
            return f"the run cannot go on {error}" if self._follows_run else str(error)
        distance, name = self._distance(k + 1)
        if distance > AGREEMENT:
            return (f"{name} as computed is not what was recorded" if self._follows_run
                    else f"the simulator is {distance:.2g} m or rad off at the next sample")
        self._note()
        if distance > DRIFT and not self._follows_run:
            self._end(k + 1)
        elif self._device.time - self._begin >= LONGEST:
            self._close(k + 1)
            self._open()
        return ""

    def _distance(self, k: int) -> tuple[float, str]:
        """The greatest distance of the device from a position of the sample k [m, rad], and its name."""
        state = self._device.state
        worst, where = 0.0, ""
        for name in self._places:
            recorded = float(self._samples[name][k])
            distance = abs(getattr(state, name) - recorded) - (1e-12 * abs(recorded) if self._follows_run else 0.0)
            if distance > worst:  # NaN is no distance
                worst, where = distance, name
        return worst, where

    def _put(self, k: int) -> None:
        """Put the device where the sample k says; ValueError where that was not recorded, or cannot be."""
        state = {name: float(self._samples[name][k]) for name in self._state if name in self._samples}
        if len(state) < len(self._state) or not np.isfinite([*state.values()]).all():
            raise ValueError("where the robot is was not published")
        self._follows_run, self._put_at, self._is_placed = False, k, True
        self._device.reset()
        self._device.set_state(**state)
        scene = self._device.scene
        self._plates = {side: scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] for side in scene.plates}
        self._open()

    def _explained(self, k: int) -> dict[str, float]:
        """Commands after which motor and plates are where the sample after k has them."""
        device, commands = self._device, {}
        scene, speed = device.scene, float(self._samples["motor_speed"][k + 1])
        if not math.isfinite(speed):
            raise ValueError("where the robot is was not published")
        if scene["effects.motor"] == "lag":
            left = math.exp(-float(self._times[k + 1] - self._times[k]) / scene["motor.time_constant"])
            target = (speed - device.state.motor_speed * left) / (1.0 - left)
            target = min(max(target, -scene["motor.max_speed"]), scene["motor.max_speed"])
            if abs(target - device.commanded_motor_speed) > _ROUNDING:
                commands["motor_speed"] = target
        elif device.commanded_motor_speed != speed:
            commands["motor_speed"] = speed
        for side, sent in self._plates.items():
            place = float(self._samples[f"{side}_plate_position"][k + 1])
            if place != sent:
                self._plates[side] = place
                commands[f"{side}_gap"] = place - scene[f"crank.{side}_rod"]
        return commands

    def _receive(self, k: int) -> bool:
        """Give the device what the robot received after the sample k; whether a reset was among it."""
        was_reset = False
        for one in self._inputs.get(k, ()):
            try:
                if one.name == CHECKPOINT:
                    self._restore(k, one.data)
                elif one.name == OPERATIONS:
                    was_reset |= self._operate(k, one.data)
                elif self._follows_run:
                    message = deserialised(one.data, TOPICS[one.name].type)
                    for argument, value in commands_in(one.name, message, self._device.scene)[0].items():
                        with suppress(ValueError):  # the robot refused it as well
                            self._command({argument: value})
            except ValueError:
                pass  # the robot refused it as well
            except SimulationError as error:
                self._end(k, f"the run cannot go on {error}")
        return was_reset

    def _restore(self, k: int, data: bytes) -> None:
        """Stand where a checkpoint says, unless the device goes as the run did already."""
        if self._follows_run or self._rerun is None or self._ticks is None:
            return
        self._end(k)
        self._rerun.restore(int(self._ticks[k]), data)
        self._go_as_run(k)

    def _operate(self, k: int, data: bytes) -> bool:
        """Do an operation, which begins another interval; whether it was a reset.

        Pauses and steps do nothing, because samples count. What is unknown stays so but after a reset.
        """
        operation = read_operation(deserialised(data, TOPICS[OPERATIONS].type).data)
        if self._rerun is None or self._ticks is None:
            return False
        if operation.name == TIMEOUT and self._follows_run:
            self._command({self._device.scene.motor_command: 0.0})
        if operation.name not in ((RESET, SET, STATE, PUSH, FAULT) if self._follows_run else (RESET, SET)):
            return False
        was_run = self._follows_run
        self._end(k)
        self._rerun.tick = int(self._ticks[k])
        self._rerun.receive(OPERATIONS, data)
        if operation.name == RESET:
            self.resets.append((int(self._ticks[k]) + 1) / self._rerun.rate)
        if was_run or operation.name == RESET:
            self._go_as_run(k)
        return operation.name == RESET

    def _go_as_run(self, k: int) -> None:
        self._is_placed = self._follows_run = True
        if self.run_since is None:
            self.run_since = float(self._times[k])
        self._open()

    def _open(self) -> None:
        """Begin an interval where the device is."""
        self._start, self._begin = self._device.checkpoint(), self._device.time
        self._commands: list[tuple[float, dict[str, float]]] = []

    def _command(self, command: dict[str, float]) -> None:
        """Give the device a command within the interval."""
        self._device.command(**command)
        self._commands.append((self._device.time, command))

    def _close(self, k: int) -> None:
        """End the interval at the sample k."""
        end = self._own_time(k)
        if end > self._begin:
            commands = tuple(one for one in self._commands if one[0] < end)
            self.intervals.append(ExactInterval(self._device.scene, self._start, self._begin, end, self._offset,
                                                commands))

    def _end(self, k: int, fault: str = "") -> None:
        """From the sample k on the device stands nowhere, because of a `fault` if it went as the run did."""
        if self._is_placed:
            self._close(k)
            if self._follows_run and fault:
                self.faults.append(f"after {float(self._times[k]):.6g} s {fault}")
        self._is_placed = self._follows_run = False
        self._device.take_events()

    def _fail(self, k: int, fault: str) -> None:
        self._first_fault = self._first_fault or f"from {self._times[k]:.6g} s to {self._times[k + 1]:.6g} s {fault}"
        self._failed += 1

    def _note(self) -> None:
        """Keep the events since the last sample."""
        events = self._device.take_events()[:MOST_EVENTS]
        times = events["time"] + self._offset
        self.instants.append(np.concatenate([times, (times + events["duration"])[events["duration"] > 0.0]]))
        self.impacts += impacts_of(events, self._offset)

    @property
    def _offset(self) -> float:
        """Robot time at which the device's own time is 0 [s]."""
        return self._rerun.origin / self._rerun.rate if self._rerun and self._follows_run else float(
            self._times[self._put_at])

    def _own_time(self, k: int) -> float:
        """The device's own time [s] at a sample; a device that was reset stands at its start before its first one."""
        if self._rerun and self._ticks is not None and self._follows_run:
            return max(0.0, (int(self._ticks[k]) - self._rerun.origin) / self._rerun.rate)
        return max(0.0, float(self._times[k]) - self._offset)


def spans(intervals: Sequence[ExactInterval]) -> list[Span]:
    """Begin and end [s] of what is exact, intervals that meet as one."""
    found: list[Span] = []
    for begin, end in (one.span for one in intervals):
        if found and begin <= found[-1][1]:
            begin = found.pop()[0]
        found.append((begin, end))
    return found


def between(intervals: Sequence[ExactInterval], begin: float, end: float) -> list[Span]:
    """Begin and end [s] of what is not exact from `begin` to `end`, also where both are the same."""
    borders = [begin, *np.ravel(spans(intervals)).tolist(), end]
    return list(zip(borders[::2], borders[1::2], strict=True))


def state_of(scene: Scene) -> list[str]:
    """Fields of `Samples` that say where a robot of this scene is, and how fast."""
    known = quantities(scene)
    return [name for name in UNITS if name in known]


def common_samples(signals: Mapping[str, Signal], names: Sequence[str]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Recorded quantities at the instants [s] at which all of `names` were recorded, and these instants."""
    times = functools.reduce(lambda one, other: np.intersect1d(one, other, assume_unique=True),
                             [signals[name].times for name in names])
    return {name: signals[name].values[np.searchsorted(signals[name].times, times)] for name in names}, times


def regular(times: np.ndarray) -> np.ndarray:
    """The instants [s] of a robot's samples, whose stamps are rounded to nanoseconds: in that time a mass moves by
    more than `AGREEMENT`."""
    pauses = np.diff(times)
    if len(pauses) == 0:
        return times
    period = float(pauses[pauses < 1.5 * np.median(pauses)].mean())
    even = times[0] + np.rint((times - times[0]) / period) * period
    return even if np.abs(even - times).max() <= _STAMP else times
