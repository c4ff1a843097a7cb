"""What is solved in place of a motion that has died away: rest, and following.

A mass that is pressed on a stiff plate moves, once it is disturbed, within a fraction of a millisecond: so short are
the segments of its mode while it moves. When a damper has ended the motion, to rounding, the series would only repeat
the rounding, thousands of times a second.

*Rest*: nothing drives the dynamic coordinates any more. They are held where the forces balance, in segments of up to a
second.

*Following*: a stiff coordinate goes where its slow forcing L takes it, by the one solution of

    q'' = L - K q - C q'

that is slow itself. Where L is a polynomial of the segment's local time, so is that solution, of the same length; its
coefficients follow from those of L from the last to the first, which is stable in long segments only. A segment then
lasts as long as the forcing and the other coordinates allow.
"""

import math

from vibro_ros.solver.compilation import called_kernel, kernel, rounding_kernel
from vibro_ros.solver.flow import fill_accelerations, fill_loads
from vibro_ros.solver.guards import EPSILON
from vibro_ros.solver.polynomial import value
from vibro_ros.solver.segment import LONGEST_SEGMENT, part_of_cell
from vibro_ros.solver.system import RATE_LIMIT, first_signal, form_magnitude
from vibro_ros.solver.vector import LENGTH

# A motion that has died away is never quite at rest: each segment rounds it again. The roundings of as many segments as
# a damper takes to end the motion add up like the steps of a random walk.
_ROUNDING = 2.0 * EPSILON
_MOST_SEGMENTS = 1e4
# Coordinates that enter each other's equations are balanced in turn, so many times at most.
_MOST_SWEEPS = 20


@kernel
def _is_driven(state):
    drive = state.now[0].drive
    if drive.speed != 0.0 or drive.time_left > 0.0:
        return True
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            return True
    return False


@kernel
def acceleration_noise(system, state, i, magnitude):
    """What rounding leaves of the acceleration of dynamic coordinate i, however long its motion has died away."""
    mode, coordinates = state.now[0].automaton.mode, system.size[0].coordinates
    row = system.acceleration[mode, i]
    stiffness, damping = -row[i], -row[coordinates + i]
    # Below and beyond critical damping the slower part of the motion ends at these rates [1/s].
    ending = min(0.5 * damping, stiffness / damping) * system.longest_segment[mode] if damping > 0.0 else 0.0
    segments = 1.0 / ending if ending * _MOST_SEGMENTS > 1.0 else 1.0
    return _ROUNDING * (1.0 + math.sqrt(segments)) * form_magnitude(row, magnitude)


@rounding_kernel  # a mass at rest on its slider feels exactly no force
def _acceleration(row, held):
    total = 0.0
    for channel in range(len(held)):
        total += row[channel] * held[channel]
    return total


@kernel
def _is_settled(system, state, i, speed, held, magnitude):
    """Whether dynamic coordinate i, which moves at `speed`, stays where it is, to rounding.

    Its own stiffness tells how fast it may be by rounding; where there is none, it must stand still exactly.
    """
    row, noise = system.acceleration[state.now[0].automaton.mode, i], acceleration_noise(system, state, i, magnitude)
    if abs(_acceleration(row, held)) > noise:
        return False
    return speed == 0.0 or (row[i] < 0.0 and abs(speed) * math.sqrt(-row[i]) <= noise)


@kernel
def _balance(system, state, held):
    """Move each dynamic coordinate to where its acceleration is zero: by the rounding that `_is_settled` allows."""
    mode = state.now[0].automaton.mode
    for _ in range(_MOST_SWEEPS):
        moved = False
        for i in range(system.size[0].dynamic):
            row = system.acceleration[mode, i]
            if row[i] < 0.0:
                balanced = held[i] - _acceleration(row, held) / row[i]
                moved = moved or balanced != held[i]
                held[i] = balanced
        if not moved:
            return


@kernel
def is_at_rest(system, state, point, held):
    """Whether the dynamic coordinates rest at the positions and velocities of `point`, under the segment's forcing.

    `held`, shape (channels,), receives the positions at which they stay.
    """
    dynamic, coordinates, first = system.size[0].dynamic, system.size[0].coordinates, first_signal(system.size[0])
    if dynamic == 0 or _is_driven(state):
        return False
    magnitude = state.scratch.magnitude
    for channel in range(len(held)):
        held[channel] = point[channel] if channel < dynamic else state.z[channel, 0] if channel >= first else 0.0
        magnitude[channel] = abs(held[channel])
    for i in range(dynamic):
        if not _is_settled(system, state, i, point[coordinates + i], held, magnitude):
            return False
    _balance(system, state, held)
    return True


@kernel
def lengthen_segment(state):
    """Let the segment last as long as any."""
    state.now[0].segment.half = 0.5 * LONGEST_SEGMENT


