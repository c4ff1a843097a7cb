"""The drive: the phase, of which the signals are functions, and its speed.

The speed is constant, on a ramp, or approaches its target exponentially, as a motor with a time constant does. `drive`
is a record `DRIVE` in every function of this module.

The drive counts along its direction: its speed is never negative, and a cell begins where the phase enters it, so that
a phase that runs backwards passes mirrored cells. A target in the other direction is negative. The speed then falls to
0, where the direction changes, and rises again: two changes, each of one sign.
"""

import math
from typing import Annotated, Any, TypeAlias

import numpy as np

from vibro_ros.solver.elementary import expm1, log1p
from vibro_ros.solver.system import STRIDE, SignalTable, System
from vibro_ros.solver.typed import Kind, Row, part, record
from vibro_ros.solver.vector import LENGTH

#: The phase of the signals, and how its speed changes.
DRIVE = record([
    ("cell", np.int64),  # of `SignalTable`
    ("turns", np.int64),  # whole periods so far, below 0 backwards
    ("direction", np.int64),  # 1, or -1 backwards; the fields below are counted along it
    ("offset", np.float64),  # phase [rad] from where it enters the cell to the segment's start
    ("speed", np.float64),  # rate of the phase [rad/s] at the segment's start, not below 0 ...
    ("residue", np.float64),  # ... the rounding error of its sum while it changes ...
    ("acceleration", np.float64),  # ... its constant rate of change [rad/s²], if it is on a ramp ...
    ("lag", np.float64),  # ... or the time constant [s] with which it approaches its target instead, or 0 ...
    ("target", np.float64),  # ... its target [rad/s], below 0 if the direction has to change first ...
    ("time_left", np.float64),  # ... and the time [s] until it is at the target, or at 0 before that; 0 if constant
])
Drive: TypeAlias = Annotated[Any, Kind(DRIVE, 0)]

_NEGLIGIBLE = 1e-18  # relative to 1
# Newton's method for the end of a cell: monotone after its first step, because the speed is.
_MOST_NEWTON_STEPS = 60
_NEWTON_END = 4e-16
# A speed that approaches its target exponentially has reached it, to rounding, after this many time constants.
_TIME_CONSTANTS = 40.0
# A smaller speed [rad/s] counts as 0, because the time in which it falls to 0 could underflow.
_STANDING = 1e-200


def speed_and_target(drive: np.void) -> tuple[float, float]:
    """Return the speed of the phase and its target [rad/s], below 0 backwards."""
    direction = float(drive["direction"])
    return direction * float(drive["speed"]) + 0.0, direction * float(drive["target"]) + 0.0  # never -0.0


def command_drive(signals: SignalTable, drive: np.void, speed: float, target: float, acceleration: float = 0.0,
                  lag: float = 0.0) -> None:
    """Set the speed of the phase at the segment's start to `speed` [rad/s], and let it go to `target` [rad/s], below 0
    backwards: at `acceleration` [rad/s²] or with the time constant `lag` [s]; without either the speed is constant."""
    speed, target = (0.0 if abs(rate) < _STANDING else rate for rate in (speed, target))
    forwards = speed or target
    if forwards and (forwards < 0.0) != (drive["direction"] < 0):
        width = signals.start[drive["cell"] + 1] - signals.start[drive["cell"]]
        drive["direction"], drive["offset"] = -drive["direction"], max(0.0, width - drive["offset"])
    direction = float(drive["direction"])
    speed, target = direction * speed + 0.0, direction * target + 0.0
    drive["speed"], drive["target"] = speed, target
    drive["acceleration"] = drive["lag"] = drive["time_left"] = drive["residue"] = 0.0
    if target == speed:
        return
    if lag:
        drive["lag"] = lag
        drive["time_left"] = lag * (log1p(-speed / target) if target < 0.0 else _TIME_CONSTANTS)
    elif acceleration:
        drive["acceleration"] = math.copysign(acceleration, target - speed)
        drive["time_left"] = abs(max(target, 0.0) - speed) / acceleration


@part
def enter_next_cell(system: System, drive: Drive) -> None:
    """Let the segment start where the next cell starts."""
    drive.offset = 0.0
    drive.cell += drive.direction
    if drive.cell == len(system.signals.start) - 1:
        drive.cell = 0
        drive.turns += 1
    elif drive.cell < 0:
        drive.cell = len(system.signals.start) - 2
        drive.turns -= 1


@part
def phase_advance(drive: Drive, elapsed: float) -> tuple[float, float]:
    """Return the advance of the phase [rad] in `elapsed` [s] from the segment's start, and the speed [rad/s] then; also
    beyond the instant at which the direction changes, up to `settling_time`."""
    speed, target, lag = drive.speed, drive.target, drive.lag
    if lag > 0.0:
        decayed = -expm1(-elapsed / lag)
        return target * elapsed + (speed - target) * lag * decayed, speed + (target - speed) * decayed
    change = drive.acceleration
    # The speed falls to its target, never below except by rounding, which is cut off.
    return elapsed * (speed + 0.5 * change * elapsed), max(min(0.0, target), speed + change * elapsed)


@part
def _rising_time(target: float, acceleration: float, lag: float) -> float:
    """Return the time [s] in which the speed rises from 0 to its target."""
    return _TIME_CONSTANTS * lag if lag > 0.0 else target / acceleration


