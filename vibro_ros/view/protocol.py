"""What page and server say to each other: requests, the frames that answer them, and the frames that wait.

A page sends a text of JSON for each request, `read_request`. The server sends texts of JSON, and binary frames of
samples and of motions. A binary frame is two little-endian numbers of 32 bits, then data. Frames of `SAMPLES` have the
number of rows and then the rows, each a float64 for each of `COLUMNS`; frames of `MOTION` have the request's id and
then the motion's payload.
"""

import json
import math
import struct
from collections import deque
from dataclasses import dataclass
from typing import Any

from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.process.files import one_line
from vibro_ros.simulation.samples import FIELDS

COLUMNS = FIELDS
"""Quantities of a row, SI units; `time` is counted from the robot's `origin` [s]."""
SAMPLES, MOTION = 1, 2
_HEAD = struct.Struct("<II")

LONGEST = 4096
"""Bytes of the longest text that a page may send."""
MOST_SECONDS = 5.0
"""Longest slow motion [s] that a page may ask for; the view keeps so much."""
PLAIN_CALLS = ("reset", "step")
SWITCHES = ("pause", "record")
PARAMETERS = ("ground.friction",)
"""Parameters of the scene that a page may set; each may change while the robot runs."""
_MOST_IDS = 2**32  # a binary frame has so much room for one
MOST_BYTES = 2_000_000
"""Of samples that wait for one page: 10 s at 1 kHz."""
MOST_TEXTS = 200
"""Texts that wait; a page that reads has none."""
AT_ONCE = 250_000
"""Bytes of samples in one frame."""


@dataclass(frozen=True)
class Command:
    """A command to publish: `value` under the topic's `name`, in the topic's unit."""

    id: int
    name: str
    value: float


@dataclass(frozen=True)
class Change:
    """A parameter of the robot to set, by its name and in its unit."""

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


Request = Command | Change | Call | SlowMotion


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
        asked = json.loads(text)
    except (ValueError, RecursionError):
        raise RefusedError("no JSON; send an object such as {\"id\": 1, \"call\": \"reset\"}") from None
    if not isinstance(asked, dict):
        raise RefusedError("no JSON object; send one such as {\"id\": 1, \"call\": \"reset\"}")
    id = asked.pop("id", None)
    if type(id) is not int or not 0 <= id < _MOST_IDS:
        raise RefusedError(f"id: give an integer from 0 to {_MOST_IDS - 1}, which the answer repeats")
    names = set(asked)
    try:
        if names == {"command", "value"}:
            return Command(id, _one_of(asked, "command", tuple(COMMAND_UNITS)), _number(asked, "value"))
        if names == {"parameter", "value"}:
            return Change(id, _one_of(asked, "parameter", PARAMETERS), _number(asked, "value"))
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
        raise ValueError(f"{_shown(sorted(names))} is no request; send command and value, parameter and value, "
                         "call, call and on, or slow_motion")
    except ValueError as error:
        raise RefusedError(str(error), id) from None


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


def _shown(value: object) -> str:
    return one_line(repr(value), 60)


def text_frame(kind: str, **fields: object) -> str:
    """A text frame.

    Raises
    ------
    ValueError
        For a number that is not finite, which a page could not read.
    """
    return json.dumps({"kind": kind, **fields}, allow_nan=False, separators=(",", ":"))


def motion_frame(id: int, payload: bytes) -> bytes:
    """The frame of a motion's payload, for the request `id`."""
    return _HEAD.pack(MOTION, id) + payload


class Outbox:
    """Frames that wait to be sent to one page: bounded, so that a page that reads slowly costs no memory.

    Where there is no room, samples are dropped, the oldest first: a page that comes late is to show what is now.
    """

    def __init__(self):
        self._line: deque[tuple[str, str | bytes]] = deque()  # kind and data
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._line)

    def add_samples(self, rows: bytes) -> None:
        """Rows of samples, without a frame's head."""
        self._line.append(("samples", rows))
        self._bytes += len(rows)
        if self._bytes > MOST_BYTES:
            self._drop_oldest("samples")

    def add_text(self, kind: str, text: str) -> None:
        """A text; one of a kind that says how things stand replaces the one that waits, and what it makes void."""
        if kind in ("robot", "absent"):  # what waits is of the time before
            self._line = deque(one for one in self._line if one[0] not in ("robot", "absent", "samples", "impacts"))
            self._bytes = 0
        elif kind in ("status", "commands"):
            self._line = deque(one for one in self._line if one[0] != kind)
        self._line.append((kind, text))
        if len(self._line) > MOST_TEXTS and sum(type(data) is str for _, data in self._line) > MOST_TEXTS:
            self._drop_oldest("impacts", "log", "answer", "status")

    def add_motion(self, text: str, payload: bytes) -> None:
        """A motion: its header's text and its payload's frame; one that waits is dropped."""
        self._line = deque(one for one in self._line if one[0] != "motion")
        self._line += [("motion", text), ("motion", payload)]

    def take(self) -> str | bytes:
        """The next frame; rows that follow one another make one frame."""
        kind, data = self._line.popleft()
        if isinstance(data, str) or kind != "samples":
            return data
        self._bytes -= len(data)
        while len(data) < AT_ONCE and self._line and self._line[0][0] == "samples":
            _, more = self._line.popleft()
            assert isinstance(more, bytes)
            self._bytes -= len(more)
            data += more
        return _HEAD.pack(SAMPLES, len(data) // (8 * len(COLUMNS))) + data

    def _drop_oldest(self, *kinds: str) -> None:
        for item in self._line:
            if item[0] in kinds:
                self._line.remove(item)
                self._bytes -= len(item[1]) if item[0] == "samples" else 0
                return