# Short segments in a row after which it is tried whether the motion has died away: a mass that bounces has few.
_PATIENCE = 8
# A segment that is not so many times as long as the short ones is not worth it.
_WORTHWHILE = 4.0
# Coordinates whose series reach no further than so many times as far as the shortest are the stiff ones.
_STIFF = 2.0
# Share of a coefficient, at most, that those after it make up: they are summed from the last to the first.
_STABLE = 0.5


@kernel
def _resolved(row, coordinates, i):
    """Duration [s] of the longest segment in which the series of a coordinate's own motion reach rounding."""
    stiffness, half_damping = -row[i], -0.5 * row[coordinates + i]
    excess = half_damping * half_damping - stiffness
    rate = half_damping + math.sqrt(excess) if excess > 0.0 else math.sqrt(stiffness)
    return 2.0 * RATE_LIMIT / rate if rate > 0.0 else math.inf


@kernel
def _is_stiff(system, state, i):
    mode = state.now[0].automaton.mode
    row = system.acceleration[mode, i]
    return row[i] < 0.0 and _resolved(row, system.size[0].coordinates, i) <= _STIFF * system.longest_segment[mode]


@kernel
def lengthen_to_follow(system, state):
    """Let the segment last as if the stiff coordinates followed their forcing; whether that is worth a trial."""
    segment, mode = state.now[0].segment, state.now[0].automaton.mode
    if system.coupled[mode] or segment.slot == state.now[0].drive.cell:
        return False
    if segment.half < 0.5 * system.longest_segment[mode]:
        return False
    segment.cut_short += 1
    if segment.cut_short <= _PATIENCE:
        return False
    longest = math.inf
    for i in range(system.size[0].dynamic):
        if not _is_stiff(system, state, i):
            longest = min(longest, _resolved(system.acceleration[mode, i], system.size[0].coordinates, i))
    duration = part_of_cell(system, state, longest)
    if duration < _WORTHWHILE * system.longest_segment[mode]:
        return False
    segment.half = 0.5 * duration
    return True


@kernel
def _fill_following(load, stiffness, damping, half, q, v):
    """Series of the slow solution q of q'' = load - stiffness q - damping q', and of v = q'."""
    last, after = 0.0, 0.0
    for n in range(LENGTH - 1, -1, -1):
        rate = (n + 1) * last / half
        acceleration = (n + 1) * (n + 2) * after / (half * half)
        after = last
        last = (load[n] - damping * rate - acceleration) / stiffness
        q[n], v[n] = last, rate


@kernel
def _follow(system, state, i):
    coordinates, row = system.size[0].coordinates, system.acceleration[state.now[0].automaton.mode, i]
    _fill_following(state.scratch.room[0].load[:][i], -row[i], -row[coordinates + i], state.now[0].segment.half,
                    state.z[i], state.z[coordinates + i])


@kernel
def _follows(system, state, i, point):
    """Whether dynamic coordinate i is where `point` has it, to rounding, if it follows its forcing."""
    coordinates, half = system.size[0].coordinates, state.now[0].segment.half
    row = system.acceleration[state.now[0].automaton.mode, i]
    if LENGTH / half * ((LENGTH + 1) / half - row[coordinates + i]) > -_STABLE * row[i]:
        return False
    _follow(system, state, i)
    noise = acceleration_noise(system, state, i, state.scratch.magnitude)
    velocity = value(state.z[coordinates + i], -1.0)
    return (abs(point[i] - value(state.z[i], -1.0)) * -row[i] <= noise
            and abs(point[coordinates + i] - velocity) * math.sqrt(-row[i]) <= noise)


@called_kernel
def stiff_ones_follow(system, state, point):
    """Whether all stiff coordinates are where `point` has them, to rounding, if they follow the segment's forcing."""
    magnitude, signals = state.scratch.magnitude, first_signal(system.size[0])
    for channel in range(len(magnitude)):
        magnitude[channel] = abs(point[channel]) if channel < system.size[0].dynamic else 0.0
        if channel >= signals:
            magnitude[channel] = state.scale[channel]
    fill_loads(system, state)
    for i in range(system.size[0].dynamic):
        if _is_stiff(system, state, i) and not _follows(system, state, i, point):
            state.now[0].segment.cut_short = 0
            return False
    return True


@called_kernel
def follow_forcing(system, state):
    """Replace the series of the stiff coordinates by those that follow the segment's forcing."""
    coordinates = system.size[0].coordinates
    fill_loads(system, state)
    for i in range(system.size[0].dynamic):
        if _is_stiff(system, state, i):
            _follow(system, state, i)
            for channel in (i, coordinates + i):
                state.scale[channel] = abs(state.z[channel, 0]) + abs(state.z[channel, 1])
    fill_accelerations(system, state)
