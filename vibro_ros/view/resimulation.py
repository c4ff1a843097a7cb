"""A recorded run simulated again, as stretches that can be sampled anywhere between the recorded samples.

The run is exact as long as it passes through every recorded position to within `AGREEMENT`. Where it does not - a
command was lost, another version or another computer rounds differently - it is unknown until something says again
where the robot is: a reset or a checkpoint.
"""

from collections.abc import Sequence

import numpy as np

from vibro_ros.bag.cdr import deserialised
from vibro_ros.messages.operations import RESET, SET, TIMEOUT, read_operation
from vibro_ros.messages.topics import CHECKPOINT, OPERATIONS, OPERATIONS_TYPE, ROBOT_TOPICS
from vibro_ros.model.scene import Scene
from vibro_ros.recordings.rerun import LONGEST_PAUSE, Rerun, RunFacts
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.view.contacts import Impact, impacts_of, instants_of
from vibro_ros.view.recorded import Input, Progress, Track
from vibro_ros.view.stretch import Command, Stretch, quiet, sampled
from vibro_ros.view.units import is_place

AGREEMENT = 1e-9
"""Distance [m, rad] from every recorded position within which a run computed again counts as the same; besides
1e-12 of the position itself."""
STRETCH = 1.0
"""Longest stretch [s]: what is sampled of it fits in memory, and Ctrl-C is heard after each."""
MOST_EVENTS = 20_000
"""Events in a stretch, beyond which it is not cut at each of them: that would be more than a picture can show."""


