"""Single values of a script's entries, checked; a refusal says where, what, and what to give."""

import sys
from collections.abc import Mapping

from vibro_ros.messages.topics import COMMAND_UNITS


def command_value(name: str, value: object, where: str) -> float:
    """The value of a command, in the units of `COMMAND_UNITS`.

    Raises
    ------
    ValueError
        As all of this module.
    """
    level = finite_number(value, f"{where}{name}", COMMAND_UNITS[name])
    if name == "motor_speed" and level < 0.0:
        raise ValueError(f"{where}{name}: {level:g} is negative; give a number of at least 0 rad/s")
    return level


def positive_number(value: object, what: str, unit: str) -> float:
    """A finite number above 0."""
    number = finite_number(value, what, unit)
    if number <= 0.0:
        raise ValueError(f"{what}: {number:g} is not above 0; give a number above 0 {unit}")
    return number


def finite_number(value: object, what: str, unit: str) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError(f"{what}: {shown(value)} is not a number; give a number in {unit}")
    if not abs(value) <= sys.float_info.max:  # also false for NaN
        raise ValueError(f"{what}: {value} is not finite; give a number in {unit}")
    return float(value)


def refuse_unknown(given: Mapping, known: tuple[str, ...], where: str) -> None:
    """Refuse keys that mean nothing."""
    for key in given:
        if key not in known:
            raise ValueError(f"{where}{key}: unknown key; give {', '.join(known)}")


def shown(value: object) -> str:
    """A value as a refusal shows it."""
    return "missing" if value is None else repr(value)
