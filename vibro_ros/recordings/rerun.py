"""Simulate a recorded run again, sample by sample, as the robot did.

Between two samples the robot always does the same: it publishes sample k, taken at k / `rate.publish`, passes the
commands and operations that have arrived to the device, in their order, and advances to sample k + 1; after a reset,
sample k + 1 is the device's start. Every message, also a command, is recorded with the stamp of a sample: the run's
start plus the sample's time. So the bag gives k exactly, whatever the wall clock did (stalls, another real-time
factor). A checkpoint has the device's whole state at its sample, before the commands and operations that follow it.

`Rerun.through` is the one loop over a bag's samples. Comparison, changed runs and energy accounts are loops over it.
"""

import json
import math
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from vibro_ros.bag.metadata import LAST_STAMP
from vibro_ros.bag.stream import BagError, BagStream, robot_topics
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.frames import NONE
from vibro_ros.messages.operations import RESET, perform, read_operation
from vibro_ros.messages.robot_messages import RobotMessages, stamp_at
from vibro_ros.messages.topics import (
    CHECKPOINT,
    COMMANDS,
    INPUTS,
    OF_DC_MOTOR,
    OPERATIONS,
    SAMPLE,
    TOPICS,
    VARIANCES,
    commands_in,
)
from vibro_ros.model.parameters import SCENE_PARAMETERS, Value, checked_parameters
from vibro_ros.model.scene import Scene
from vibro_ros.process.files import one_line
from vibro_ros.sensors.device import SensedSimulator, new_device
from vibro_ros.simulation.motion import SimulationError

LONGEST_PAUSE = 10.0  # pause [s] of robot time without a message, after which a stamp is checked against a header
LONGEST_UNSAMPLED = 86_400.0  # longest robot time [s] that is simulated for a bag without samples, only with commands
MOST_UNSAMPLED = 40_000_000  # most samples that are simulated for such a bag
MOST_STEPS = 1_000_000  # most solver steps of a sample
_PART = 0.1  # s of robot time between two checks of the number of steps
SAMPLED = tuple(name for name, topic in TOPICS.items()
                if topic.when == SAMPLE and not topic.of_dc_motor and NONE in topic.transforms)
"""Topics that every robot publishes with each sample."""
STAMPED = tuple(name for name in SAMPLED if TOPICS[name].frame)
"""Topics of `SAMPLED` whose headers have the recorded stamp."""

Recorded = list[tuple[str, bytes]]
"""Messages with the same recorded stamp: topic (its key in `TOPICS`) and bytes of each."""


class StampError(BagError):
    """A recorded stamp is not that of a sample, or is not plausible."""


@dataclass(frozen=True)
class RecordedRun:
    """Description of the run in a bag: the node's parameters `settings`, and the simulated scene.

    `start` is the ROS time [ns] of simulated time 0; `topics` has the resolved names by the keys of `TOPICS`.
    """

    settings: dict[str, Value]
    scene: Scene
    start: int
    topics: dict[str, str]
    begins_late: bool = False  # whether the bag lacks the run's beginning
    has_checkpoint: bool = False  # whether the bag has a checkpoint, from which the run can be simulated as well

    @property
    def lacks_beginning(self) -> bool:
        """Whether the bag lacks both the run's beginning and checkpoints, so that the run cannot be simulated."""
        return self.begins_late and not self.has_checkpoint

    @property
    def rate(self) -> float:
        """Samples per simulated second [Hz]."""
        return self.settings["rate.publish"]

    def time(self, tick: int) -> float:
        """Return the simulated time [s] of a sample."""
        return tick / self.rate

    def stamp(self, tick: int) -> int:
        """Return the recorded stamp [ns] of a sample."""
        return stamp_at(self.start, self.time(tick))

    def tick(self, stamp: int) -> int | None:
        """Return the number of the sample with a recorded stamp [ns]; None if no sample has it."""
        tick = round((stamp - self.start) * 1e-9 * self.rate)
        return tick if tick >= 0 and self.stamp(tick) == stamp else None


