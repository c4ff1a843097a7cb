"""The controller's script, unfolded in time: which command has which value when."""

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.model.faults import Incident
from vibro_ros.ros.controller.feedback import Goal

MOTOR = "motor_speed"
"""The command that feedback gives."""


@dataclass(frozen=True)
class Course:
    """A command's value over a segment: from `start` to `end` in a straight line; equal when held."""

    start: float
    end: float

    def at(self, share: float) -> float:
        """Value after `share` (0 to 1) of the segment."""
        return self.start + (self.end - self.start) * share if share < 1.0 else self.end


@dataclass(frozen=True)
class Segment:
    """One entry at its place in time.

    Attributes
    ----------
    entry : str
        Number of the entry in the file, from 1; "2.1" inside a block.
    start, duration : float
        In seconds from the start of the script. An entry that goes to a position lasts this long at most; what follows
        it begins sooner when the position is reached sooner.
    courses : mapping of str to Course
        Every command given so far, those that are only held from earlier entries included.
    given : tuple of str
        The commands that this entry itself gives.
    note : str
        What the author says of it.
    goal : Goal or None
        What feedback is to reach meanwhile by the motor's speed.
    speed_over_ground : float or None
        Mean speed [m/s] for which a command map gave the commands.
    incident : Incident or None
        A fault of the robot that begins with the entry and lasts as long.
    """

    entry: str
    start: float
    duration: float
    courses: Mapping[str, Course]
    given: tuple[str, ...]
    note: str
    goal: Goal | None = None
    speed_over_ground: float | None = None
    incident: Incident | None = None

    @property
    def end(self) -> float:
        """Instant [s] at which the segment ends."""
        return self.start + self.duration

    @property
    def is_ramp(self) -> bool:
        """Whether any command changes during the segment."""
        return any(course.start != course.end for course in self.courses.values())

    def instants(self, rate: float) -> Iterator[float]:
        """When its commands change [s], in order: at its start; along a ramp, `rate` times a second, and at its end."""
        yield self.start
        if self.is_ramp:
            steps = math.ceil(self.duration * rate)
            yield from (self.start + step / rate for step in range(1, steps))
            yield self.end

    def describe(self) -> str:
        """What the segment commands, for people."""
        words = [self.goal.describe()] if self.goal else []
        if self.speed_over_ground is not None:
            words = [f"{self.speed_over_ground:g} m/s over ground"]
        for name in self.given:
            course = self.courses[name]
            start = f"{course.start:g} -> " if course.start != course.end else ""
            words.append(f"{name} {start}{course.end:g} {COMMAND_UNITS[name]}")
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
        """Whether any entry lets the robot fail."""
        return any(segment.incident for segment in self.segments)

    @property
    def needs_map(self) -> bool:
        """Whether a command map gave any command."""
        return any(segment.speed_over_ground is not None for segment in self.segments)

    def segment_at(self, time: float) -> Segment | None:
        """The segment that began last at `time` [s]; None before the first."""
        index = bisect_right(self._starts, time) - 1
        return self.segments[index] if index >= 0 else None

    def command_at(self, time: float) -> dict[str, float]:
        """Value of every command given by `time` [s], in the units of `COMMAND_UNITS`."""
        segment = self.segment_at(time)
        if segment is None:
            return {}
        share = (time - segment.start) / segment.duration if time < segment.end else 1.0
        return {name: course.at(share) for name, course in segment.courses.items()}

    def instants(self, rate: float) -> Iterator[float]:
        """When commands of the script change [s], in order, if every goal takes its longest time."""
        for segment in self.segments:
            yield from segment.instants(rate)
