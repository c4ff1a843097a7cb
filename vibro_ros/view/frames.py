"""What the server sends to a page: texts of JSON, and binary frames of samples and of motions.

A binary frame is two little-endian numbers of 32 bits, then data. Frames of `SAMPLES` have the number of rows and then
the rows, each a float64 for each of `COLUMNS`; frames of `MOTION` have the request's id and then the motion's payload.
"""

import json
import struct
from collections.abc import Sequence

from vibro_ros.simulation.samples import FIELDS

COLUMNS = FIELDS
"""Quantities of a row, SI units; `time` is counted from the robot's `origin` [s]."""
SAMPLES, MOTION = 1, 2
_HEAD = struct.Struct("<II")


def text(kind: str, **fields: object) -> str:
    """A text frame.

    Raises
    ------
    ValueError
        For a number that is not finite, which a page could not read.
    """
    return json.dumps({"kind": kind, **fields}, allow_nan=False, separators=(",", ":"))


def samples(parts: Sequence[bytes]) -> bytes:
    """A frame of rows, of which each part holds some."""
    data = b"".join(parts)
    return _HEAD.pack(SAMPLES, len(data) // (8 * len(COLUMNS))) + data


def motion(id: int, payload: bytes) -> bytes:
    """The frame of a motion's payload, for the request `id`."""
    return _HEAD.pack(MOTION, id) + payload