def recorded_run(stream: BagStream) -> RecordedRun:
    """Return the description of the run in a bag (BagError if it has none that is valid in this version)."""
    known = stream.metadata
    if missing := [key for key in ("scene", "parameters", "start") if key not in known]:
        raise BagError(f"{stream.folder}: says nothing of {', '.join(missing)}; give a bag that the robot recorded "
                       "itself")
    try:
        parameters = json.loads(known["parameters"])
        of_scene = {parameter.name for parameter in SCENE_PARAMETERS}
        settings = checked_parameters({name: value for name, value in parameters.items()  # record.* do not matter
                                       if name not in of_scene and not name.startswith("record.")}, DEVICE_PARAMETERS)
        scene = Scene(known["scene"], {name: value for name, value in parameters.items() if name in of_scene})
        defaults = {parameter.name: parameter.default for parameter in DEVICE_PARAMETERS}
        steps = 1.0 / ({**defaults, **settings}["rate.publish"] * scene["solver.step"])
        if scene["solver.method"] != "exact" and steps > MOST_STEPS:
            raise ValueError(f"solver.step takes {steps:.3g} steps a sample, more than {MOST_STEPS}")
        start = int(known["start"])
        if not 0 <= start <= LAST_STAMP:
            raise ValueError(f"start is {one_line(known['start'])} ns, which is no ROS time")
        run = RecordedRun(defaults | settings, scene, start, robot_topics(stream))
    except (ValueError, AttributeError, TypeError, RecursionError) as error:  # the custom data may be anything
        version = known.get("version", "unknown")
        raise BagError(f"{stream.folder}: cannot be simulated by this version: {error} (recorded by version "
                       f"{version})") from error
    checkpoints = stream.topics.get(run.topics.get(CHECKPOINT, ""))
    return replace(run, begins_late=_begins_late(stream, run),
                   has_checkpoint=checkpoints is not None and checkpoints.messages > 0)


