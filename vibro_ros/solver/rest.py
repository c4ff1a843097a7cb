"""Rest, which replaces a motion that has died away.

The time constant of a mass on a stiff plate is a fraction of a millisecond, and so are its segments while it moves.
When a damper has ended the motion, to rounding, the series would only repeat the rounding, thousands of times a second.
If nothing drives the dynamic coordinates any more, they are held where the forces balance, in segments of up to a
second.
"""

import math

from vibro_ros.solver.channels import first_signal
from vibro_ros.solver.guards import EPSILON
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import State
from vibro_ros.solver.system import System, sparse_magnitude
from vibro_ros.solver.typed import Row, part

# A motion that has died away is never quite at rest, because each segment rounds it again. The rounding errors of as
# many segments as a damper needs to end the motion, at most this many, add up like the steps of a random walk.
_ROUNDING = 2.0 * EPSILON
_MOST_SEGMENTS = 1e4
# Coordinates that enter each other's equations are balanced in turn, in at most this many sweeps.
_MOST_SWEEPS = 20


@part
def _is_driven(state: State) -> bool:
    drive = state.drive
    if drive.speed != 0.0 or drive.time_left > 0.0:
        return True
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            return True
    return False


@part
def acceleration_noise(system: System, state: State, i: int, magnitude: Row) -> float:
    """Return the acceleration of dynamic coordinate i that rounding leaves after its motion has died away."""
    mode, coordinates = state.automaton.mode, system.counts[0].coordinates
    row = system.equations[mode, i]
    stiffness, damping = -row[i], -row[coordinates + i]
    # The slower part of the motion decays at these rates [1/s], below and beyond critical damping.
    ending = min(0.5 * damping, stiffness / damping) * system.longest_segment[mode] if damping > 0.0 else 0.0
    segments = 1.0 / ending if ending * _MOST_SEGMENTS > 1.0 else 1.0
    return _ROUNDING * (1.0 + math.sqrt(segments)) * sparse_magnitude(row, system.reads_all[mode, i], magnitude)


@part
def _acceleration(row: Row, held: Row) -> float:
    total = 0.0
    for channel in range(len(held)):
        total += row[channel] * held[channel]
    return total


@part
def _is_settled(system: System, state: State, i: int, speed: float, held: Row, magnitude: Row) -> bool:
    """Return whether dynamic coordinate i, which moves at `speed`, is at rest to rounding.

    Its own stiffness decides what speed rounding may cause; without stiffness the speed must be exactly 0.
    """
    row, noise = system.equations[state.automaton.mode, i], acceleration_noise(system, state, i, magnitude)
    if abs(_acceleration(row, held)) > noise:
        return False
    return speed == 0.0 or (row[i] < 0.0 and abs(speed) * math.sqrt(-row[i]) <= noise)


@part
def _balance(system: System, state: State, held: Row) -> None:
    """Move each dynamic coordinate, within the rounding that `_is_settled` allows, to where its acceleration is 0."""
    mode = state.automaton.mode
    for _ in range(_MOST_SWEEPS):
        moved: bool = False
        for i in range(system.counts[0].dynamic):
            row = system.equations[mode, i]
            if row[i] < 0.0:
                balanced = held[i] - _acceleration(row, held) / row[i]
                moved = moved or balanced != held[i]
                held[i] = balanced
        if not moved:
            return


@part
def is_at_rest(system: System, state: State, point: Row, held: Row) -> bool:
    """Return whether the dynamic coordinates rest at positions and velocities of `point`, under the segment's forcing.

    `held`, shape (channels,), receives the positions at which they stay.
    """
    dynamic, coordinates, first = system.counts[0].dynamic, system.counts[0].coordinates, first_signal(system.counts[0])
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


@part
def lengthen_segment(state: State) -> None:
    """Let the segment last for `LONGEST_SEGMENT`."""
    state.segment.half = 0.5 * LONGEST_SEGMENT
