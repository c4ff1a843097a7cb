"""The exact motion between samples: a device is simulated from sample to sample, and the exact intervals are kept.

A sample has all positions and speeds. As long as the inputs that the robot received are known, the device gets them,
from the run's start, a reset or a checkpoint on: it *follows the run*. Where the inputs are not known, or do not lead
to the next sample (one was lost, another version or computer rounds differently), the device is *put* into the state of
a sample, and goes on with commands that explain the next sample: the motor's speed and the plates' positions there show
what was commanded. An interval counts as exact if the device reaches the sample at its end to within `AGREEMENT`.
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
from vibro_ros.view.motion import ExactInterval, Impact, Progress, Span, impacts_of, is_position
from vibro_ros.view.protocol import quantities
from vibro_ros.view.recorded import Input, Signal

AGREEMENT = 1e-9
"""Largest distance [m, rad] of a simulated position from the recorded one for the motion to be exact; if the inputs are
known, 1e-12 of the position is allowed in addition."""
DRIFT = 2e-11
"""Distance [m, rad] from a recorded position beyond which a device that was put starts again from the recorded state.
"""
LONGEST = 1.0
"""Longest interval [s], so that its samples fit in memory, and Ctrl-C acts between intervals."""
MOST_EVENTS = 20_000
"""Most events between two samples at which the motion is cut; a picture cannot show more."""
_STAMP = 2e-9  # s, largest rounding error of the difference of two stamps
_ROUNDING = 1e-9  # rad/s, change of a lagging motor's command that is only rounding of the published speeds


class ExactMotion:
    """Simulates `device` through samples at ascending `times` [s], and collects the exact intervals.

    A quantity that was not recorded in a sample is NaN. `inputs` are those that came after a sample, by its number. If
    the inputs are known, `rerun` is the recorded run simulated again, `device` its device, and `ticks` are the samples'
    numbers in the run; without it the device is put into the state of a sample. `is_known` says whether the device is
    in the state of the first sample already.

    All results are in robot time [s]: `intervals` are the exact ones, `instants` those of every event and of the end of
    every contact, `impacts` those in exact intervals, `resets` the first samples after resets, `run_since` is the time
    from which the device first followed the run, None if never. `faults` say what ended exact intervals.
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
        self._position_names = [name for name in samples if is_position(name)]
        self._is_placed = self._follows_run = is_known  # has a known state; has it by following the run
        self._last_set = 0  # number of the sample at which the device was put
        self._plates: dict[str, float] = {}  # commanded positions of the plates since then [m]
        self._failed, self._first_fault = 0, ""
        if is_known:
            self._open()

    def walk(self, progress: Progress = lambda share: None) -> None:
        """Simulate the device through all samples."""
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
            elif self._times[k + 1] - self._times[k] > LONGEST_PAUSE:  # a damaged stamp would cost years
                self._end(k, "nothing was recorded for more than 10 s")
                self._fail(k, "nothing is known")
            else:
                self._pass(k)
        if self._failed:
            more = f" (and {self._failed - 1} intervals more)" if self._failed > 1 else ""
            self.faults.append(self._first_fault + more)

    def _pass(self, k: int) -> None:
        """Go from the sample k to the next one, from the device's state, or if that fails from the recorded state."""
        if self._is_placed:
            fault = self._step(k)
            if not fault:
                return
            self._end(k, fault)
        try:
            self._set_state(k)
            fault = self._step(k)
        except (ValueError, SimulationError) as error:
            fault = str(error)
        if fault:
            self._end(k)
            self._fail(k, fault)

    def _step(self, k: int) -> str:
        """Advance to the sample after k; return why its positions differ from the recorded ones, empty if not."""
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
        """Return the greatest distance of the device from a position in the sample k [m, rad], and its name."""
        state = self._device.state
        worst, where = 0.0, ""
        for name in self._position_names:
            recorded = float(self._samples[name][k])
            distance = abs(getattr(state, name) - recorded) - (1e-12 * abs(recorded) if self._follows_run else 0.0)
            if distance > worst:  # NaN is no distance
                worst, where = distance, name
        return worst, where

    def _set_state(self, k: int) -> None:
        """Put the device into the state of the sample k (ValueError if that is not recorded, or not possible)."""
        state = {name: float(self._samples[name][k]) for name in self._state if name in self._samples}
        if len(state) < len(self._state) or not np.isfinite([*state.values()]).all():
            raise ValueError("where the robot is was not published")
        self._follows_run, self._last_set, self._is_placed = False, k, True
        self._device.reset()
        self._device.set_state(**state)
        scene = self._device.scene
        self._plates = {side: scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] for side in scene.plates}
        self._open()

    def _explained(self, k: int) -> dict[str, float]:
        """Return the commands that lead motor and plates to their values in the sample after k."""
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
        """Pass the inputs that the robot received after the sample k to the device; return whether one was a reset."""
        was_reset = False
        for received in self._inputs.get(k, ()):
            try:
                if received.name == CHECKPOINT:
                    self._restore(k, received.data)
                elif received.name == OPERATIONS:
                    was_reset |= self._operate(k, received.data)
                elif self._follows_run:
                    message = deserialised(received.data, TOPICS[received.name].type)
                    for argument, value in commands_in(received.name, message, self._device.scene)[0].items():
                        with suppress(ValueError):  # the robot refused it as well
                            self._command({argument: value})
            except ValueError:
                pass  # the robot refused it as well
            except SimulationError as error:
                self._end(k, f"the run cannot go on {error}")
        return was_reset

    def _restore(self, k: int, data: bytes) -> None:
        """Restore the device from a checkpoint, unless it follows the run already."""
        if self._follows_run or self._rerun is None or self._ticks is None:
            return
        self._end(k)
        self._rerun.restore(int(self._ticks[k]), data)
        self._advance_as_run(k)

    def _operate(self, k: int, data: bytes) -> bool:
        """Perform an operation, which begins a new interval; return whether it was a reset.

        Pauses and steps do nothing, because robot time counts samples. A device that does not follow the run does so
        again after a reset, and after no other operation.
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
            self._advance_as_run(k)
        return operation.name == RESET

    def _advance_as_run(self, k: int) -> None:
        self._is_placed = self._follows_run = True
        if self.run_since is None:
            self.run_since = float(self._times[k])
        self._open()

    def _open(self) -> None:
        """Begin an interval at the device's present state."""
        self._start, self._begin = self._device.checkpoint(), self._device.time
        self._commands: list[tuple[float, dict[str, float]]] = []

    def _command(self, command: dict[str, float]) -> None:
        """Pass a command to the device, and note it in the interval."""
        self._device.command(**command)
        self._commands.append((self._device.time, command))

    def _close(self, k: int) -> None:
        """End the interval at the sample k."""
        end = self._own_time(k)
        if end > self._begin:
            commands = tuple(command for command in self._commands if command[0] < end)
            self.intervals.append(ExactInterval(self._device.scene, self._start, self._begin, end, self._offset,
                                                commands))

    def _end(self, k: int, fault: str = "") -> None:
        """End the interval at the sample k; from there on the device's state is unknown.

        A `fault` is noted if the device followed the run.
        """
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
        """Collect instants and impacts from the events since the last sample."""
        events = self._device.take_events()[:MOST_EVENTS]
        times = events["time"] + self._offset
        self.instants.append(np.concatenate([times, (times + events["duration"])[events["duration"] > 0.0]]))
        self.impacts += impacts_of(events, self._offset)

    @property
    def _offset(self) -> float:
        """Robot time at which the device's own time is 0 [s]."""
        return self._rerun.origin / self._rerun.rate if self._rerun and self._follows_run else float(
            self._times[self._last_set])

    def _own_time(self, k: int) -> float:
        """Return the device's own time [s] at a sample; 0 if the device was reset after that sample."""
        if self._rerun and self._ticks is not None and self._follows_run:
            return max(0.0, (int(self._ticks[k]) - self._rerun.origin) / self._rerun.rate)
        return max(0.0, float(self._times[k]) - self._offset)


