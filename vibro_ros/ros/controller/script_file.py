"""A controller script read from YAML, checked as a whole before anything is sent.

A script is a block: a list of `entries`, played `repeat` times. An entry says for how long (`for`) each command
is held (`motor_speed: 100.0`) or ramped (`motor_speed: {from: 0.0, to: 100.0}`; without `from`, from where it
is), what feedback is to reach (`hold_speed: -0.05`, `go_to: -0.5`), or which mean speed the commands are to give that
a command map knows (`speed_over_ground: -0.05`), and which fault the robot has meanwhile (`fault: motor_stall`). It
begins when the entry before it ends, or `at` a time counted from the start of its block. An entry may itself be a
block. A command keeps its value until another entry changes it.
"""

import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from vibro_ros.configuration.command_choice import CommandChoice
from vibro_ros.configuration.command_map import CommandMap
from vibro_ros.configuration.scene_file import config_folder
from vibro_ros.configuration.strict_yaml import read_yaml
from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.model.faults import FAULTS, Incident, checked_incident
from vibro_ros.ros.controller.feedback import MOTOR_RANGE, WITHIN, Goal, PositionGoal, SpeedGoal
from vibro_ros.ros.controller.script import MOTOR, Course, Script, Segment

LONGEST_SCRIPT = 100_000
"""Most segments that a script may unfold to; nested repeats multiply."""
DEEPEST_BLOCK = 10
"""Most blocks inside each other."""
GOAL_KEYS = ("hold_speed", "go_to")
"""Keys that make an entry one of feedback."""
SHORTEST = 4.0
"""Shortest time [s] to hold a speed: half of it to settle, half of it to be measured over some turns of the crank."""
_GAPS = tuple(name for name in COMMAND_UNITS if name.endswith("_gap"))
_OVER_GROUND = "speed_over_ground"
_FAULT_KEYS = tuple(name for name in Incident._fields if name != "duration")


def shipped_scripts() -> tuple[str, ...]:
    """Names of the scripts that come with the package."""
    return tuple(sorted(path.stem for path in (config_folder() / "controller").glob("*.yaml")))


def find_script(name_or_path: str) -> Path:
    """The file of a shipped script's name, or `name_or_path` as a path.

    Raises
    ------
    ValueError
        When there is neither.
    """
    if name_or_path in shipped_scripts():
        return config_folder() / "controller" / f"{name_or_path}.yaml"
    if not os.path.isfile(name_or_path):  # which is false, not an error, for a name that no file can have
        missing = f"{name_or_path}: no such script" if name_or_path else "no script given"
        raise ValueError(f"{missing}; give a path or one of {', '.join(shipped_scripts())}")
    return Path(name_or_path)


def read_script(path: Path, command_map: CommandMap | None = None) -> Script:
    """Read and check the script, a YAML file.

    An entry that asks for a speed over ground is refused without a command map, which gives its commands. ValueError
    names the file, the entry and the reason.
    """
    document = read_yaml(path)
    try:
        if document is None:
            raise ValueError("the file is empty; give a list of `entries`")
        script = Script(tuple(_Unfolding(command_map).block(document, start=0.0, prefix="")))
        if not script.commands:
            raise ValueError(f"no entry gives a command; give {', '.join(COMMAND_UNITS)}")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return script


def read_goal(entry: Mapping[str, object]) -> tuple[float, Goal]:
    """The longest time [s] and the goal of one entry that is not in a script.

    Raises
    ------
    ValueError
        For what a script's entry must not be, in the same words.
    """
    try:
        segment = _Unfolding(None).pursuit(entry, [], 0.0, 0.0, "")
    except ValueError as error:
        raise ValueError(str(error).removeprefix("entry : ")) from None
    assert segment.goal
    return segment.duration, segment.goal


