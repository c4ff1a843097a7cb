"""Compare a recording with the same run simulated again, message by message and bit by bit."""

import math
import struct
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from vibro_ros.bag.stream import BagStream
from vibro_ros.messages.codec import first_difference
from vibro_ros.messages.frames import joints_of
from vibro_ros.messages.topics import CHECKPOINT, COMMAND_UNITS, INPUTS, OF_DC_MOTOR, TOPICS
from vibro_ros.recordings.rerun import Recorded, RecordedRun, Rerun, StampError, recorded_run
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.provenance import software, tables

ABSENT = "no message"


@dataclass(frozen=True)
class Difference:
    """A difference between recording and simulation in a field of one message.

    `index` is the message's number on its topic in the bag, from 0; `stamp` its recorded stamp [ns], `time` its
    simulated time [s]; `field` a path such as ``pose.pose.position.x``.
    """

    topic: str
    index: int
    stamp: int
    time: float
    field: str
    recorded: Any
    replayed: Any

    def __str__(self) -> str:
        text = (f"{self.topic} message {self.index} at {self.time:.9g} s (stamp {self.stamp}): {self.field}: recorded "
                f"{self.recorded!r}, replayed {self.replayed!r}")
        if isinstance(self.recorded, str) or isinstance(self.replayed, str):
            return text
        values = (self.recorded, self.replayed)
        text = f"{text}, difference {self.replayed - self.recorded!r}"
        if not all(isinstance(value, float) and math.isfinite(value) for value in values) or (
                math.copysign(1.0, self.recorded) != math.copysign(1.0, self.replayed)):
            return text
        first, second = struct.unpack("<2q", struct.pack("<2d", *values))  # consecutive floats: consecutive integers
        return f"{text} ({abs(first - second)} ulp)"


@dataclass
class Comparison:
    """Result of a comparison, which ends at the first difference.

    `compared` counts the messages that are equal to the last bit, by topic; `commands` counts the command messages that
    could be read (the robot refused the others). `missing` counts messages that the recorder dropped between others
    that it kept; `notes` are other possible reasons for a difference than the simulation. `last` is the simulated time
    [s] of the last recorded sample that was compared.
    """

    run: RecordedRun
    compared: Counter = field(default_factory=Counter)
    commands: int = 0
    missing: int = 0
    difference: Difference | None = None
    notes: list[str] = field(default_factory=list)
    last: float = 0.0


def compare(stream: BagStream) -> Comparison:
    """Simulate the recorded run again and compare it with every message of the bag.

    Missing messages are not compared, because a bag may begin late, break off, or lack topics. But if the recorder
    states that it dropped none, a message that is missing between others is a difference. BagError when the bag is
    damaged, or does not say what was simulated.
    """
    run = recorded_run(stream)
    rerun = Rerun(run, run.scene)
    comparer = _Comparer(stream, run, rerun)
    comparison = comparer.comparison
    try:
        for tick, recorded in rerun.through(stream):
            if tick is None:
                continue
            comparison.difference = comparer.sample(recorded)
            if comparison.difference:
                break
            if recorded:
                comparison.last = run.time(tick)
    except StampError:
        comparison.difference = comparer.difference("recorded stamp", rerun.stamp, run.stamp(rerun.tick + 1))
    except SimulationError as error:
        comparison.difference = comparer.difference("message", "a message", str(error))
    comparison.commands = rerun.commands
    return comparison