def spans(intervals: Sequence[ExactInterval]) -> list[Span]:
    """Return begin and end [s] of the exact spans; intervals that meet are joined."""
    joined: list[Span] = []
    for begin, end in (interval.span for interval in intervals):
        if joined and begin <= joined[-1][1]:
            begin = joined.pop()[0]
        joined.append((begin, end))
    return joined


def inexact_spans(intervals: Sequence[ExactInterval], begin: float, end: float) -> list[Span]:
    """Return begin and end [s] of the spans from `begin` to `end` that are not exact, empty spans included."""
    borders = [begin, *np.ravel(spans(intervals)).tolist(), end]
    return list(zip(borders[::2], borders[1::2], strict=True))


def state_of(scene: Scene) -> list[str]:
    """Return the fields of `Samples` that make up the state of a robot of this scene."""
    known = quantities(scene)
    return [name for name in UNITS if name in known]


def common_samples(signals: Mapping[str, Signal], names: Sequence[str]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return the quantities `names` at the instants [s] at which all of them were recorded, and these instants."""
    times = functools.reduce(lambda common, other: np.intersect1d(common, other, assume_unique=True),
                             [signals[name].times for name in names])
    return {name: signals[name].values[np.searchsorted(signals[name].times, times)] for name in names}, times


def evenly_spaced(times: np.ndarray) -> np.ndarray:
    """Return the exact instants [s] of evenly spaced samples, or `times` if they are not evenly spaced.

    The stamps in `times` are rounded to nanoseconds, in which a mass moves by more than `AGREEMENT`.
    """
    pauses = np.diff(times)
    if len(pauses) == 0:
        return times
    period = float(pauses[pauses < 1.5 * np.median(pauses)].mean())
    even = times[0] + np.rint((times - times[0]) / period) * period
    return even if np.abs(even - times).max() <= _STAMP else times
