"""The flow of a mode: its exact solution over a segment, as power series about the segment's middle.

With polynomial forcing a linear equation determines the series of its solution term by term; the segments are short
enough for the series to end at rounding (`System.longest_step`). Any forced motion serves as long as the free motion
is added that makes it begin where it should: free motion, and forced motion over a whole cell at a steady speed, are
therefore kept for the next segment of their kind.
"""

from vibro_ros.solver.compilation import kernel, rounding_kernel, sum_kernel
from vibro_ros.solver.economization import economized_powers
from vibro_ros.solver.polynomial import (
    INVERSE,
    differentiate,
    fill_form,
    integrate_through,
    value,
)
from vibro_ros.solver.state import ANCHOR, CELL, ENTRANCE, HALF, MODE, SLOT, STANDSTILLS, VERSION
from vibro_ros.solver.vector import LENGTH, powers, store, total, vector, with_first

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
    """The same for coordinates that enter each other's equations; `loads` has a row for each, `motion` two."""
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
def _solve(system, state, motion):
    """Series of the components of the motion from their constant terms, under the loads in `work`."""
    coordinates, dynamic = system.sizes[0], system.sizes[1]
    half, rows = state.clock[HALF], system.acceleration[state.index[MODE]]
    if system.coupled[state.index[MODE]]:
        _solve_coupled(state.work, rows, half, coordinates, dynamic, motion)
        return
    for i in range(dynamic):
        _solve_oscillator(state.work[i], rows[i, i], rows[i, coordinates + i], half, motion[i], motion[dynamic + i])


@kernel
def _economize(system, state, motion):
    """Add to the series of a motion over a cell what their next terms come to.

    The cell's forcing is longer than its flow's series resolve; of the terms that these lack, only the first matter.
    """
    coordinates, dynamic = system.sizes[0], system.sizes[1]
    half, rows = state.clock[HALF], system.acceleration[state.index[MODE]]
    now, following = state.work[3], state.work[4]
    for c in range(2 * dynamic):
        now[c] = motion[c, LENGTH - 1]
    for i in range(dynamic):
        now[2 * dynamic + i] = state.work[i, LENGTH - 1]  # the last term of the load
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


@kernel
def _compensated_sum(p):
    """Sum of the coefficients, rounded once (Neumaier): an error would be the same in every segment and add up."""
    result, lost = 0.0, 0.0
    for n in range(len(p)):
        increased = result + p[n]
        lost += (result - increased) + p[n] if abs(result) >= abs(p[n]) else (p[n] - increased) + result
        result = increased
    return result + lost


@kernel
def _keep_free_motion(system, state, flow, slot):
    """See to it that the library has the free motion of segments like this one."""
    library = state.library
    if library.half[flow, slot] == state.clock[HALF]:
        return
    library.half[flow, slot] = state.clock[HALF]
    library.version[flow, slot] = 0
    components = 2 * system.sizes[1]
    state.work[:] = 0.0
    for j in range(components):
        motion = library.free[flow, slot, j]
        motion[:] = 0.0
        motion[j, 0] = 1.0
        _solve(system, state, motion)
        if slot == state.index[CELL]:
            _economize(system, state, motion)
        for c in range(components):
            library.free_end[flow, slot, j, c] = _compensated_sum(motion[c])


@kernel
def _fill_loads(system, state):
    """Loads of the dynamic coordinates, as series in `work`."""
    for i in range(system.sizes[1]):
        mode = state.index[MODE]
        if not fill_form(system.acceleration[mode, i], system.terms[mode, i], state.z, state.work[i]):
            state.work[i, :] = 0.0


@kernel
def _component(system, c):
    """Channel of component c."""
    coordinates, dynamic = system.sizes[0], system.sizes[1]
    return c if c < dynamic else coordinates + c - dynamic


@kernel
def _find_forced_motion(system, state, flow, slot, point):
    """See to it that the library has forced motion over this segment."""
    library = state.library
    of_cell = slot == state.index[CELL]
    if of_cell and library.version[flow, slot] == state.index[VERSION]:
        return
    motion = library.forced[flow, slot]
    for c in range(len(motion)):
        # From the coordinates' present values, for rest to be found as rest, exactly; a cell's serves later, too.
        motion[c, 0] = 0.0 if of_cell else point[_component(system, c)]
    _fill_loads(system, state)
    _solve(system, state, motion)
    if of_cell:
        _economize(system, state, motion)
        library.version[flow, slot] = state.index[VERSION]
        for c in range(len(motion)):
            library.forced_start[flow, slot, c] = value(motion[c], -1.0)