class Rerun:
    """A device that is stepped and commanded as the robot steps and commands its own.

    `tick` is the number of the last sample taken, -1 before the first; `origin` that of the sample at which the
    device's own time is 0. `latched` has the messages that the robot publishes once, by topic (a key of `TOPICS`).
    `commands` counts the command messages passed to the device, `resets` its resets. During `through`, `stamp` [ns] and
    `recorded` are those of the present sample, or of the one that could not be reached, and `seen` counts the earlier
    messages by topic.
    """

    def __init__(self, run: RecordedRun, scene: Scene):
        self.tick = -1
        self.origin = self.commands = self.resets = self.stamp = 0
        self.recorded: Recorded = []
        self.seen: Counter[str] = Counter()
        self._run = run
        self.device = new_device(scene)
        self.scene = self.device.scene
        settings = run.settings
        self._messages = RobotMessages(
            scene, settings["frame_prefix"], settings["tf.publish"] if "tf" in run.topics else NONE,
            [settings[name] for name in VARIANCES], run.topics if settings["ros2_control"] else {})
        self.latched = dict(self._messages.once(run.start))

    @property
    def rate(self) -> float:
        """Samples per simulated second [Hz]."""
        return self._run.rate

    def through(self, stream: BagStream, names: Collection[str] | None = None,
                until: int = -1) -> Iterator[tuple[int | None, Recorded]]:
        """Simulate the run of a bag again; the device gets the inputs that the robot received after each sample.

        Yields the number of each sample, with the device at that sample, and the messages recorded with its stamp;
        `published` then returns the messages that the robot publishes there. If the bag begins late, the simulation
        begins at its first checkpoint; messages recorded before, and with the checkpoint's sample, are yielded with
        None as the number. `names` are the topics to read, by their keys in `TOPICS`, all by default. If the bag's
        messages end before the sample `until`, the run is simulated up to it.

        StampError when a stamp is not that of a sample, or so far ahead that it would cost years of simulation.
        BagError when the bag's first checkpoint is not valid. SimulationError when the run cannot go on.
        """
        most, headed = most_ticks(stream, self._run), self._are_headed(stream, names)
        is_late = self._run.begins_late and self._run.has_checkpoint
        failure: SimulationError | None = None
        for stamp, recorded in ticks(stream, self._run, names):
            self.stamp, self.recorded, tick = stamp, recorded, self._run.tick(stamp)
            if failure:
                raise failure
            if is_late and tick is not None:
                is_late = not self._begin_at_checkpoint(stream, tick)
                most += max(0, self.tick)
                yield None, recorded
            else:
                tick = self._checked(stream, tick, most, headed)
                while self.tick < tick - 1:
                    self.go_to(self.tick + 1)
                    yield self.tick, []
                self.go_to(tick)
                yield tick, recorded
            try:
                self._pass_inputs(stream, begun=not is_late)
            except SimulationError as error:  # raised only if more follows: the robot may have ended here as well
                failure = error
        if failure and self.tick < until:
            raise failure
        while self.tick < until:
            self.go_to(self.tick + 1)
            yield self.tick, []

    def published(self) -> Recorded:
        """Return the messages that the robot publishes at the present sample; to be called at most once for each.

        Topics of a dc motor that the recorded robot did not have are left out.
        """
        device, start = self.device, self._run.stamp(self.origin)
        measurements = device.take_measurements() if isinstance(device, SensedSimulator) else ()
        messages = self._messages.of_sample(device.values, device.take_events(), measurements,
                                            self._run.stamp(self.tick), partial(stamp_at, start))
        return [message for message in messages if message[0] not in OF_DC_MOTOR or message[0] in self._run.topics]

    def go_to(self, tick: int) -> None:
        """Advance to a sample, which must not lie behind (SimulationError when the run cannot go on).

        Does nothing to a device that was reset after that sample, because it is at its start already.
        """
        self.tick = tick
        if tick < self.origin:
            return
        until, most = self._run.time(tick - self.origin), 0
        while until - self.device.time > _PART:
            samples = math.ceil((until - self.device.time) * self._run.rate)
            most = most or self.device.statistics["steps"] + MOST_STEPS * samples
            self.device.advance_to(self.device.time + _PART)
            if self.device.statistics["steps"] > most:
                raise SimulationError(f"at {self.device.time:.9g} s: more than {MOST_STEPS} steps a sample; the robot "
                                      "that recorded this bag cannot have taken them")
        self.device.advance_to(until)

    def restore(self, tick: int, data: bytes) -> None:
        """Restore the device from a checkpoint recorded at the sample `tick` (ValueError if it is not valid)."""
        self.device.restore(np.array(deserialised(data, TOPICS[CHECKPOINT].type).data))
        time = self.device.time  # since the last reset
        since = round(min(time * self._run.rate, tick + 1.0))
        if not 0 <= since <= tick or time != self._run.time(since):
            raise ValueError(f"the checkpoint is of {time:.9g} s, which is no sample's time up to "
                             f"{self._run.time(tick):.9g} s")
        self.tick, self.origin = tick, tick - since

    def receive(self, name: str, data: bytes) -> str:
        """Pass a recorded command or operation to the device; return why it cannot be read, or an empty text."""
        try:
            message = deserialised(data, TOPICS[name].type)
            operation = read_operation(message.data) if name == OPERATIONS else None
        except ValueError as error:
            return str(error)
        if operation is None:
            self._command(name, message)
            return ""
        with suppress(ValueError):  # a robot with other parameters may refuse it
            perform(operation, self.device)
            if operation.name == RESET:
                self.origin = self.tick + 1
                self.resets += 1
        return ""

    def _are_headed(self, stream: BagStream, names: Collection[str] | None) -> bool:
        """Return whether the messages to be read include some whose headers have the recorded stamp."""
        return any(self._run.topics.get(name) in stream.topics for name in STAMPED if names is None or name in names)

    def _checked(self, stream: BagStream, tick: int | None, most: int, headed: bool) -> int:
        """Check that the run can have reached the sample `tick` of `stamp`, and return it (StampError).

        After a long pause a header must confirm the stamp, because a damaged one could cost years of simulation.
        """
        if tick is None or tick <= self.tick:
            raise StampError(f"{stream.folder}: its stamp {self.stamp} is of no sample; give a bag that the robot "
                             "recorded")
        if tick > most:
            raise StampError(f"{stream.folder}: its stamp {self.stamp} is that of sample {tick}, and its messages are "
                             f"of {most} samples at most; give a bag with the robot's own stamps")
        if headed and tick - self.tick >= LONGEST_PAUSE * self._run.rate:
            try:
                headers = [deserialised(data, TOPICS[name].type).header.stamp for name, data in self.recorded
                           if name in STAMPED]
            except ValueError:
                headers = []
            if not any(header.sec * 1_000_000_000 + header.nanosec == self.stamp for header in headers):
                raise StampError(f"{stream.folder}: its stamp {self.stamp} is not that of the message's header")
        return tick

    def _begin_at_checkpoint(self, stream: BagStream, tick: int) -> bool:
        """Restore the device at the sample `tick` if a checkpoint was recorded there, and return whether it was."""
        checkpoint = next((data for name, data in self.recorded if name == CHECKPOINT), None)
        if checkpoint is None:
            return False
        try:
            self.restore(tick, checkpoint)
        except ValueError as error:
            version = one_line(stream.metadata.get("version", "unknown"))
            raise BagError(f"{stream.folder}: {error} (recorded by version {version})") from error
        return True

    def _pass_inputs(self, stream: BagStream, begun: bool) -> None:
        """Pass the inputs in `recorded` to the device, if its run has `begun`."""
        for name, data in self.recorded:
            if name in INPUTS and begun:
                if unreadable := self.receive(name, data):
                    stream.unreadable.add(self._run.topics[name], self.seen[name], self.stamp, unreadable)
                self.commands += not unreadable and name in COMMANDS
            self.seen[name] += 1

    def _command(self, name: str, message: Any) -> None:
        given, _ = commands_in(name, message, self.device.scene)
        for argument, value in given.items():
            with suppress(ValueError):  # the robot refused it as well
                self.device.command(**{argument: value})


