"""What a page asks of the live view, read from its text; whatever is nothing of it is refused in words."""

import json
import math
from dataclasses import dataclass
from typing import Any, NoReturn

from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.process.untrusted import one_line

LONGEST = 4096
"""Bytes of the longest text that a page may send."""
MOST_SECONDS = 5.0
"""Longest slow motion [s] that a page may ask for; the view keeps so much."""
PLAIN_CALLS = ("reset", "step")
SWITCHES = ("pause", "record")
_MOST_IDS = 2**32  # a binary frame has so much room for one


@dataclass(frozen=True)
class Command:
    """A command to publish: `value` under the topic's `name`, in the topic's unit."""

    id: int
    name: str
    value: float


@dataclass(frozen=True)
class Call:
    """A service of the robot to call; `on` for those that switch something."""

    id: int
    name: str
    on: bool | None = None


@dataclass(frozen=True)
class SlowMotion:
    """The motion of the last `seconds` [s] to compute."""

    id: int
    seconds: float


Request = Command | Call | SlowMotion


class RefusedError(ValueError):
    """A text that asks for nothing that there is; `id` is that of the request if it has one."""

    def __init__(self, words: str, id: int | None = None):
        super().__init__(words)
        self.id = id


def read_request(text: str | bytes) -> Request:
    """The request in a page's text.

    Raises
    ------
    RefusedError
        Saying in one line what is wrong.
    """
    if isinstance(text, bytes):
        raise RefusedError("bytes are no request; send text")
    try:
        asked = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        raise RefusedError("no JSON; send an object such as {\"id\": 1, \"call\": \"reset\"}") from None
    if not isinstance(asked, dict):
        raise RefusedError("no JSON object; send one such as {\"id\": 1, \"call\": \"reset\"}")
    id = asked.pop("id", None)
    if type(id) is not int or not 0 <= id < _MOST_IDS:
        raise RefusedError(f"id: give an integer from 0 to {_MOST_IDS - 1}, which the answer repeats")
    try:
        return _read(id, asked)
    except ValueError as error:
        raise RefusedError(str(error), id) from None


def _read(id: int, asked: dict[str, Any]) -> Request:
    names = set(asked)
    if names == {"command", "value"}:
        return Command(id, _one_of(asked, "command", tuple(COMMAND_UNITS)), _number(asked, "value"))
    if names == {"call"}:
        return Call(id, _one_of(asked, "call", PLAIN_CALLS))
    if names == {"call", "on"}:
        name = _one_of(asked, "call", SWITCHES)
        if type(asked["on"]) is not bool:
            raise ValueError(f"on: {_shown(asked['on'])} is not true or false; give one of them")
        return Call(id, name, asked["on"])
    if names == {"slow_motion"}:
        seconds = _number(asked, "slow_motion")
        if not 0.0 < seconds <= MOST_SECONDS:
            raise ValueError(f"slow_motion: {seconds:g} s is out of range; give above 0 to {MOST_SECONDS:g} s")
        return SlowMotion(id, seconds)
    raise ValueError(f"{_shown(sorted(names))} is no request; send command and value, call, call and on, or "
                     "slow_motion")


def _one_of(asked: dict[str, Any], name: str, choices: tuple[str, ...]) -> str:
    if asked[name] not in choices:
        raise ValueError(f"{name}: {_shown(asked[name])} is unknown; choose one of {', '.join(choices)}")
    return asked[name]


def _number(asked: dict[str, Any], name: str) -> float:
    value = asked[name]
    try:
        number = float(value) if type(value) in (int, float) else math.nan
    except OverflowError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{name}: {_shown(value)} is not a finite number; give one")
    return number


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(name)


def _shown(value: object) -> str:
    return one_line(repr(value), 60)
