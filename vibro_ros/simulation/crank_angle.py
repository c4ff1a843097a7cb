"""Advance to the instant at which the crank of a dc motor reaches an angle, exactly.

Near the angle the crank is followed segment by segment, because the angle is a polynomial over each; farther away the
motion advances over many segments at once, and goes back if the crank has turned too far meanwhile.
"""

import math

import numpy as np

from vibro_ros.simulation import checkpoint
from vibro_ros.simulation.motion import Motion
from vibro_ros.simulation.samples import CRANK_ANGLE, MOTOR_SPEED

_TURN = 2.0 * math.pi
# Angle [rad] before the target within which the crank is followed segment by segment; and number of instants at which
# the crank is checked over a longer distance.
_NEAR, _CHECKS = 0.5, 8
# Local time to which an angle's instant is found: two roundings of 1.
_NARROWEST = 4e-16


def advance_to_angle(motion: Motion, turn: int, angle: float, latest: float) -> bool:
    """Advance to the instant at which the crank first has made whole turns and reaches an `angle` beyond them [rad].

    Stop at the instant `latest` [s] if the crank does not reach the angle before. Return whether the crank has reached
    the angle.
    """
    phase, may_hop = motion.model.forms.channels.phase, True
    while True:
        segment, turns = motion.state.now["segment"][0], int(motion.state.now["drive"]["turns"][0])
        start, half = float(segment["start"]) + float(segment["residue"]), float(segment["half"])
        now, end = (motion.time - start) / half - 1.0, float(segment["next_event"])
        x = first_reached(motion.state.z[phase], (turn - turns) * _TURN + angle, now, end)
        # An event lies at the segment's end to rounding; the next float is after it.
        time = (max(motion.time, start + half * (1.0 + x)) if x is not None else
                max(math.nextafter(motion.time, math.inf), start + half * (1.0 + end)))
        if x is None and may_hop and motion.disturbances.next_end == math.inf:
            may_hop = _hop(motion, turn, angle, latest)
            continue
        limit = min(latest, motion.disturbances.next_end)
        motion.advance_to(min(time, limit))
        if x is not None and time <= limit:
            return True
        if motion.time >= latest:
            return False


def _hop(motion: Motion, turn: int, angle: float, latest: float) -> bool:
    """Advance over many segments at once, for half the time to the angle at the crank's present speed.

    If a sample shows that the crank turns back or has reached the angle, the motion is as before the call. Return
    whether to try another hop.
    """
    now = motion.now()
    remaining, speed = turn * _TURN + angle - now[CRANK_ANGLE], now[MOTOR_SPEED]
    if remaining < _NEAR or speed <= 0.0 or motion.time + 0.5 * remaining / speed > latest:
        return False
    time, mark = motion.time, motion.events.mark()
    parts = [part.copy() for part in checkpoint.parts_of(motion)]
    trace = motion.new_trace(_CHECKS)
    motion.advance_at_once(np.linspace(time, time + 0.5 * remaining / speed, _CHECKS + 1)[1:], trace)
    turns, phase, rate = trace.phases.T
    if (rate > 0.0).all() and ((turns - turn) * _TURN + phase < angle).all():
        return True
    motion.time = time
    for part, values in zip(checkpoint.parts_of(motion), parts, strict=True):
        part[...] = values
    motion.go_on_from_overwritten()
    motion.events.drop_since(mark)
    return False


def first_reached(p: np.ndarray, value: float, start: float, end: float) -> float | None:
    """Return the first x from `start` to `end`, within -1 to 1, where the polynomial sum of p[n] x^n reaches `value`
    from below; None if there is none."""
    coefficients = p.tolist()
    bend = sum(n * (n - 1) * abs(coefficient) for n, coefficient in enumerate(coefficients))  # of p'' on [-1, 1]
    intervals = [(start, end)]  # to search, the first one last
    while intervals:
        low, high = intervals.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        position, slope = _value_and_slope(coefficients, middle)
        if position - value + (abs(slope) + 0.5 * bend * half) * half < 0.0:
            continue
        at_low, at_high = (_value_and_slope(coefficients, x)[0] for x in (low, high))
        if at_low >= value:
            return low
        if abs(slope) > bend * half or half < _NARROWEST:  # it rises or falls throughout
            if at_high >= value:
                return _crossing(coefficients, value, low, high)
            continue
        intervals += [(middle, high), (low, middle)]
    return None


def _value_and_slope(p: list[float], x: float) -> tuple[float, float]:
    value = slope = 0.0
    for coefficient in reversed(p):
        value, slope = value * x + coefficient, slope * x + value
    return value, slope


def _crossing(p: list[float], value: float, low: float, high: float) -> float:
    """Return where p, which rises from `low` to `high`, reaches `value`, by Newton's method or else by halving."""
    x = high
    while high - low > _NARROWEST:
        position, slope = _value_and_slope(p, x)
        low, high = (low, x) if position >= value else (x, high)
        step = (position - value) / slope if slope > 0.0 else math.inf
        if abs(step) < _NARROWEST:
            break
        x = x - step if low < x - step < high else 0.5 * (low + high)
    return x
