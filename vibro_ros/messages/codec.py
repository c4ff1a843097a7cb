"""Messages without ROS: definitions, new messages, serialisation (CDR), and the first difference of two messages."""

import struct
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

ENCAPSULATION = 4  # bytes before the first field


@cache
def jazzy_types() -> Typestore:
    """Return the message definitions of ROS 2 Jazzy, which later distributions keep; loaded once (about 60 ms)."""
    return get_typestore(Stores.ROS2_JAZZY)


def new_message(type_name: str) -> Any:
    """Return a new message of zeros, empty texts and empty lists, the defaults of every ROS library."""
    store = jazzy_types()
    _, fields = store.fielddefs[type_name]
    return store.types[type_name](**{name: _new_field(kind, details) for name, (kind, details) in fields})


def serialised(message: Any, type_name: str) -> bytes:
    """Return the message serialised as CDR; its sequences of float64 may be lists or arrays."""
    for name in _lists_of_numbers(type_name):
        setattr(message, name, np.asarray(getattr(message, name), dtype=float))
    return bytes(jazzy_types().serialize_cdr(message, type_name))


def deserialised(data: bytes, type_name: str) -> Any:
    """Return the message in `data`, which may come from any peer.

    The robot and all readers of its bag call this function, so that they refuse the same messages. ValueError when
    `data` is no plain CDR (two bytes, 0 and the byte order 0 or 1, then two bytes of options), ends within a field, or
    has more than three bytes after the last field (some libraries pad with up to three).
    """
    if len(data) < ENCAPSULATION or data[0] != 0 or data[1] not in (0, 1):
        raise ValueError(f"{len(data)} bytes are no {type_name}: they do not begin as plain CDR")
    try:
        return jazzy_types().deserialize_cdr(data, type_name)
    except MemoryError:
        raise
    except Exception as error:  # the code that rosbags generates may raise any exception
        raise ValueError(f"{len(data)} bytes are no {type_name}") from error


def first_difference(first: bytes, second: bytes, type_name: str) -> tuple[str, object, object] | None:
    """Return the first field in which two serialised messages differ, and its two values; None when they are equal.

    Numbers are equal when all their bits are equal. Bytes that belong to no field are not compared. If one of the
    messages cannot be read, the field is "bytes" and the values are the lengths of both.
    """
    if first == second:
        return None
    try:
        read = deserialised(first, type_name)
        if serialised(read, type_name) == second:  # only the padding differs, which some libraries do not set
            return None
        fields = _leaves(read, deserialised(second, type_name), "")
        return next((difference for difference in fields if _bits(difference[1]) != _bits(difference[2])), None)
    except ValueError:
        return "bytes", len(first), len(second)


@cache
def _lists_of_numbers(type_name: str) -> tuple[str, ...]:
    return tuple(name for name, (kind, details) in jazzy_types().fielddefs[type_name][1]
                 if kind is Nodetype.SEQUENCE and details[0][0] is Nodetype.BASE and details[0][1][0] == "float64")


def _new_field(kind: Nodetype, details: Any) -> Any:
    if kind is Nodetype.NAME:
        return new_message(details)
    if kind is Nodetype.BASE:
        return {"string": "", "bool": False, "float64": 0.0, "float32": 0.0}.get(details[0], 0)
    (inner, of), length = details
    if inner is Nodetype.BASE and of[0] != "string":
        return np.zeros(length if kind is Nodetype.ARRAY else 0, dtype=of[0])
    return [_new_field(inner, of) for _ in range(length if kind is Nodetype.ARRAY else 0)]


def _leaves(first: Any, second: Any, path: str) -> Iterator[tuple[str, object, object]]:
    if hasattr(first, "__msgtype__"):
        for name in (name for name in vars(first) if name != "__msgtype__"):
            yield from _leaves(getattr(first, name), getattr(second, name), f"{path}.{name}" if path else name)
    elif isinstance(first, (list, np.ndarray)):
        if len(first) != len(second):
            yield f"length of {path}", len(first), len(second)
        for i, (left, right) in enumerate(zip(first, second, strict=False)):
            yield from _leaves(left, right, f"{path}[{i}]")
    else:
        yield path, *(value.item() if isinstance(value, np.generic) else value for value in (first, second))


def _bits(value: object) -> object:
    return struct.pack("<d", value) if isinstance(value, float) else value