class _Comparer:
    """Compares the messages of a run that is simulated again with the recorded ones."""

    def __init__(self, stream: BagStream, run: RecordedRun, rerun: Rerun):
        self._run, self._rerun = run, rerun
        self.comparison = Comparison(run, notes=notes(stream, run))
        self._recorded = {name for name, topic in run.topics.items() if topic in stream.topics}
        self._may_be_missing = stream.metadata.get("dropped") != "0" or bool(stream.flaws)
        # from the first complete sample on, such as that of a checkpoint
        self._counts_missing = run.begins_late and run.has_checkpoint
        self._matched: Counter = Counter()  # messages of the present sample that are equal, by topic
        self._missing: list[tuple[str, int]] = []  # missing messages after others that are there: topic, sample

    def sample(self, recorded: Recorded) -> Difference | None:
        """Compare the messages recorded at the present sample with those that the robot publishes there."""
        published = self._rerun.published()
        self._matched.clear()
        if not recorded:
            if self._counts_missing:
                self._note_missing([name for name, _ in published])
            return None
        if self._missing and not self._may_be_missing:
            name, tick = self._missing[0]
            return self.difference("message", ABSENT, "a message", name, self._run.stamp(tick))
        self.comparison.missing += len(self._missing)
        self._missing.clear()
        return self._match(recorded, published)

    def _match(self, recorded: Recorded, published: Recorded) -> Difference | None:
        counts_missing, self._counts_missing = self._counts_missing, True
        expected: dict[str, list[bytes]] = {}
        for name, data in published:
            expected.setdefault(name, []).append(data)
        for name, data in recorded:
            if name in INPUTS or name == CHECKPOINT:
                continue
            candidates = [self._rerun.latched[name]] if name in self._rerun.latched else expected.get(name, [])
            differences = [first_difference(data, candidate, TOPICS[name].type) for candidate in candidates]
            if None not in differences:
                place, was, is_now = (differences and differences[0]) or ("message", "a message", ABSENT)
                return self.difference(place, was, is_now, name)
            skipped = differences.index(None)
            if counts_missing:
                self._note_missing([name] * skipped)
            del candidates[:skipped + 1]
            self._matched[name] += 1
            self.comparison.compared[self._run.topics[name]] += 1
        # A bag may end amid a sample, so missing messages count only when later ones follow.
        if counts_missing:
            self._note_missing([name for name, candidates in expected.items() for _ in candidates])
        return None

    def _note_missing(self, names: list[str]) -> None:
        self._missing += [(name, self._rerun.tick) for name in names if name in self._recorded]

    def difference(self, place: str, recorded: object, replayed: object, name: str = "",
                   stamp: int | None = None) -> Difference:
        """Return a difference in a message on the topic `name`, by default that of the first message of the sample."""
        matched = self._matched[name] if name else 0
        name = name or self._rerun.recorded[0][0]
        stamp = self._rerun.stamp if stamp is None else stamp
        index = place.rpartition("[")[2].rstrip("]")
        joints = joints_of(self._run.scene)
        if name == "joint_states" and index.isdigit() and int(index) < len(joints):
            place = f"{place} ({joints[int(index)]})"
        return Difference(self._run.topics[name], self._rerun.seen[name] + matched, stamp,
                          (stamp - self._run.start) * 1e-9, place, recorded, replayed)


def notes(stream: BagStream, run: RecordedRun) -> list[str]:
    """Return a sentence for each property of the bag that may make a replay differ from it."""
    recorded, present = stream.metadata, {**software(), "tables": tables(run.scene.parameters)}
    sentences = [f"recorded with {key.replace('_', ' ')} {recorded[key]}, replayed with {now}: bits may differ"
                 for key, now in present.items() if recorded.get(key, now) != now]
    if unsaid := [key.replace("_", " ") for key in present if key not in recorded]:
        sentences.append(f"the bag does not say its {', '.join(unsaid)}: where they differ, bits may")
    if run.lacks_beginning:
        sentences.append(f"the bag begins {(stream.start - run.start) * 1e-9:.3f} s after the robot started: "
                         "commands before are unknown")
    sentences += [f"what came on {run.topics.get(name, name)} was not recorded" for name in INPUTS
                  if run.topics.get(name) not in stream.topics
                  and (name in run.topics or (name in COMMAND_UNITS and name not in OF_DC_MOTOR))]  # not in every bag
    if recorded.get("dropped", "0") != "0":
        sentences.append(f"{recorded['dropped']} messages dropped; a command may be among them")
    if stream.flaws:
        sentences.append("part of the bag cannot be read; a command may be in it")
    return sentences
