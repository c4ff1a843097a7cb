"""A controller script, read from YAML, checked as a whole before anything is sent, and unfolded in time.

A script is a block: a list of `entries`, played `repeat` times. An entry says for how long (`for`) each command is held
(`motor_speed: 100.0`) or ramped (`motor_speed: {from: 0.0, to: 100.0}`; without `from`, from its present value), or
gives feedback a goal (`hold_speed: -0.05`, `go_to: -0.5`); it may also give the robot a fault for this time
(`fault: motor_stall`). It begins when the previous entry ends, or `at` a time counted from the start of its block. An
entry may itself be a block. A command keeps its value until another entry changes it.
"""

import math
import sys
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from vibro_ros.configuration.strict_yaml import read_yaml
from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.model.faults import FAULTS, Incident, checked_incident
from vibro_ros.model.parameters import nearest
from vibro_ros.ros.controller.feedback import DEFAULT_MOTOR_RANGE, DEFAULT_TOLERANCE, Goal, PositionGoal, SpeedGoal

MOTOR = "motor_speed"  # the command that feedback gives
LONGEST_SCRIPT = 100_000  # most segments that a script may unfold to; nested repeats multiply
DEEPEST_BLOCK = 10  # deepest nesting of blocks
GOAL_KEYS = ("hold_speed", "go_to")  # keys of an entry with a goal for feedback
SHORTEST = 4.0
"""Shortest time [s] to hold a speed: half of it to settle, half of it to be measured over some turns of the crank."""
_GAPS = tuple(name for name in COMMAND_UNITS if name.endswith("_gap"))
_FAULT_KEYS = tuple(name for name in Incident._fields if name != "duration")


@dataclass(frozen=True)
class Ramp:
    """A command's value over a segment: linear from `start` to `end`, which are equal when it is held."""

    start: float
    end: float

    def at(self, share: float) -> float:
        """Return the value after a `share` (0 to 1) of the segment."""
        return self.start + (self.end - self.start) * share if share < 1.0 else self.end


@dataclass(frozen=True)
class Segment:
    """One entry of a script, with its start and duration."""

    entry: str  # number of the entry in the file, from 1; "2.1" inside a block
    start: float  # [s] from the start of the script
    duration: float  # [s]; of an entry that goes to a position the longest, because the next may begin sooner
    ramps: Mapping[str, Ramp]  # every command given so far, including those held from earlier entries
    given: tuple[str, ...]  # the commands that this entry itself gives
    note: str  # the author's note on the entry
    goal: Goal | None = None  # goal that feedback pursues by the motor's speed during the entry
    incident: Incident | None = None  # fault of the robot for the duration of the entry

    @property
    def end(self) -> float:
        """Instant [s] at which the segment ends."""
        return self.start + self.duration

    @property
    def is_ramp(self) -> bool:
        """Whether any command changes during the segment."""
        return any(ramp.start != ramp.end for ramp in self.ramps.values())

    def instants(self, rate: float) -> Iterator[float]:
        """Yield the instants [s] of changes: the start, and of a ramp also its steps, at `rate` [Hz], and its end."""
        yield self.start
        if self.is_ramp:
            steps = math.ceil(self.duration * rate)
            yield from (self.start + step / rate for step in range(1, steps))
            yield self.end

    def describe(self) -> str:
        """Return the segment in words."""
        words = [self.goal.describe()] if self.goal else []
        for name in self.given:
            ramp = self.ramps[name]
            start = f"{ramp.start:g} -> " if ramp.start != ramp.end else ""
            words.append(f"{name} {start}{ramp.end:g} {COMMAND_UNITS[name]}")
        words += [" ".join(("fault", *filter(None, (self.incident.fault, self.incident.of))))] if self.incident else []
        note = f" ({self.note})" if self.note else ""
        return f"entry {self.entry}, {self.duration:g} s: {', '.join(words or ['as before'])}{note}"


