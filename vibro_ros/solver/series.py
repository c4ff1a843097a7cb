"""The series of a motion of the dynamic coordinates, term by term from its constant terms."""

from vibro_ros.solver.compilation import kernel, rounding_kernel
from vibro_ros.solver.economization import economized_powers
from vibro_ros.solver.polynomial import INVERSE
from vibro_ros.solver.vector import LENGTH, store, vector

# So many terms follow those of a motion over a cell until they are lost in rounding: 3.4^32 / 32!.
_ECONOMIZED = economized_powers(LENGTH, 8)


@rounding_kernel  # a mass at rest on its slider feels exactly no force
def _solve_oscillator(load, stiffness, damping, half, q, v):
    """Series of q and v = q' with q'' = load + stiffness q + damping v, from their constant terms."""
    position, velocity = q[0], v[0]
    for n in range(LENGTH - 1):
        step = half * INVERSE[n]
        acceleration = load[n] + stiffness * position + damping * velocity
        position = velocity * step
        velocity = acceleration * step
        q[n + 1] = position
        v[n + 1] = velocity


@kernel
def _solve_coupled(loads, row, half, coordinates, dynamic, motion):
    """Series of coordinates that enter each other's equations; `loads` has a row for each, `motion` two."""
    for n in range(LENGTH - 1):
        step = half * INVERSE[n]
        for i in range(dynamic):
            acceleration = loads[i, n]
            for j in range(dynamic):
                acceleration += row[i, j] * motion[j, n] + row[i, coordinates + j] * motion[dynamic + j, n]
            motion[dynamic + i, n + 1] = acceleration * step
        for i in range(dynamic):
            motion[i, n + 1] = motion[dynamic + i, n] * step


@kernel
def solve_series(system, state, motion):
    """Series of the components of a motion from their constant terms, under the loads in the scratch."""
    coordinates, dynamic = system.size[0].coordinates, system.size[0].dynamic
    mode, half, load = state.now[0].automaton.mode, state.now[0].segment.half, state.scratch.room[0].load[:]
    rows = system.acceleration[mode]
    if system.coupled[mode]:
        _solve_coupled(load, rows, half, coordinates, dynamic, motion)
        return
    for i in range(dynamic):
        _solve_oscillator(load[i], rows[i, i], rows[i, coordinates + i], half, motion[i], motion[dynamic + i])


@kernel
def economize(system, state, motion):
    """Add to the series of a motion over a cell what the terms beyond their length come to.

    The cell's forcing lasts longer than the flow's series resolve; only the first of the terms beyond them matter.
    """
    coordinates, dynamic = system.size[0].coordinates, system.size[0].dynamic
    half, rows = state.now[0].segment.half, system.acceleration[state.now[0].automaton.mode]
    room = state.scratch.room[0]
    now, following, load = room.term[:], room.next_term[:], room.load[:]
    for c in range(2 * dynamic):
        now[c] = motion[c, LENGTH - 1]
    for i in range(dynamic):
        now[2 * dynamic + i] = load[i, LENGTH - 1]
    for k in range(len(_ECONOMIZED)):
        step = half / (LENGTH + k)
        for i in range(dynamic):
            acceleration = now[2 * dynamic + i]
            for j in range(dynamic):
                acceleration += rows[i, j] * now[j] + rows[i, coordinates + j] * now[dynamic + j]
            following[i] = now[dynamic + i] * step
            following[dynamic + i] = acceleration * step
            now[2 * dynamic + i] = 0.0
        for c in range(2 * dynamic):
            now[c] = following[c]
            store(motion[c], vector(motion[c]) + now[c] * vector(_ECONOMIZED[k]))
