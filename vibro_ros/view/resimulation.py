"""A recorded run simulated again, as stretches that can be sampled anywhere between the recorded samples.

The run is exact as long as it passes through every recorded position to within `AGREEMENT`. Where it does not - a
command was lost, another version or another computer rounds differently - it is unknown until something says again
where the robot is: a reset or a checkpoint.
"""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.operations import FAULT, PUSH, RESET, SET, STATE, TIMEOUT, read_operation
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, ROBOT_TOPICS, TOPICS, commands_in
from vibro_ros.model.faults import DURATION, FORCE
from vibro_ros.model.scene import Scene
from vibro_ros.recordings.rerun import LONGEST_PAUSE, Rerun, RunFacts
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.view.motion import is_place
from vibro_ros.view.recorded import Input, Track
from vibro_ros.view.stretch import AGREEMENT, LONGEST, ExactRun, Progress, quiet, sampled


class Resimulation(ExactRun):
    """Simulates a recorded run again and compares it with the recorded positions.

    `tracks` are recorded quantities by robot time, from one sample of the robot to another. Unless the recording has
    the run's beginning (`is_known`), the run is unknown until something says where the robot is.
    """

    def __init__(self, facts: RunFacts, tracks: dict[str, Track], is_known: bool):
        super().__init__()
        self._facts, self._is_known = facts, is_known
        with quiet():
            self._rerun = Rerun(facts, facts.scene)
        self._names = [name for name in tracks if is_place(name)]
        self._ticks, self._recorded = _by_ticks([tracks[name] for name in self._names], facts.rate)
        self._reached = 0  # of `_ticks`, those that are compared or past
        self.open(self._rerun.device)

    @property
    def scene(self) -> Scene:
        """What is simulated, by the method that `solver.method` auto has picked."""
        return self._rerun.device.scene

    def run(self, inputs: Sequence[Input], progress: Progress) -> None:
        """Simulate to the last recorded sample; `inputs` are the commands, operations and checkpoints."""
        last = int(self._ticks[-1])
        for received in inputs:
            tick = self._facts.tick(received.stamp)
            if tick is None or tick < self._rerun.tick:
                self._lose(self._rerun.tick, f"the stamp {received.stamp} of an input is not that of a sample")
            elif tick > last:
                break
            else:
                self._go_to(tick, progress)
                self._receive(tick, received)
        self._go_to(last, progress)
        if self._is_known:
            self._close(last)
        progress(1.0)

    def _go_to(self, tick: int, progress: Progress) -> None:
        """Go on to a sample, as long as what is computed is what was recorded."""
        while self._is_known and self._rerun.tick < tick:
            if self._reached < len(self._ticks):  # a spoilt stamp would ask for years of simulation
                before = int(self._ticks[self._reached - 1]) if self._reached else 0
                pause = int(self._ticks[self._reached]) - before
                if pause > LONGEST_PAUSE * self._facts.rate:
                    self._lose(self._rerun.tick, f"nothing was recorded for {pause / self._facts.rate:.3g} s")
                    break
            step = min(tick, max(self._rerun.tick, 0) + max(1, round(LONGEST * self._facts.rate)))
            try:
                self._step(step)
            except SimulationError as error:
                self._lose(self._rerun.tick, f"the run cannot go on {error}")
            if self._is_known and self._rerun.device.time - self.begin >= LONGEST:
                self._close(step)
                self.open(self._rerun.device)
            progress(self._reached / len(self._ticks))
        self._rerun.tick = max(tick, self._rerun.tick)
        self._reached = int(np.searchsorted(self._ticks, tick, side="right"))

    def _step(self, tick: int) -> None:
        """Simulate to a sample and compare what was recorded on the way."""
        device, first = self._rerun.device, self._reached
        self._reached = int(np.searchsorted(self._ticks, tick, side="right"))
        ticks, recorded = self._ticks[first:self._reached], self._recorded[first:self._reached]
        computed = sampled(device, (ticks - self._rerun.origin) / self._facts.rate, self._names)
        device.advance_to(self._own_time(tick))
        wrong = np.abs(computed - recorded) > AGREEMENT + 1e-12 * np.abs(recorded)
        at = np.flatnonzero(wrong.any(axis=1))
        if len(at):
            good = int(ticks[at[0] - 1]) if at[0] else self._rerun.tick
            name = self._names[int(np.flatnonzero(wrong[at[0]])[0])]
            self.note(device.take_events(), self._own_time(good), self._offset)
            self._lose(good, f"{name} as computed is not what was recorded")
        else:
            self.note(device.take_events(), self._own_time(tick), self._offset)
            self._rerun.tick = tick

    def _own_time(self, tick: int) -> float:
        """The device's own time [s] at a sample; a device that was reset stands at its start before its first one."""
        return max(0.0, (tick - self._rerun.origin) / self._facts.rate)

    @property
    def _offset(self) -> float:
        """Robot time at which the device's own time is 0 [s]."""
        return self._rerun.origin / self._facts.rate

    def _close(self, tick: int) -> None:
        self.close(self.scene, self._own_time(tick), self._offset)

    def _lose(self, good: int, fault: str) -> None:
        """From the sample `good` on the run is unknown."""
        if self._is_known:
            self._close(good)
            self._is_known = False
            self.faults.append(f"after {good / self._facts.rate:.6g} s {fault}")

    def _receive(self, tick: int, received: Input) -> None:
        try:
            if received.name == CHECKPOINT:
                if not self._is_known:
                    self._rerun.restore(tick, received.data)
                    self._is_known = True
                    self.open(self._rerun.device)
            elif received.name == OPERATIONS:
                self._operate(tick, received.data)
            elif self._is_known:
                message = deserialised(received.data, ROBOT_TOPICS[received.name])
                for argument, value in commands_in(received.name, message, self.scene)[0].items():
                    with suppress(ValueError):  # the robot refused it as well
                        self.command(self._rerun.device, {argument: value})
        except ValueError:
            pass  # the robot refused it as well
        except SimulationError as error:
            self._lose(tick, f"the run cannot go on {error}")

    def _operate(self, tick: int, data: bytes) -> None:
        """A reset, other parameters, another state, a push or a fault begin another stretch, whose checkpoint holds
        what lasts; pauses and steps do nothing, because samples count."""
        operation = read_operation(deserialised(data, TOPICS[OPERATIONS].type).data)
        if operation.name == TIMEOUT and self._is_known:
            self.command(self._rerun.device, {self.scene.motor_command: 0.0})
        elif operation.name in (RESET, SET) or (operation.name in (STATE, PUSH, FAULT) and self._is_known):
            if self._is_known:
                self._close(tick)
            self._rerun.receive(OPERATIONS, data)
            if operation.name == RESET:
                self._is_known = True
                self.resets.append((tick + 1) / self._facts.rate)
            self.open(self._rerun.device)