@dataclass(frozen=True)
class Script:
    """A checked script, unfolded in time; `segments` do not overlap and are in order."""

    segments: tuple[Segment, ...]
    _starts: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        object.__setattr__(self, "_starts", tuple(segment.start for segment in self.segments))

    @property
    def duration(self) -> float:
        """Length [s], if every goal takes its longest time."""
        return self.segments[-1].end

    @property
    def commands(self) -> tuple[str, ...]:
        """The commands that the script ever gives."""
        given = {name for segment in self.segments for name in segment.given}
        return tuple(name for name in COMMAND_UNITS if name in given or (name == MOTOR and self.goals))

    @property
    def goals(self) -> tuple[tuple[str, Goal], ...]:
        """The goals, each with the number of its entry, in order."""
        return tuple((segment.entry, segment.goal) for segment in self.segments if segment.goal)

    @property
    def needs_faults(self) -> bool:
        """Whether any entry gives the robot a fault."""
        return any(segment.incident for segment in self.segments)

    def segment_at(self, time: float) -> Segment | None:
        """Return the latest segment that has begun at `time` [s]; None before the first."""
        index = bisect_right(self._starts, time) - 1
        return self.segments[index] if index >= 0 else None

    def command_at(self, time: float) -> dict[str, float]:
        """Return the value at `time` [s] of every command given until then, in the units of `COMMAND_UNITS`."""
        segment = self.segment_at(time)
        if segment is None:
            return {}
        share = (time - segment.start) / segment.duration if time < segment.end else 1.0
        return {name: ramp.at(share) for name, ramp in segment.ramps.items()}


def read_script(path: Path) -> Script:
    """Read and check a script, a YAML file (ValueError with the file, the entry and the reason)."""
    document = read_yaml(path)
    try:
        if document is None:
            raise ValueError("the file is empty; give a list of `entries`")
        script = Script(tuple(_Unfolding().block(document, start=0.0, prefix="")))
        if not script.commands:
            raise ValueError(f"no entry gives a command; give {', '.join(COMMAND_UNITS)}")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return script


class _EntryError(ValueError):
    """An error in an entry, whose number is already in the message."""


class _Entry(NamedTuple):
    """An entry of a block, with its place in the script."""

    content: Mapping
    number: str  # as in `Segment.entry`
    start: float  # [s] from the start of the script
    start_in_block: float  # [s] from the start of its block
    next_content: object  # the entry after it in its block; None for the last one


