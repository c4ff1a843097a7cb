"""An entry of a script that feedback plays: `hold_speed` or `go_to`, read and checked."""

from collections.abc import Mapping

from vibro_ros.ros.controller.goals import MOTOR_RANGE, WITHIN, Goal, PositionGoal, SpeedGoal
from vibro_ros.ros.controller.script_values import command_value, finite_number, positive_number, refuse_unknown

GOAL_KEYS = ("hold_speed", "go_to")
"""Keys that make an entry one of feedback."""
SHORTEST = 4.0
"""Shortest time [s] to hold a speed: half of it to settle, half of it to be measured over some turns of the crank."""


def read_goal(entry: Mapping, gaps: tuple[str, ...], where: str) -> Goal:
    """The goal of an entry that has one of `GOAL_KEYS`.

    Parameters
    ----------
    entry : mapping
        As in the file.
    gaps : tuple of str
        Commands that it may give beside the goal.
    where : str
        Begins a refusal.

    Raises
    ------
    ValueError
        For what is missing, unknown or out of range.
    """
    if all(key in entry for key in GOAL_KEYS):
        raise ValueError(f"{where}hold_speed and go_to: one entry has one goal; make two entries of it")
    motor = _motor(entry.get("motor_speed", {}), where)
    if "go_to" in entry:
        refuse_unknown(entry, ("at", "timeout", "note", "go_to", "within", "motor_speed", *gaps), where)
        return PositionGoal(finite_number(entry["go_to"], f"{where}go_to", "m"), _within(entry, "m", where), motor)
    refuse_unknown(entry, ("at", "for", "note", "hold_speed", "within", "motor_speed", *gaps), where)
    speed = finite_number(entry["hold_speed"], f"{where}hold_speed", "m/s")
    return SpeedGoal(speed, _within(entry, "m/s", where), motor)


def longest_time(entry: Mapping, where: str) -> float:
    """How long [s] the entry of a position goal may last.

    Raises
    ------
    ValueError
        When it does not say so.
    """
    if "timeout" not in entry:
        raise ValueError(f"{where}go_to: no longest time; give `timeout: <seconds>`")
    return positive_number(entry["timeout"], f"{where}timeout", "s")


def check_shortest(duration: float, where: str) -> None:
    """Refuse a time that is too short to hold a speed in."""
    if duration < SHORTEST:
        raise ValueError(f"{where}hold_speed: {duration:g} s is too short to settle and to be measured; give at least "
                         f"{SHORTEST:g} s")


def _within(entry: Mapping, unit: str, where: str) -> float:
    return positive_number(entry.get("within", WITHIN), f"{where}within", unit)


def _motor(value: object, where: str) -> tuple[float, float]:
    """The range of motor speeds, from a mapping with `from`, `to` or neither."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{where}motor_speed: {value!r} is no range; beside a goal give the range that feedback uses, "
                         "{from: …, to: …}, or leave it out")
    refuse_unknown(value, ("from", "to"), f"{where}motor_speed: ")
    low, high = (command_value("motor_speed", value.get(key, default), where)
                 for key, default in zip(("from", "to"), MOTOR_RANGE, strict=True))
    if low >= high:
        raise ValueError(f"{where}motor_speed: from {low:g} to {high:g} rad/s is no range; give `to` above `from`")
    return low, high
