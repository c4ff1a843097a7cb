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


@kernel
def enter_next_cell(system, drive):
    """Let the segment start where the next cell does."""
    drive.offset = 0.0
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
        # For complex times up to 1/STRIDE half segments the decay grows by e at most, and the phase with it.
        fastest = max(drive.speed, drive.target)
        return 2.0 * STRIDE * min(drive.lag, reach / (2.0 * math.e * fastest))
    # By the middle, STRIDE of that time away, the speed has risen.
    change_from_middle = abs(change) + 2.0 * STRIDE * max(change, 0.0)
    return 2.0 * STRIDE * _ramped_time_to_advance(reach, drive.speed, change_from_middle)


@kernel
def fill_phase(drive, half, width, series):
    """Fill `series` with the phase over a segment of the duration 2 `half` [s]; return the number of its terms.

    The phase is counted from the middle of its cell in halves of the cell's `width` [rad].
    """
    advance, speed = phase_advance(drive, half)
    series[:] = 0.0
    series[0] = 2.0 * (drive.offset + advance) / width - 1.0
    series[1] = speed * half * 2.0 / width
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
