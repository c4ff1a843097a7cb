"""YAML as rcl reads it from a parameter file: values by the rules of C, keys as they are written.

rcl asks strtol and strtod what a plain text is: 017 is 15, 1_000 is a text, 1:30 too, inf is a number and y is true.
What rcl refuses is refused here, in words. So are equal keys, of which rcl takes the last without a word.
"""

import math
import re
import sys
from fractions import Fraction
from typing import Any

import yaml

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_TEXT = "tag:yaml.org,2002:str"
_PLAIN = "plain"  # tag of what is written without quotes and without a tag

SECTION = "ros__parameters"
"""Key above the parameters of a node."""

_TRUE = {"Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"}
_FALSE = {"N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"}
_INTEGER = re.compile(r"([-+]?)(?:0[xX]([0-9a-fA-F]+)|0([0-7]*)|([1-9][0-9]*))")
_DECIMAL = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_HEXADECIMAL = re.compile(r"[-+]?0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][-+]?[0-9]+)?")
_WORD = re.compile(r"[-+]?(?:inf|infinity|nan(?:\([0-9a-zA-Z_]*\))?)", re.IGNORECASE)
_DOTTED_WORD = re.compile(r"([-+]?)\.(inf|Inf|INF|nan|NaN|NAN)")


class RefusedByRclError(yaml.MarkedYAMLError):
    """YAML that is no value for rcl."""

    kind = "not for ROS"


class _Loader(_LOADER):  # type: ignore[misc, valid-type]
    """PyYAML's composer, which keeps apart what is quoted and what is not."""

    def resolve(self, kind: type, value: object, implicit: Any) -> str:
        if kind is yaml.ScalarNode:
            return _PLAIN if implicit[0] else _TEXT
        return super().resolve(kind, value, implicit)


def rcl_document(text: str) -> object:
    """The document that `text` is for rcl; None when it is empty.

    Raises
    ------
    yaml.YAMLError
        For what is not YAML, what rcl refuses, and equal keys.
    """
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            raise _refused(f"the alias *{event.anchor}; write the value out", event)
    node = yaml.compose(text, _Loader)
    return None if node is None else _value(node)


def rcl_scalar(text: str) -> bool | int | float | str:
    """The value that `text`, written without quotes, is for rcl."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    for number in (_integer(text), _real(text)):
        if number is not None:
            return number
    return text


def _value(node: yaml.Node) -> object:
    if isinstance(node, yaml.MappingNode):
        return _mapping(node)
    if isinstance(node, yaml.SequenceNode):
        return _sequence(node)
    return node.value if _is_text(node) else rcl_scalar(node.value)


def _mapping(node: yaml.MappingNode) -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.value in ("", "<<"):
            raise _refused("a key that is no name; write the values out under their names", key)
        if key.value in found:
            raise _refused(f"{key.value!r} is given twice", key)
        if _is_nothing(value) and not (isinstance(value, yaml.MappingNode) and key.value == SECTION):
            raise _refused(f"{key.value!r} has no value; give one, or leave it out", value)
        found[key.value] = _value(value)
    return found


def _sequence(node: yaml.SequenceNode) -> list:
    found = [_value(one) for one in node.value]
    kinds = {type(one) for one in found}
    if len(kinds) != 1 or kinds & {dict, list}:
        raise _refused("a list that is not of true and false, of integers, of reals or of texts alone", node)
    return found


def _is_text(node: yaml.ScalarNode) -> bool:
    """Whether what is written is a text whatever it says; tags of other types mean nothing to rcl."""
    return node.style in ("'", '"') or node.tag == _TEXT


def _is_nothing(node: yaml.Node) -> bool:
    """Whether nothing is written, or `{}`."""
    if isinstance(node, yaml.ScalarNode):
        return not node.value and not _is_text(node)
    return isinstance(node, yaml.MappingNode) and not node.value


def _integer(text: str) -> int | None:
    """What strtol makes of all of `text`."""
    if (match := _INTEGER.fullmatch(text)) is None or len(text) > 30:  # int() limits the digits
        return None
    sign, hexadecimal, octal, decimal = match.groups()
    number = int(hexadecimal, 16) if hexadecimal else int(decimal) if decimal else int(octal or "0", 8)
    number = -number if sign == "-" else number
    return number if -2**63 <= number < 2**63 else None


def _real(text: str) -> float | None:
    """What strtod makes of all of `text`; None also for what is too large or too small for it."""
    if match := _DOTTED_WORD.fullmatch(text):
        return float(match[1] + match[2])
    if _WORD.fullmatch(text):
        return float(text.partition("(")[0])
    if _HEXADECIMAL.fullmatch(text):
        return _in_range(float.fromhex, text)
    return _in_range(float, text) if _DECIMAL.fullmatch(text) else None


def _in_range(read, text: str) -> float | None:
    try:
        number = read(text)
    except OverflowError:
        return None
    mantissa = re.split(r"[pP]" if read is float.fromhex else r"[eE]", text)[0]
    if math.isinf(number) or (number == 0.0 and re.search(r"[1-9a-fA-F]", mantissa.lstrip("+-0xX"))):
        return None
    tiny = 0.0 < abs(number) < sys.float_info.min
    return None if tiny and read is float and Fraction(text) != Fraction(number) else number


def _refused(problem: str, marked: yaml.Node | yaml.Event) -> RefusedByRclError:
    return RefusedByRclError(problem=problem, problem_mark=marked.start_mark)
