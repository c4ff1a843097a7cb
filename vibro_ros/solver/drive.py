"""The drive: the phase that the signals are functions of, and how its speed changes.

The speed is constant, on a ramp, or approaches its target exponentially, as a motor with a time constant does. Every
function of this module gets `drive`, the record of `State.drive`.
"""

import math

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.system import STRIDE
from vibro_ros.solver.vector import LENGTH

_NEGLIGIBLE = 1e-18  # beside 1
# Newton's method for the end of a cell: monotone after its first step, because the speed is.
_MOST_NEWTON_STEPS = 60
_NEWTON_END = 4e-16
# Change of the speed over a cell, as part of the speed, at which the cell may be a segment: the phase is then off the
# straight line by a fortieth of the cell's half at most, and the cell's ellipse of convergence as good as the same.
_SMALL_CHANGE = 0.1


@kernel
def enter_next_cell(system, drive):
    """Let the segment start where the next cell does."""
    drive.offset = drive.since = 0.0
    drive.cell += 1
    if drive.cell == len(system.signals.start) - 1:
        drive.cell = 0
        drive.turns += 1


@kernel
def phase_advance(drive, elapsed):
    """Advance of the phase [rad] in `elapsed` [s] from the segment's start, and the speed [rad/s] then."""
    speed, target, lag = drive.speed, drive.target, drive.lag
    if lag > 0.0:
        decayed = -math.expm1(-elapsed / lag)
        return target * elapsed + (speed - target) * lag * decayed, speed + (target - speed) * decayed
    change = drive.acceleration
    # The speed falls to zero, never below: what is less is rounding.
    return elapsed * (speed + 0.5 * change * elapsed), max(0.0, speed + change * elapsed)


@kernel
def advance_speed(drive, elapsed, speed):
    """Set the speed, after `elapsed` [s] of a change, to `speed` [rad/s]; return whether it is at its target now."""
    if drive.time_left == 0.0:
        return False
    drive.speed = speed
    drive.time_left -= elapsed
    if drive.time_left > 0.0:
        return False
    drive.speed = drive.target
    drive.acceleration = drive.lag = drive.time_left = 0.0
    return True


@kernel
def _ramped_time_to_advance(distance, speed, change):
    """Time [s] in which the phase advances by `distance` [rad] at a constant rate of change of its speed; infinite if
    the phase stops before."""
    discriminant = speed * speed + 2.0 * change * distance
    if discriminant < 0.0:
        return math.inf
    rate = speed + math.sqrt(discriminant)
    return 2.0 * distance / rate if rate > 0.0 else math.inf


@kernel
def time_to_advance(drive, distance):
    """Time [s] in which the phase advances by `distance` [rad]; infinite if the phase stops before."""
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


@kernel
def resolved_time(drive, reach):
    """Longest time [s] over which a signal's series in time reaches rounding at its last term.

    The phase must stay within `reach` [rad] for complex times up to 1/STRIDE halves of the segment.
    """
    change = drive.acceleration
    if drive.lag > 0.0:
        # For complex times up to a time constant from the middle, the deviation grows by e at most.
        fastest = drive.target + (math.e - 1.0) * abs(drive.speed - drive.target)
        return 2.0 * STRIDE * min(drive.lag, reach / fastest)
    # By the middle, STRIDE of that time away, the speed has risen.
    change_from_middle = abs(change) + 2.0 * STRIDE * max(change, 0.0)
    return 2.0 * STRIDE * _ramped_time_to_advance(reach, drive.speed, change_from_middle)


@kernel
def measure_cell(drive, width):
    """Note where a cell of the `width` [rad] starts while the speed changes, and whether it may be a segment.

    It may if the change is so small over the cell that the signals are as smooth in time as they are in the phase.
    """
    drive.cells += 1
    drive.version += 1
    drive.since, drive.cell_time, drive.cell_speed = 0.0, 0.0, drive.speed
    time = time_to_advance(drive, width)
    if time < drive.time_left and (drive.lag == 0.0 or time < 2.0 * drive.lag):
        _, end = phase_advance(drive, time)
        if abs(end - drive.speed) < _SMALL_CHANGE * min(end, drive.speed):
            drive.cell_time = time


@kernel
def _fill_change(drive, speed, half, width, series):
    """Fill `series` with what the change of the speed adds to the phase, about an instant at which it is `speed`.

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


@kernel
def fill_shift(drive, half, width, shift):
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
    if slope == 0.0:  # it is rounding that is left of a ramp to 0, no longer than the clock's last digit
        terms = 2
    for n in range(2, terms):
        shift[n] /= slope
    return 2.0 * (drive.offset + advance) / width - 1.0, slope, terms


@kernel
def fill_cell_shift(drive, width, shift):
    """Write the phase over the present cell, of the `width` [rad], as x + shift(x); returns the shift's terms."""
    half = 0.5 * drive.cell_time
    speed = drive.cell_speed + drive.acceleration * half
    if drive.lag > 0.0:
        speed = drive.target + (drive.cell_speed - drive.target) * math.exp(-half / drive.lag)
    terms = _fill_change(drive, speed, half, width, shift)
    for n in range(2, terms):  # as the phase is -1 and 1 where x is, exactly
        shift[n % 2] -= shift[n]
    return terms
