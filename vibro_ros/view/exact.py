"""The exact motion between samples of a recording: the recorded run is simulated again, and the exact intervals kept.

A sample has all positions and speeds. As long as the inputs that the robot received are known, from the run's start, a
reset or a checkpoint on, the device gets them: it *follows the run*. Where they are not known, or do not lead to the
next sample (one was lost, another version or computer rounds differently), the motion is left to interpolation. An
interval counts as exact if the device reaches the sample at its end to within `AGREEMENT`.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.operations import FAULT, PUSH, RESET, SET, STATE, TIMEOUT, read_operation
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, TOPICS, commands_in
from vibro_ros.recordings.rerun import LONGEST_PAUSE, Rerun
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.view.motion import ExactInterval, Impact, Progress, Span, impacts_of, is_position
from vibro_ros.view.recorded import Input

AGREEMENT = 1e-9
"""Largest distance [m, rad] of a simulated position from the recorded one for the motion to be exact; 1e-12 of the
position is allowed in addition."""
LONGEST = 1.0  # longest interval [s], so that its samples fit in memory, and Ctrl-C acts between intervals
MOST_EVENTS = 20_000  # most events between two samples at which the motion is cut; a picture cannot show more


class ExactMotion:
    """Simulates the recorded run again through samples with ascending numbers `ticks`, and collects exact intervals.

    `rerun` is the run at its start. A quantity of `samples` that was not recorded in a sample is NaN. `inputs` are
    those that came after a sample, by its place in `ticks`. `is_known` says whether the recording has the run's start.

    All results are in robot time [s]: `intervals` are the exact ones, `instants` those of every event and of the end of
    every contact, `impacts` those in exact intervals, `resets` the first samples after resets, `run_since` is the time
    from which the device first followed the run, None if never. `faults` say what ended exact intervals.
    """

    def __init__(self, rerun: Rerun, samples: Mapping[str, np.ndarray], ticks: np.ndarray,
                 inputs: Mapping[int, Sequence[Input]], is_known: bool):
        self.intervals: list[ExactInterval] = []
        self.instants: list[np.ndarray] = []
        self.impacts: list[Impact] = []
        self.resets: list[float] = []
        self.faults: list[str] = []
        self.run_since: float | None = None
        self._rerun, self._device = rerun, rerun.device
        self._ticks, self._times, self._inputs = ticks, ticks / rerun.rate, inputs
        self._positions = {name: values for name, values in samples.items() if is_position(name)}
        self._follows_run = False
        if is_known:
            self._follow(0)

    def walk(self, progress: Progress = lambda share: None) -> None:
        """Simulate the device through all samples."""
        if self._follows_run:  # a sample is taken before its inputs, at 0 s too
            self._device.advance_to(self._device_time(0))
        for k in range(len(self._times)):
            if k % 1000 == 0:
                progress(k / len(self._times))
            self._receive(k)
            if k == len(self._times) - 1:
                self._stop_following(k)
            elif self._times[k + 1] - self._times[k] > LONGEST_PAUSE:  # a damaged stamp would cost years
                self._stop_following(k, "nothing was recorded for more than 10 s")
            elif self._follows_run and (fault := self._step(k)):
                self._stop_following(k, fault)

    def _step(self, k: int) -> str:
        """Advance to the sample after k; return why the run is not the recorded one there, empty if it is."""
        try:
            self._device.advance_to(max(self._device.time, self._device_time(k + 1)))
        except SimulationError as error:
            return f"the run cannot go on {error}"
        state = self._device.state
        for name, recorded in self._positions.items():
            position = float(recorded[k + 1])
            if abs(getattr(state, name) - position) > AGREEMENT + 1e-12 * abs(position):  # NaN is no distance
                return f"{name} as computed is not what was recorded"
        self._note_events()
        if self._device.time - self._begin >= LONGEST:
            self._end_interval(k + 1)
            self._begin_interval()
        return ""

    def _receive(self, k: int) -> None:
        """Pass the inputs that the robot received after the sample k to the device."""
        for received in self._inputs.get(k, ()):
            try:
                if received.name == CHECKPOINT:
                    self._restore(k, received.data)
                elif received.name == OPERATIONS:
                    self._operate(k, received.data)
                elif self._follows_run:
                    message = deserialised(received.data, TOPICS[received.name].type)
                    for argument, value in commands_in(received.name, message, self._device.scene)[0].items():
                        with suppress(ValueError):  # the robot refused it as well
                            self._command({argument: value})
            except ValueError:
                pass  # the robot refused it as well
            except SimulationError as error:
                self._stop_following(k, f"the run cannot go on {error}")

    def _restore(self, k: int, data: bytes) -> None:
        """Restore the device from a checkpoint, unless it follows the run already."""
        if not self._follows_run:
            self._rerun.restore(int(self._ticks[k]), data)
            self._follow(k)

    def _operate(self, k: int, data: bytes) -> None:
        """Perform an operation, which begins a new interval.

        Pauses and steps do nothing, because robot time counts samples. A device that does not follow the run does so
        again after a reset, and after no other operation.
        """
        operation = read_operation(deserialised(data, TOPICS[OPERATIONS].type).data)
        if operation.name == TIMEOUT and self._follows_run:
            self._command({self._device.scene.motor_command: 0.0})
        if operation.name not in ((RESET, SET, STATE, PUSH, FAULT) if self._follows_run else (RESET, SET)):
            return
        followed_run = self._follows_run
        self._stop_following(k)
        self._rerun.tick = int(self._ticks[k])
        self._rerun.receive(OPERATIONS, data)
        if operation.name == RESET:
            self.resets.append((int(self._ticks[k]) + 1) / self._rerun.rate)
        if followed_run or operation.name == RESET:
            self._follow(k)

    def _follow(self, k: int) -> None:
        """Follow the run from the device's present state, which is the robot's after the sample k."""
        self._follows_run = True
        if self.run_since is None:
            self.run_since = float(self._times[k])
        self._begin_interval()

    def _begin_interval(self) -> None:
        """Begin an interval at the device's present state."""
        self._start, self._begin = self._device.checkpoint(), self._device.time
        self._commands: list[tuple[float, dict[str, float]]] = []

    def _command(self, command: dict[str, float]) -> None:
        """Pass a command to the device, and note it in the interval."""
        self._device.command(**command)
        self._commands.append((self._device.time, command))

    def _end_interval(self, k: int) -> None:
        """End the interval at the sample k."""
        end = self._device_time(k)
        if end > self._begin:
            commands = tuple(command for command in self._commands if command[0] < end)
            self.intervals.append(ExactInterval(self._device.scene, self._start, self._begin, end, self._offset,
                                                commands))

    def _stop_following(self, k: int, fault: str = "") -> None:
        """Follow the run no more from the sample k on, because of a `fault` if there is one."""
        if self._follows_run:
            self._end_interval(k)
            if fault:
                self.faults.append(f"after {float(self._times[k]):.6g} s {fault}")
        self._follows_run = False
        self._device.take_events()

    def _note_events(self) -> None:
        """Collect instants and impacts from the events since the last sample."""
        events = self._device.take_events()[:MOST_EVENTS]
        times = events["time"] + self._offset
        self.instants.append(np.concatenate([times, (times + events["duration"])[events["duration"] > 0.0]]))
        self.impacts += impacts_of(events, self._offset)

    @property
    def _offset(self) -> float:
        """Robot time at which the device's own time is 0 [s]."""
        return self._rerun.origin / self._rerun.rate

    def _device_time(self, k: int) -> float:
        """Return the device's own time [s] at a sample; 0 if the device was reset after that sample."""
        return max(0.0, (int(self._ticks[k]) - self._rerun.origin) / self._rerun.rate)


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
