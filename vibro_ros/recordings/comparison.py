"""A recording against the same run computed again, message by message and bit by bit."""

import math
import struct
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from vibro_ros.bag.stream import BagError, BagStream
from vibro_ros.messages.codec import deserialised, first_difference
from vibro_ros.messages.frames import joints_of
from vibro_ros.messages.topics import (
    CHECKPOINT,
    COMMAND_UNITS,
    COMMANDS,
    INPUTS,
    OF_DC_MOTOR,
    OPERATIONS,
    ROBOT_TOPICS,
    TOPICS,
)
from vibro_ros.recordings.rerun import LONGEST_PAUSE, Rerun, RunFacts, most_ticks, run_facts, ticks
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.provenance import software, tables

ABSENT = "no message"
STAMPED = ("odom", "joint_states", "ground_contact")  # topics whose headers have the recorded stamp


@dataclass(frozen=True)
class Difference:
    """Where recording and simulation part: the message's number on its topic in the bag, from 0, and a field of it.

    `stamp` is the recorded one [ns], `time` simulated time [s]; `field` such as ``pose.pose.position.x``.
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
    """What came of it; it ends at the first difference.

    `compared` counts by topic the messages that are equal to the last bit, `commands` those that the device was given;
    the others cannot be read, and the robot refused them. `missing` are messages that the recorder dropped, between
    others that are there; `notes` say why a difference may be no fault of the simulation. `last` is the simulated time
    [s] of the last recorded sample that was compared.
    """

    facts: RunFacts
    compared: Counter = field(default_factory=Counter)
    commands: int = 0
    missing: int = 0
    difference: Difference | None = None
    notes: list[str] = field(default_factory=list)
    last: float = 0.0


def compare(stream: BagStream) -> Comparison:
    """Compute the recorded run again and compare it with every message of the bag.

    Messages that are not there are not compared: a bag may begin late, break off, or lack topics. Where the recorder
    says that it dropped none, one that lacks between others is a difference.

    Raises
    ------
    BagError
        When the bag is damaged, or does not say what was simulated.
    """
    comparing = _Comparing(stream, run_facts(stream))
    for stamp, group in ticks(stream, comparing.found.facts):
        comparing.found.difference = comparing.sample(stamp, group)
        if comparing.found.difference:
            break
        comparing.found.last = comparing.found.facts.time(comparing.rerun.tick)
    return comparing.found


class _Comparing:
    """Goes through the bag and the simulation side by side."""

    def __init__(self, stream: BagStream, facts: RunFacts):
        self._stream, self._facts = stream, facts
        self.rerun = Rerun(facts, facts.scene)
        self.found = Comparison(facts, notes=notes(stream, facts))
        self._seen: Counter = Counter()
        self._recorded = {name for name, topic in facts.topics.items() if topic in stream.topics}
        self._may_lack = stream.metadata.get("dropped") != "0" or bool(stream.flaws)
        self._failure = ""  # of the simulation
        self._begun = False
        self._most = most_ticks(stream, facts)
        self._late = stream.start > facts.start and CHECKPOINT in self._recorded
        self._lacking: list[tuple[str, int]] = []  # messages that follow others and are not there: topic, sample

    def sample(self, stamp: int, group: list[tuple[str, bytes]]) -> Difference | None:
        """Compare what was recorded with one stamp, and give its commands to the device."""
        tick = self._facts.tick(stamp)
        if self._late and tick is not None:
            self._restore(tick, stamp, group)
            return None
        if tick is None or tick <= self.rerun.tick or not self._is_likely(tick, stamp, group):
            return self._difference(group[0][0], stamp, "recorded stamp", stamp,
                                    self._facts.stamp(self.rerun.tick + 1))
        replayed = self._advance(tick)
        if self._failure:
            return self._difference(group[0][0], stamp, "message", "a message", self._failure)
        if self._lacking and not self._may_lack:
            name, lacking = self._lacking[0]
            return self._difference(name, self._facts.stamp(lacking), "message", ABSENT, "a message")
        self.found.missing += len(self._lacking)
        self._lacking.clear()
        difference = self._match(stamp, group, replayed)
        self._command(stamp, group)
        return difference

    def _is_likely(self, tick: int, stamp: int, group: list[tuple[str, bytes]]) -> bool:
        """Whether a header bears a stamp out that lies far ahead: a spoilt one would cost years of simulation."""
        if tick > self._most:
            return False
        if tick - self.rerun.tick < LONGEST_PAUSE * self._facts.rate or not self._recorded.intersection(STAMPED):
            return True
        try:
            headers = [deserialised(data, ROBOT_TOPICS[name]).header.stamp for name, data in group if name in STAMPED]
        except ValueError:
            return False
        return any(one.sec * 1_000_000_000 + one.nanosec == stamp for one in headers)

    def _restore(self, tick: int, stamp: int, group: list[tuple[str, bytes]]) -> None:
        """Begin at a bag's first checkpoint, of which the sample is already out, and its commands are not.

        Before the checkpoint stand the parameters that were changed since the robot's start.
        """
        commanded: list[tuple[str, bytes]] = []
        for i, (name, data) in enumerate(group):
            if name == OPERATIONS:
                self.rerun.receive(name, data)
            if name == CHECKPOINT:
                try:
                    self.rerun.restore(tick, data)
                except ValueError as error:
                    raise BagError(f"{self._stream.folder}: {error}") from error
                self._late, self._begun = False, True
                self._most += tick
                commanded = group[i + 1:]
                break
        self._seen.update(name for i, (name, _) in enumerate(group)
                          if name not in INPUTS or i < len(group) - len(commanded))
        self._command(stamp, commanded)

    def _advance(self, tick: int) -> list[tuple[str, bytes]]:
        """Go to a sample; what it publishes."""
        try:
            while not self._failure and self.rerun.tick < tick - 1:
                self._lack([name for name, _ in self.rerun.step()], begun=self._begun)
            return self.rerun.step() if not self._failure else []
        except SimulationError as error:
            self._failure = str(error)
            return []

    def _match(self, stamp: int, group: list[tuple[str, bytes]],
               replayed: list[tuple[str, bytes]]) -> Difference | None:
        begun, self._begun = self._begun, True
        expected: dict[str, list[bytes]] = {}
        for name, data in replayed:
            expected.setdefault(name, []).append(data)
        for name, data in group:
            if name in INPUTS or name == CHECKPOINT:
                continue
            waiting = [self.rerun.lasting[name]] if name in self.rerun.lasting else expected.get(name, [])
            found = [first_difference(data, other, TOPICS[name].type) for other in waiting]
            if None not in found:
                where, recorded, is_now = (found and found[0]) or ("message", "a message", ABSENT)
                return self._difference(name, stamp, where, recorded, is_now)
            skipped = found.index(None)
            self._lack([name] * skipped, begun)
            del waiting[:skipped + 1]
            self._seen[name] += 1
            self.found.compared[self._facts.topics[name]] += 1
        # A bag may begin and end amid a sample, so this counts only once more follows.
        self._lack([name for name, waiting in expected.items() for _ in waiting], begun)
        return None

    def _lack(self, names: list[str], begun: bool) -> None:
        if begun:
            self._lacking += [(name, self.rerun.tick) for name in names if name in self._recorded]

    def _command(self, stamp: int, group: list[tuple[str, bytes]]) -> None:
        try:
            for name, data in group:
                if name in INPUTS:
                    unreadable = self.rerun.receive(name, data)
                    if unreadable:
                        self._stream.unreadable.add(self._facts.topics[name], self._seen[name], stamp, unreadable)
                    self.found.commands += not unreadable and name in COMMANDS
                    self._seen[name] += 1
        except SimulationError as error:
            self._failure = str(error)

    def _difference(self, name: str, stamp: int, where: str, recorded: object, replayed: object) -> Difference:
        time = (stamp - self._facts.start) * 1e-9
        index = where.rpartition("[")[2].rstrip("]")
        joints = joints_of(self._facts.scene)
        if name == "joint_states" and index.isdigit() and int(index) < len(joints):
            where = f"{where} ({joints[int(index)]})"
        return Difference(self._facts.topics[name], self._seen[name], stamp, time, where, recorded, replayed)


def notes(stream: BagStream, facts: RunFacts) -> list[str]:
    """What in the bag may make a replay differ from it, for people."""
    found, recorded = [], stream.metadata
    here = {**software(), "tables": tables(facts.scene.parameters)}
    found += [f"recorded with {key.replace('_', ' ')} {recorded[key]}, replayed with {here[key]}: bits may differ"
              for key in here if recorded.get(key, here[key]) != here[key]]
    if unsaid := [key.replace("_", " ") for key in here if key not in recorded]:
        found.append(f"the bag does not say its {', '.join(unsaid)}: where they differ, bits may")
    if stream.start > facts.start and facts.topics.get(CHECKPOINT) not in stream.topics:
        found.append(f"the bag begins {(stream.start - facts.start) * 1e-9:.3f} s after the robot started: commands "
                     "before are unknown")
    found += [f"what came on {facts.topics.get(name, name)} was not recorded" for name in INPUTS
              if facts.topics.get(name) not in stream.topics
              and (name in facts.topics or (name in COMMAND_UNITS and name not in OF_DC_MOTOR))]  # not in every bag
    if recorded.get("dropped", "0") != "0":
        found.append(f"{recorded['dropped']} messages dropped; a command may be among them")
    if stream.flaws:
        found.append("part of the bag cannot be read; a command may be in it")
    return found