class _Unfolding:
    """Unfolds blocks into segments, and keeps the present value of each command."""

    def __init__(self):
        self._last: dict[str, float] = {}
        self._count = 0
        self._open_ends = 0  # entries so far whose end is not known in advance

    def block(self, block: object, start: float, prefix: str) -> Iterator[Segment]:
        if not isinstance(block, Mapping):
            raise ValueError(f"{_shown(block)} is not a mapping; give `entries`, a list")
        if prefix.count(".") > DEEPEST_BLOCK:
            raise ValueError(f"more than {DEEPEST_BLOCK} blocks inside each other; use fewer")
        _refuse_unknown(block, ("entries", "repeat", "at", "note") if prefix else ("entries", "repeat", "note"))
        entries, repeats = block.get("entries"), block.get("repeat", 1)
        if not isinstance(entries, list) or not entries:
            raise ValueError(f"entries is {_shown(entries)}; give a list with at least one entry")
        if type(repeats) is not int or repeats < 1:
            raise ValueError(f"repeat: {_shown(repeats)} is not a count; give a whole number of at least 1")
        for _ in range(repeats):
            for segment in self._entries(entries, start, prefix):
                yield segment
                start_of_next = segment.end
            start = start_of_next

    def _entries(self, entries: list[object], start: float, prefix: str) -> Iterator[Segment]:
        end, open_ends = start, self._open_ends  # of the previous entry, and before this block
        for number, (content, next_content) in enumerate(zip(entries, [*entries[1:], None], strict=True), start=1):
            try:
                if not isinstance(content, Mapping):
                    raise ValueError(f"{_shown(content)} is not a mapping; give `for` and commands")
                if "at" in content and self._open_ends > open_ends:
                    raise ValueError("at: when the go_to before it in this list ends is not known; leave `at` out, or "
                                     "put the entries after the go_to into a list of their own")
                begin = _start_of(content, start, end)
                for segment in self._entry(_Entry(content, f"{prefix}{number}", begin, begin - start, next_content)):
                    self._count += 1
                    if self._count > LONGEST_SCRIPT:
                        raise ValueError(f"unfolds to more than {LONGEST_SCRIPT} entries; repeat less often")
                    yield segment
                    end = segment.end
            except _EntryError:
                raise
            except ValueError as error:
                raise _EntryError(f"entry {prefix}{number}: {error}") from error

    def _entry(self, entry: _Entry) -> Iterator[Segment]:
        if "entries" in entry.content or "repeat" in entry.content:
            yield from self.block(entry.content, entry.start, f"{entry.number}.")
        elif any(key in entry.content for key in GOAL_KEYS):
            yield self._goal_segment(entry)
        else:
            yield self._command_segment(entry)

    def _command_segment(self, entry: _Entry) -> Segment:
        content = entry.content
        _refuse_unknown(content, ("at", "for", "note", *_FAULT_KEYS, *COMMAND_UNITS, *GOAL_KEYS))
        duration = _duration(entry)
        given = {name: self._ramp(name, content[name]) for name in COMMAND_UNITS if name in content}
        ramps = {name: Ramp(value, value) for name, value in self._last.items()} | given
        self._last = {name: ramp.end for name, ramp in ramps.items()}
        return Segment(entry.number, entry.start, duration, ramps, tuple(given), str(content.get("note", "")),
                       incident=_incident(content, duration))

    def _goal_segment(self, entry: _Entry) -> Segment:
        """Return the segment of an entry with a goal; only after `go_to` the motor's command is known, which is 0."""
        content = entry.content
        goal = _read_goal(content)
        reaches = isinstance(goal, PositionGoal)
        if not reaches:
            duration = _duration(entry)
            if duration < SHORTEST:
                raise ValueError(f"hold_speed: {duration:g} s is too short to settle and to be measured; give at least "
                                 f"{SHORTEST:g} s")
        elif "timeout" in content:
            duration = _positive_number(content["timeout"], "timeout", "s")
        else:
            raise ValueError("go_to: no longest time; give `timeout: <seconds>`")
        self._open_ends += reaches
        levels = {name: _finite_number(content[name], name, "m") for name in _GAPS if name in content}
        held = {name: value for name, value in self._last.items() if name != MOTOR} | levels
        self._last = held | ({MOTOR: 0.0} if reaches else {})
        ramps = {name: Ramp(value, value) for name, value in held.items()}
        return Segment(entry.number, entry.start, duration, ramps, tuple(levels), str(content.get("note", "")), goal)

    def _ramp(self, name: str, value: object) -> Ramp:
        unit = COMMAND_UNITS[name]
        if not isinstance(value, Mapping):
            level = _finite_number(value, name, unit)
            return Ramp(level, level)
        _refuse_unknown(value, ("from", "to"), f"{name}: ")
        if "to" not in value:
            raise ValueError(f"{name}: a ramp needs `to`; give {{from: …, to: …}}")
        if "from" not in value and name not in self._last:
            raise ValueError(f"{name}: no value to start the ramp from; give `from`")
        start = _finite_number(value["from"], name, unit) if "from" in value else self._last[name]
        return Ramp(start, _finite_number(value["to"], name, unit))


def _start_of(content: Mapping, block_start: float, end: float) -> float:
    """Return the start [s] of an entry in the script, whose previous entry ends at `end`."""
    if "at" not in content:
        return end
    at = _finite_number(content["at"], "at", "s")
    if at < 0.0:
        raise ValueError(f"at: {at:g} is negative; give a time of at least 0 s")
    # both a block's start plus `at` and the end of the previous entry are rounded
    if block_start + at < end - 1e-9 * max(1.0, end):
        raise ValueError(f"at: {at:g} s lies before the end of the entry before it, {end - block_start:g} s")
    return max(block_start + at, end)