class _Unfolding:
    """Unfolds blocks to segments while it remembers where each command stands."""

    def __init__(self, command_map: CommandMap | None):
        self._map = command_map
        self._choice: CommandChoice | None = None
        self._last: dict[str, float] = {}
        self._count = 0
        self._open_ends = 0  # entries so far that may end sooner than they say

    def block(self, block: object, start: float, prefix: str) -> Iterator[Segment]:
        where = f"entry {prefix[:-1]}: " if prefix else ""
        if not isinstance(block, Mapping):
            raise ValueError(f"{where}{_shown(block)} is not a mapping; give `entries`, a list")
        if prefix.count(".") > DEEPEST_BLOCK:
            raise ValueError(f"{where}more than {DEEPEST_BLOCK} blocks inside each other; use fewer")
        _refuse_unknown(block, ("entries", "repeat", "at", "note") if prefix else ("entries", "repeat", "note"), where)
        entries = block.get("entries")
        if not isinstance(entries, list) or not entries:
            raise ValueError(f"{where}entries is {_shown(entries)}; give a list with at least one entry")
        repeats = block.get("repeat", 1)
        if type(repeats) is not int or repeats < 1:
            raise ValueError(f"{where}repeat: {_shown(repeats)} is not a count; give a whole number of at least 1")
        for _ in range(repeats):
            for segment in self._entries(entries, start, prefix):
                yield segment
                start_of_next = segment.end
            start = start_of_next

    def _entries(self, entries: list[object], start: float, prefix: str) -> Iterator[Segment]:
        clock, fixed = start, self._open_ends
        for index, entry in enumerate(entries):
            number = f"{prefix}{index + 1}"
            where = f"entry {number}: "
            if not isinstance(entry, Mapping):
                raise ValueError(f"{where}{_shown(entry)} is not a mapping; give `for` and commands")
            if "at" in entry and self._open_ends > fixed:
                raise ValueError(f"{where}at: when the go_to before it in this list ends is not known; leave `at` out, "
                                 "or put the entries after the go_to into a list of their own")
            clock = _start_of(entry, start, clock, where)
            for segment in self._entry(entry, entries[index + 1 :], start, clock, number):
                self._count += 1
                if self._count > LONGEST_SCRIPT:
                    raise ValueError(f"{where}unfolds to more than {LONGEST_SCRIPT} entries; repeat less often")
                yield segment
                clock = segment.end

    def _entry(self, entry: Mapping, later: list[object], block_start: float, start: float, number: str
               ) -> Iterator[Segment]:
        where = f"entry {number}: "
        if "entries" in entry or "repeat" in entry:
            yield from self.block(entry, start, f"{number}.")
            return
        if any(key in entry for key in GOAL_KEYS):
            yield self.pursuit(entry, later, block_start, start, number)
            return
        over_ground = _OVER_GROUND in entry
        allowed = () if over_ground else (*COMMAND_UNITS, *GOAL_KEYS)
        _refuse_unknown(entry, ("at", "for", "note", *_FAULT_KEYS, _OVER_GROUND, *allowed), where)
        duration = _duration(entry, later, start - block_start, where)
        speed = _finite_number(entry[_OVER_GROUND], f"{where}{_OVER_GROUND}", "m/s") if over_ground else None
        given = self._chosen(speed, where) if speed is not None else {
            name: self._course(name, entry[name], where) for name in COMMAND_UNITS if name in entry}
        courses = {name: Course(value, value) for name, value in self._last.items()} | given
        self._last = {name: course.end for name, course in courses.items()}
        yield Segment(number, start, duration, courses, tuple(given), str(entry.get("note", "")),
                      speed_over_ground=speed, incident=_incident(entry, duration, where))

    def _chosen(self, speed: float, where: str) -> dict[str, Course]:
        try:
            if self._map is None:
                raise ValueError("there is no command map here; give motor_speed and gaps")
            self._choice = self._choice or CommandChoice(self._map)
            return {name: Course(level, level) for name, level in self._choice.commands_for(speed).commands.items()}
        except ValueError as error:
            raise ValueError(f"{where}{_OVER_GROUND}: {error}") from None

    def pursuit(self, entry: Mapping, later: list[object], block_start: float, start: float, number: str) -> Segment:
        """The segment of an entry with a goal; what the motor does at its end is known only if it stands then."""
        where = f"entry {number}: "
        goal = _read_goal(entry, where)
        reaches = isinstance(goal, PositionGoal)
        if not reaches:
            duration = _duration(entry, later, start - block_start, where)
            if duration < SHORTEST:
                raise ValueError(f"{where}hold_speed: {duration:g} s is too short to settle and to be measured; give "
                                 f"at least {SHORTEST:g} s")
        elif "timeout" in entry:
            duration = _positive_number(entry["timeout"], f"{where}timeout", "s")
        else:
            raise ValueError(f"{where}go_to: no longest time; give `timeout: <seconds>`")
        self._open_ends += reaches
        given = {name: Course(level, level) for name in _GAPS if name in entry
                 for level in (_command_value(name, entry[name], where),)}
        courses = {name: Course(value, value) for name, value in self._last.items() if name != MOTOR} | given
        self._last = {name: course.end for name, course in courses.items()} | ({MOTOR: 0.0} if reaches else {})
        return Segment(number, start, duration, courses, tuple(given), str(entry.get("note", "")), goal)

    def _course(self, name: str, value: object, where: str) -> Course:
        if not isinstance(value, Mapping):
            level = _command_value(name, value, where)
            return Course(level, level)
        _refuse_unknown(value, ("from", "to"), f"{where}{name}: ")
        if "to" not in value:
            raise ValueError(f"{where}{name}: a ramp needs `to`; give {{from: …, to: …}}")
        if "from" not in value and name not in self._last:
            raise ValueError(f"{where}{name}: no value to start the ramp from; give `from`")
        start = _command_value(name, value["from"], where) if "from" in value else self._last[name]
        return Course(start, _command_value(name, value["to"], where))