@kernel
def _find_defect(system, state, motion, at_start, point):
    """Note what the forced motion lacks of the coordinates of `point` where the flow begins; whether it is anything."""
    entrance = state.clock[ENTRANCE]
    known = entrance == -1.0 and state.index[SLOT] == state.index[CELL]
    anything = False
    for c in range(len(motion)):
        found = at_start[c] if known else value(motion[c], entrance)
        defect = point[_component(system, c)] - found
        state.defect[0, c] = defect
        anything = anything or defect != 0.0
    return anything


@kernel
def _companions(system, state, c):
    """First and step of the components that component c has to do with: all if they are coupled, else its
    coordinate's position and velocity."""
    dynamic = system.sizes[1]
    if system.coupled[state.index[MODE]]:
        return 0, 1
    return (c if c < dynamic else c - dynamic), dynamic


@kernel
def _carry_to_middle(system, state, free, free_end):
    """The free motion whose value is the defect where the flow begins has this value in the middle."""
    entrance = state.clock[ENTRANCE]
    for c in range(len(free)):
        middle = 0.0
        first, step = _companions(system, state, c)
        for j in range(first, len(free), step):
            part = free_end[j, c] if entrance == -1.0 else value(free[j, c], -entrance)
            middle += part * state.defect[0, j]
        state.defect[1, c] = middle


@kernel
def _add_free_motion(system, state, free, c, forced, target):
    """target = forced + component c of the free motion."""
    first, step = _companions(system, state, c)
    motion = state.defect[1, first] * vector(free[first, c])
    for j in range(first + step, len(free), step):
        motion = motion + state.defect[1, j] * vector(free[j, c])
    store(target, vector(forced) + motion)


@kernel
def _pass_through(system, state, point):
    """Set the constant terms anew, by less than a rounding or two: carried to the middle and back, the values would be
    off by the same rounding in every segment of the kind."""
    powers_above_zero = with_first(powers(state.clock[ENTRANCE]), 0.0)
    for c in range(2 * system.sizes[1]):
        channel = _component(system, c)
        state.z[channel, 0] = point[channel] - total(vector(state.z[channel]) * powers_above_zero)


@kernel
def _rescale(state, channel, magnitude):
    """A segment starts with the rounding error of the one before, however small its own terms are.

    All of it where that one ended at its start: what was zero to rounding there, and led here, is zero here.
    """
    kept = 0.5 if state.index[STANDSTILLS] == 0 else 1.0
    state.scale[channel] = max(magnitude, kept * state.scale[channel])


@sum_kernel
def weighted_sum(row, scale):
    """Sum of |row| scale."""
    result = 0.0
    for channel in range(len(row)):
        result += abs(row[channel]) * scale[channel]
    return result


@kernel
def solve_dynamic(system, state, point):
    """Series of the dynamic coordinates that pass through `point` where the flow begins."""
    coordinates, dynamic = system.sizes[0], system.sizes[1]
    z, mode, slot, library = state.z, state.index[MODE], state.index[SLOT], state.library
    flow = system.flow[mode]
    _keep_free_motion(system, state, flow, slot)
    motion, free = library.forced[flow, slot], library.free[flow, slot]
    _find_forced_motion(system, state, flow, slot, point)
    incomplete = _find_defect(system, state, motion, library.forced_start[flow, slot], point)
    if incomplete:
        _carry_to_middle(system, state, free, library.free_end[flow, slot])
    for c in range(2 * dynamic):
        channel = _component(system, c)
        if incomplete:
            _add_free_motion(system, state, free, c, motion[c], z[channel])
        else:
            store(z[channel], vector(motion[c]))
        _rescale(state, channel, abs(z[channel, 0]) + abs(z[channel, 1]))
    if incomplete:
        _pass_through(system, state, point)
    for i in range(dynamic):
        differentiate(z[coordinates + i], state.clock[HALF], z[2 * coordinates + i])
        state.scale[2 * coordinates + i] = weighted_sum(system.acceleration[mode, i], state.scale)


@kernel
def solve_driven(system, state, point):
    """Series of the driven coordinates that pass through `point` where the mode begins."""
    coordinates, mode = system.sizes[0], state.index[MODE]
    z, half, acceleration, anchor = state.z, state.clock[HALF], state.work[0], state.clock[ANCHOR]
    for i in range(system.sizes[1], coordinates):
        row = system.acceleration[mode, i]
        rate = z[coordinates + i]
        if fill_form(row, system.terms[mode, i], z, acceleration):
            integrate_through(acceleration, half, anchor, point[coordinates + i], rate)
        else:
            rate[:] = 0.0
            rate[0] = point[coordinates + i]
        integrate_through(rate, half, anchor, point[i], z[i])
        duration = 2.0 * half
        state.scale[coordinates + i] = abs(point[coordinates + i]) + weighted_sum(row, state.scale) * duration
        state.scale[i] = abs(point[i]) + state.scale[coordinates + i] * duration