@part
def settling_time(drive: Drive) -> float:
    """Return the time [s] until the speed is at its target, in either direction; 0 if the speed does not change."""
    if drive.time_left == 0.0 or drive.target >= 0.0:
        return drive.time_left
    return drive.time_left + _rising_time(-drive.target, -drive.acceleration, drive.lag)


@part
def advance_speed(drive: Drive, elapsed: float, speed: float) -> bool:
    """Set the speed, after `elapsed` [s] of a change, to `speed` [rad/s]; return whether it is at its target now.

    The rounding error of the sum is added to the next change, because a change takes thousands of segments. If the
    speed has fallen to 0 on its way to a target in the other direction, the direction changes. The caller must then
    count the offset from the cell's other end. A step of fixed length may end after that instant, at a negative speed.
    """
    if drive.time_left == 0.0:
        return False
    change = drive.acceleration * elapsed
    if drive.lag > 0.0:
        change = (drive.speed - drive.target) * expm1(-elapsed / drive.lag)
    drive.time_left -= elapsed
    if drive.time_left > 0.0:
        lost = drive.residue + (change - (speed - drive.speed))
        drive.speed = max(min(0.0, drive.target), speed + lost)
        drive.residue = lost - (drive.speed - speed)
        return False
    if drive.target < 0.0:
        drive.direction = -drive.direction
        drive.target, drive.acceleration = -drive.target, -drive.acceleration
        drive.speed, drive.residue = max(0.0, -speed), 0.0
        drive.time_left += _rising_time(drive.target, drive.acceleration, drive.lag)
        if drive.time_left > 0.0:
            return False
    drive.speed = drive.target
    drive.acceleration = drive.lag = drive.time_left = drive.residue = 0.0
    return True


@part
def _ramped_time_to_advance(distance: float, speed: float, change: float) -> float:
    """Return the time [s] in which the phase advances by `distance` [rad] at the rate `change` [rad/s²] of its speed;
    infinite if the phase stops before."""
    discriminant = speed * speed + 2.0 * change * distance
    if discriminant < 0.0:
        return math.inf
    rate = speed + math.sqrt(discriminant)
    return 2.0 * distance / rate if rate > 0.0 else math.inf


@part
def time_to_advance(drive: Drive, distance: float) -> float:
    """Return the time [s] in which the phase advances by `distance` [rad]; infinite if the phase stops before."""
    if drive.lag == 0.0:
        return _ramped_time_to_advance(distance, drive.speed, drive.acceleration)
    if drive.target == 0.0 and drive.speed * drive.lag <= distance:
        return math.inf
    time = distance / max(drive.speed, drive.target)
    for _ in range(_MOST_NEWTON_STEPS):
        phase, rate = phase_advance(drive, time)
        if rate <= 0.0:
            return math.inf
        step = (distance - phase) / rate
        time += step
        if abs(step) <= _NEWTON_END * time:
            break
    return time


@part
def resolved_time(drive: Drive, reach: float) -> float:
    """Return the longest time [s] over which a signal's series in time reaches rounding at its last term.

    The phase must stay within `reach` [rad] for complex times up to 1/STRIDE halves of the segment.
    """
    change = drive.acceleration
    if drive.lag > 0.0:
        # For complex times up to a time constant from the middle, the deviation grows by e at most.
        fastest = abs(drive.target) + (math.e - 1.0) * abs(drive.speed - drive.target)
        return 2.0 * STRIDE * min(drive.lag, reach / fastest)
    # A rising speed is larger at the middle, STRIDE of that time after the start.
    change_from_middle = abs(change) + 2.0 * STRIDE * max(change, 0.0)
    return 2.0 * STRIDE * _ramped_time_to_advance(reach, drive.speed, change_from_middle)


@part
def _fill_change(drive: Drive, speed: float, half: float, width: float, series: Row) -> int:
    """Fill `series` with the phase that the change of the speed adds, about an instant at which the speed is `speed`.

    The phase is in halves of the cell's `width` [rad], the time in `half` [s]. Returns the number of terms, 2 if there
    is no change.
    """
    series[:] = 0.0
    if drive.lag == 0.0:
        series[2] = drive.acceleration * half * half / width
        return 2 if series[2] == 0.0 else 3
    shrink = half / drive.lag
    series[2] = (drive.target - speed) * shrink * half / width
    terms = 3
    while terms < LENGTH and abs(series[terms - 1]) > _NEGLIGIBLE:
        series[terms] = -series[terms - 1] * shrink / terms
        terms += 1
    return terms


@part
def fill_shift(drive: Drive, half: float, width: float, shift: Row) -> tuple[float, float, int]:
    """Write the phase over a segment of the duration 2 `half` [s] as middle + slope (x + shift(x)).

    The phase is counted from the middle of its cell in halves of the cell's `width` [rad].

    Returns
    -------
    (float, float, int)
        Middle and slope, dimensionless, and the number of the shift's terms, or 2 if there is none.
    """
    advance, speed = phase_advance(drive, half)
    terms = _fill_change(drive, speed, half, width, shift)
    slope = speed * half * 2.0 / width
    if slope == 0.0:  # the rest of a ramp to 0, no longer than the clock's rounding error
        terms = 2
    for n in range(2, terms):
        shift[n] /= slope
    return 2.0 * (drive.offset + advance) / width - 1.0, slope, terms