def _begins_late(stream: BagStream, run: RecordedRun) -> bool:
    """Return whether a bag lacks its run's beginning.

    A bag with checkpoints that has the beginning has a checkpoint of the first sample. A bag that was begun while the
    robot was paused at the first sample has stamps of that sample, but lacks what the robot had received before.
    """
    if stream.start > run.start or run.topics.get(CHECKPOINT) not in stream.topics:
        return stream.start > run.start
    return next((stamp > run.start for stamp, _ in ticks(stream, run, (CHECKPOINT,))), False)


def most_ticks(stream: BagStream, run: RecordedRun) -> int:
    """Return the largest plausible number of samples for a bag's messages; false stamps could cost years."""
    recorded = max((stream.topics[run.topics[name]].messages for name in SAMPLED
                    if run.topics.get(name) in stream.topics), default=0)
    if not recorded:
        return min(round(LONGEST_UNSAMPLED * run.rate), MOST_UNSAMPLED)
    return round(4 * recorded + LONGEST_PAUSE * run.rate)


def ticks(stream: BagStream, run: RecordedRun,
          chosen: Collection[str] | None = None) -> Iterator[tuple[int, Recorded]]:
    """Yield each recorded stamp [ns] with its messages on the `chosen` topics (keys of `TOPICS`), all by default."""
    names = {topic: name for name, topic in run.topics.items() if chosen is None or name in chosen}
    group: Recorded = []
    last: int | None = None
    for topic, stamp, data in stream.messages(frozenset(names)):
        if last is not None and stamp != last:
            yield last, group
            group = []
        last = stamp
        group.append((names[topic], data))
    if last is not None:
        yield last, group