def _duration(entry: _Entry) -> float:
    """Return the duration [s] of an entry: `for`, or the time until the next entry's `at`."""
    if "for" in entry.content:
        duration, key = _finite_number(entry.content["for"], "for", "s"), "for"
    elif isinstance(entry.next_content, Mapping) and "at" in entry.next_content:
        at = _finite_number(entry.next_content["at"], "at of the entry after it", "s")
        duration, key = at - entry.start_in_block, "at of the next entry"
    else:
        raise ValueError("no duration; give `for: <seconds>`, or `at` in the entry after it")
    if duration <= 0.0:
        raise ValueError(f"{key}: leaves {duration:g} s; give a duration above 0 s")
    return duration


def _incident(content: Mapping, duration: float) -> Incident | None:
    """Return the entry's fault, which lasts as long as the entry; None if it names none."""
    if "fault" not in content:
        if given := [key for key in _FAULT_KEYS if key in content]:
            raise ValueError(f"{given[0]}: belongs to a fault; give `fault`, one of {', '.join(FAULTS)}")
        return None
    return checked_incident(duration=duration, **{key: content[key] for key in _FAULT_KEYS if key in content})


def _read_goal(content: Mapping) -> Goal:
    """Return the goal of an entry with one of `GOAL_KEYS`; the entry may also give gaps."""
    if all(key in content for key in GOAL_KEYS):
        raise ValueError("hold_speed and go_to: one entry has one goal; make two entries of it")
    motor = _motor_range(content.get("motor_speed", {}))
    key, duration_key, unit, kind = (("go_to", "timeout", "m", PositionGoal) if "go_to" in content else
                                     ("hold_speed", "for", "m/s", SpeedGoal))
    _refuse_unknown(content, ("at", duration_key, "note", key, "within", "motor_speed", *_GAPS))
    tolerance = _positive_number(content.get("within", DEFAULT_TOLERANCE), "within", unit)
    return kind(_finite_number(content[key], key, unit), tolerance, motor)


def _motor_range(value: object) -> tuple[float, float]:
    """Return the range of motor speeds [rad/s] from a mapping with `from`, `to`, both or neither."""
    if not isinstance(value, Mapping):
        raise ValueError(f"motor_speed: {value!r} is no range; beside a goal give the range that feedback uses, "
                         "{from: …, to: …}, or leave it out")
    _refuse_unknown(value, ("from", "to"), "motor_speed: ")
    low, high = (_finite_number(value.get(key, default), "motor_speed", COMMAND_UNITS[MOTOR])
                 for key, default in zip(("from", "to"), DEFAULT_MOTOR_RANGE, strict=True))
    if low >= high:
        raise ValueError(f"motor_speed: from {low:g} to {high:g} rad/s is no range; give `to` above `from`")
    if low < 0.0:
        raise ValueError(f"motor_speed: {low:g} rad/s is below 0; feedback goes faster by a faster motor: give `from` "
                         "at least 0")
    return low, high


def _positive_number(value: object, name: str, unit: str) -> float:
    number = _finite_number(value, name, unit)
    if number <= 0.0:
        raise ValueError(f"{name}: {number:g} is not above 0; give a number above 0 {unit}")
    return number


def _finite_number(value: object, name: str, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{name}: {_shown(value)} is not a number; give a number in {unit}")
    if not abs(value) <= sys.float_info.max:  # also false for NaN
        raise ValueError(f"{name}: {value} is not finite; give a number in {unit}")
    return float(value)


def _refuse_unknown(given: Mapping, known: tuple[str, ...], where: str = "") -> None:
    for key in given:
        if key not in known:
            question = nearest(str(key), known)
            raise ValueError(f"{where}{key}: unknown key; give {', '.join(known)}{question and f'; {question}'}")


def _shown(value: object) -> str:
    return "missing" if value is None else repr(value)