def pushes(facts: RunFacts, inputs: Sequence[Input]) -> list[dict[str, float]]:
    """Recorded pushes of the body: ``begin`` and ``end`` [s] of robot time, ``force_x`` and ``force_z`` [N]."""
    found: list[dict[str, float]] = []
    for one in inputs:
        tick = facts.tick(one.stamp)
        if one.name != OPERATIONS or tick is None:
            continue
        try:
            operation = read_operation(deserialised(one.data, TOPICS[OPERATIONS].type).data)
            if operation.name in (PUSH, RESET):
                time = facts.time(tick)
                if found:
                    found[-1]["end"] = min(found[-1]["end"], time)
                if operation.name == PUSH and (duration := DURATION.checked(operation.parameters["duration"])):
                    forces = {name: FORCE.checked(operation.parameters[name]) for name in ("force_x", "force_z")}
                    found.append({"begin": time, "end": time + duration, **forces})
        except ValueError:
            pass  # the robot refused it as well
    return [push for push in found if push["force_x"] or push["force_z"]]


def _by_ticks(tracks: Sequence[Track], rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the samples of which something was recorded, shape (n,), and what, shape (n, tracks), with NaN."""
    numbers = [np.rint(track.times * rate).astype(np.int64) for track in tracks]
    ticks = np.unique(np.concatenate(numbers))
    recorded = np.full((len(ticks), len(tracks)), np.nan)
    for k, (track, of_track) in enumerate(zip(tracks, numbers, strict=True)):
        recorded[np.searchsorted(ticks, of_track), k] = track.values
    return ticks, recorded