class Resimulation:
    """Simulates a recorded run again and compares it with the recorded positions.

    Parameters
    ----------
    facts : RunFacts
        What the bag says of its run.
    tracks : dict of str to Track
        Recorded quantities by robot time, from one sample of the robot to another; the positions are compared.
    is_known : bool
        Whether the recording has the run's beginning; else the run is unknown until something says where the robot is.

    Attributes
    ----------
    stretches : list of Stretch
        All that is exact, by robot time.
    instants : list of ndarray, each of shape (n,)
        Robot time [s] of every event, and of both ends of a contact.
    impacts : list of Impact
        In exact stretches, by robot time.
    resets : list of float
        Robot time [s] of the samples at which the robot stood at its start again.
    faults : list of str
        What ended an exact stretch, in the order of robot time.
    """

    def __init__(self, facts: RunFacts, tracks: dict[str, Track], is_known: bool):
        self._facts, self._is_known = facts, is_known
        with quiet():
            self._rerun = Rerun(facts, facts.scene)
        self._names = [name for name in tracks if is_place(name)]
        self._ticks, self._recorded = _by_ticks([tracks[name] for name in self._names], facts.rate)
        self._reached = 0  # of `_ticks`, those that are compared or past
        self._commands: list[Command] = []
        self._open()
        self.stretches: list[Stretch] = []
        self.instants: list[np.ndarray] = []
        self.impacts: list[Impact] = []
        self.resets: list[float] = []
        self.faults: list[str] = []

    @property
    def scene(self) -> Scene:
        """What is simulated, by the method that `solver.method` auto has picked."""
        return self._rerun.device.scene

    def run(self, inputs: Sequence[Input], progress: Progress) -> None:
        """Simulate to the last recorded sample; `inputs` are what the robot was told."""
        last = int(self._ticks[-1])
        for told in inputs:
            tick = self._facts.tick(told.stamp)
            if tick is None or tick < self._rerun.tick:
                self._lose(self._rerun.tick, f"the stamp {told.stamp} of an input is not that of a sample")
            elif tick > last:
                break
            else:
                self._go_to(tick, progress)
                self._receive(tick, told)
        self._go_to(last, progress)
        if self._is_known:
            self._close(last)
        progress(1.0)

    def _go_to(self, tick: int, progress: Progress) -> None:
        """Go on to a sample, as long as what is computed is what was recorded."""
        while self._is_known and self._rerun.tick < tick:
            self._doubt_pause()
            step = min(tick, max(self._rerun.tick, 0) + max(1, round(STRETCH * self._facts.rate)))
            try:
                self._step(step)
            except SimulationError as error:
                self._lose(self._rerun.tick, f"the run cannot go on {error}")
            if self._is_known and self._rerun.device.time - self._begin >= STRETCH:
                self._close(step)
                self._open()
            progress(self._reached / len(self._ticks))
        self._rerun.tick = max(tick, self._rerun.tick)
        self._reached = int(np.searchsorted(self._ticks, tick, side="right"))

    def _doubt_pause(self) -> None:
        """Simulate no long time of which nothing was recorded: a spoilt stamp would ask for years."""
        if self._reached < len(self._ticks):
            before = int(self._ticks[self._reached - 1]) if self._reached else 0
            pause = int(self._ticks[self._reached]) - before
            if pause > LONGEST_PAUSE * self._facts.rate:
                self._lose(self._rerun.tick, f"nothing was recorded for {pause / self._facts.rate:.3g} s")

    def _step(self, tick: int) -> None:
        """Simulate to a sample and compare what was recorded on the way."""
        if not self._is_known:
            return
        device, rate, first = self._rerun.device, self._facts.rate, self._reached
        self._reached = int(np.searchsorted(self._ticks, tick, side="right"))
        ticks, recorded = self._ticks[first:self._reached], self._recorded[first:self._reached]
        computed = sampled(device, (ticks - self._rerun.origin) / rate, self._names)
        device.advance_to(self._own_time(tick))
        with np.errstate(invalid="ignore"):
            wrong = np.abs(computed - recorded) > AGREEMENT + 1e-12 * np.abs(recorded)
        at = np.flatnonzero(wrong.any(axis=1))
        if len(at):
            good = int(ticks[at[0] - 1]) if at[0] else self._rerun.tick
            name = self._names[int(np.flatnonzero(wrong[at[0]])[0])]
            self._note(device.take_events(), good)
            self._lose(good, f"{name} as computed is not what was recorded")
        else:
            self._note(device.take_events(), tick)
            self._rerun.tick = tick

    def _own_time(self, tick: int) -> float:
        """The device's own time [s] at a sample; a device that was reset stands at its start before its first one."""
        return max(0.0, (tick - self._rerun.origin) / self._facts.rate)

    def _note(self, events: np.ndarray, last: int) -> None:
        """Keep the events that are over by the sample `last`."""
        events = events[events["time"] + np.where(np.isfinite(events["duration"]), events["duration"], 0.0)
                        <= self._own_time(last)][:MOST_EVENTS]
        self.instants.append(instants_of(events, self._offset))
        self.impacts += impacts_of(events, self._offset)

    @property
    def _offset(self) -> float:
        """Robot time at which the device's own time is 0 [s]."""
        return self._rerun.origin / self._facts.rate

    def _open(self) -> None:
        """Begin a stretch where the device is."""
        self._start, self._begin, self._commands = self._rerun.device.checkpoint(), self._rerun.device.time, []

    def _close(self, tick: int) -> None:
        """End the stretch at a sample."""
        end = self._own_time(tick)
        if end > self._begin:
            commands = tuple(one for one in self._commands if one[0] < end)
            self.stretches.append(Stretch(self.scene, self._start, self._begin, end, self._offset, commands))

    def _lose(self, good: int, fault: str) -> None:
        """From the sample `good` on the run is unknown."""
        if self._is_known:
            self._close(good)
            self._is_known = False
            self.faults.append(f"after {good / self._facts.rate:.6g} s {fault}")

    def _receive(self, tick: int, told: Input) -> None:
        try:
            if told.name == CHECKPOINT:
                self._restore(tick, told.data)
            elif told.name == OPERATIONS:
                self._operate(tick, told.data)
            elif self._is_known:
                self._command({told.name: deserialised(told.data, ROBOT_TOPICS[told.name]).data})
        except ValueError:
            pass  # the robot refused it as well
        except SimulationError as error:
            self._lose(tick, f"the run cannot go on {error}")

    def _restore(self, tick: int, data: bytes) -> None:
        if not self._is_known:
            self._rerun.restore(tick, data)
            self._is_known = True
            self._open()

    def _command(self, command: dict[str, float]) -> None:
        self._rerun.device.command(**command)
        self._commands.append((self._rerun.device.time, command))

    def _operate(self, tick: int, data: bytes) -> None:
        """A reset or other parameters begin another stretch; pauses and steps do nothing, because samples count."""
        operation = read_operation(deserialised(data, OPERATIONS_TYPE).data)
        if operation.name == TIMEOUT and self._is_known:
            self._command({"motor_speed": 0.0})
        elif operation.name in (RESET, SET):
            if self._is_known:
                self._close(tick)
            self._rerun.receive(OPERATIONS, data)
            if operation.name == RESET:
                self._is_known = True
                self.resets.append((tick + 1) / self._facts.rate)
            self._open()


def _by_ticks(tracks: Sequence[Track], rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the samples of which something was recorded, shape (n,), and what, shape (n, tracks), with NaN."""
    numbers = [np.rint(track.times * rate).astype(np.int64) for track in tracks]
    ticks = np.unique(np.concatenate(numbers))
    recorded = np.full((len(ticks), len(tracks)), np.nan)
    for k, (track, of_track) in enumerate(zip(tracks, numbers, strict=True)):
        recorded[np.searchsorted(ticks, of_track), k] = track.values
    return ticks, recorded
