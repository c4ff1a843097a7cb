"""Following: a stiff coordinate whose own motion has died away goes where its forcing takes it.

A mass that is pressed on a stiff plate is fast: so short are the segments that resolve its motion. When a damper has
ended that motion, to rounding, the mass only follows its slow forcing L, by the one solution of

    q'' = L - K q - C q'

that is slow itself. Where L is a polynomial of the segment's local time, so is that solution, of the same length; its
coefficients follow from those of L from the last to the first, which is stable in long segments only. A segment then
lasts as long as the forcing and the other coordinates allow.
"""

import math

from vibro_ros.solver.channels import first_signal
from vibro_ros.solver.compilation import called_kernel, kernel
from vibro_ros.solver.flow import fill_accelerations, fill_loads
from vibro_ros.solver.polynomial import value
from vibro_ros.solver.rest import acceleration_noise
from vibro_ros.solver.segment import part_of_cell
from vibro_ros.solver.system import RATE_LIMIT
from vibro_ros.solver.vector import LENGTH

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
def lengthen_to_follow(system, state, longest):
    """Let the segment last, up to `longest` [s], as if the stiff coordinates followed their forcing; whether that is
    worth a trial."""
    segment, mode = state.now[0].segment, state.now[0].automaton.mode
    if system.coupled[mode] or segment.slot == state.now[0].drive.cell:
        return False
    if segment.half < 0.5 * system.longest_segment[mode]:
        return False
    segment.cut_short += 1
    if segment.cut_short <= _PATIENCE:
        return False
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
    """Series of dynamic coordinate i that follows the loads in the scratch."""
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