def _start_of(entry: Mapping, block_start: float, clock: float, where: str) -> float:
    if "at" not in entry:
        return clock
    at = _finite_number(entry["at"], f"{where}at", "s")
    if at < 0.0:
        raise ValueError(f"{where}at: {at:g} is negative; give a time of at least 0 s")
    # a block's start plus `at` is rounded; the end of the entry before it as well
    if block_start + at < clock - 1e-9 * max(1.0, clock):
        raise ValueError(f"{where}at: {at:g} s lies before the end of the entry before it, {clock - block_start:g} s")
    return max(block_start + at, clock)


def _duration(entry: Mapping, later: list[object], start: float, where: str) -> float:
    """`for`, or the time until the next entry's `at`."""
    if "for" in entry:
        duration, key = _finite_number(entry["for"], f"{where}for", "s"), "for"
    elif later and isinstance(later[0], Mapping) and "at" in later[0]:
        duration, key = _finite_number(later[0]["at"], "at of the entry after it", "s") - start, "at of the next entry"
    else:
        raise ValueError(f"{where}no duration; give `for: <seconds>`, or `at` in the entry after it")
    if duration <= 0.0:
        raise ValueError(f"{where}{key}: leaves {duration:g} s; give a duration above 0 s")
    return duration


def _incident(entry: Mapping, duration: float, where: str) -> Incident | None:
    """The fault that lasts as long as the entry, if it names one."""
    if "fault" not in entry:
        if given := [key for key in _FAULT_KEYS if key in entry]:
            raise ValueError(f"{where}{given[0]}: belongs to a fault; give `fault`, one of {', '.join(FAULTS)}")
        return None
    try:
        return checked_incident(duration=duration, **{key: entry[key] for key in _FAULT_KEYS if key in entry})
    except ValueError as error:
        raise ValueError(f"{where}{error}") from None


def _read_goal(entry: Mapping, where: str) -> Goal:
    """The goal of an entry that has one of `GOAL_KEYS`, beside which it may give gaps."""
    if all(key in entry for key in GOAL_KEYS):
        raise ValueError(f"{where}hold_speed and go_to: one entry has one goal; make two entries of it")
    motor = _motor(entry.get("motor_speed", {}), where)
    if "go_to" in entry:
        _refuse_unknown(entry, ("at", "timeout", "note", "go_to", "within", "motor_speed", *_GAPS), where)
        return PositionGoal(_finite_number(entry["go_to"], f"{where}go_to", "m"), _within(entry, "m", where), motor)
    _refuse_unknown(entry, ("at", "for", "note", "hold_speed", "within", "motor_speed", *_GAPS), where)
    speed = _finite_number(entry["hold_speed"], f"{where}hold_speed", "m/s")
    return SpeedGoal(speed, _within(entry, "m/s", where), motor)


def _within(entry: Mapping, unit: str, where: str) -> float:
    return _positive_number(entry.get("within", WITHIN), f"{where}within", unit)


def _motor(value: object, where: str) -> tuple[float, float]:
    """The range of motor speeds, from a mapping with `from`, `to` or neither."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{where}motor_speed: {value!r} is no range; beside a goal give the range that feedback uses, "
                         "{from: …, to: …}, or leave it out")
    _refuse_unknown(value, ("from", "to"), f"{where}motor_speed: ")
    low, high = (_command_value("motor_speed", value.get(key, default), where)
                 for key, default in zip(("from", "to"), MOTOR_RANGE, strict=True))
    if low >= high:
        raise ValueError(f"{where}motor_speed: from {low:g} to {high:g} rad/s is no range; give `to` above `from`")
    if low < 0.0:
        raise ValueError(f"{where}motor_speed: {low:g} rad/s is below 0; feedback goes faster by a faster motor: give "
                         "`from` at least 0")
    return low, high


def _command_value(name: str, value: object, where: str) -> float:
    return _finite_number(value, f"{where}{name}", COMMAND_UNITS[name])


def _positive_number(value: object, what: str, unit: str) -> float:
    number = _finite_number(value, what, unit)
    if number <= 0.0:
        raise ValueError(f"{what}: {number:g} is not above 0; give a number above 0 {unit}")
    return number


def _finite_number(value: object, what: str, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{what}: {_shown(value)} is not a number; give a number in {unit}")
    if not abs(value) <= sys.float_info.max:  # also false for NaN
        raise ValueError(f"{what}: {value} is not finite; give a number in {unit}")
    return float(value)


def _refuse_unknown(given: Mapping, known: tuple[str, ...], where: str) -> None:
    for key in given:
        if key not in known:
            raise ValueError(f"{where}{key}: unknown key; give {', '.join(known)}")


def _shown(value: object) -> str:
    return "missing" if value is None else repr(value)
