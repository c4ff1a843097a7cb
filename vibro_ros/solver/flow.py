"""The flow of a mode: its exact solution over a segment, as power series about the segment's middle.

With polynomial forcing a linear equation determines the series of its solution term by term. The segments are short
enough for the series of the free motion to end at rounding (`System.longest_segment`). At a constant speed of the phase
a segment may be a whole cell of the signals: the few terms by which the forced motion is longer are economized.

The motion is a *forced* motion, under the segment's loads, plus the *free* motion, without loads, that makes the sum
pass through the point at which the flow starts. Any forced motion will do. The *components* of a motion are its
positions and then its velocities.

A free motion does not depend on the instant at which it begins. Over a segment of any duration, it is the middle part
of the free motion over the longest segment of its flow. So the free motions from a unit of each component are solved
once per flow, and kept in the `Library`.
"""

import math

from vibro_ros.solver.channels import first_acceleration
from vibro_ros.solver.polynomial import INVERSE, differentiate, economized_powers, fill_form, integrate_through, value
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import State
from vibro_ros.solver.system import System, sparse_magnitude
from vibro_ros.solver.typed import Row, Rows, Rows3, part
from vibro_ros.solver.vector import LENGTH, Vector, powers, store, total, vector, with_first


@part
def _compensated_sum(p: Row) -> float:
    """Sum of the coefficients, rounded once (Neumaier), because an error would recur in every segment and add up."""
    result, lost = 0.0, 0.0
    for n in range(len(p)):
        increased = result + p[n]
        lost += (result - increased) + p[n] if abs(result) >= abs(p[n]) else (p[n] - increased) + result
        result = increased
    return result + lost


@part
def _provide_free_motion(system: System, state: State, flow: int) -> None:
    library, segment = state.library, state.segment
    half = 0.5 * min(LONGEST_SEGMENT, system.longest_segment[state.automaton.mode])
    if library.half[flow] == half:
        return
    library.half[flow] = half
    components = 2 * system.counts[0].dynamic
    state.scratch.load[:] = 0.0
    present, segment.half = segment.half, half
    for j in range(components):
        motion = library.free[flow, j]
        motion[:] = 0.0
        motion[j, 0] = 1.0
        solve_series(system, state, motion)
        for c in range(components):
            library.free_end[flow, j, c] = _compensated_sum(motion[c])
    segment.half = present


@part
def fill_loads(system: System, state: State) -> None:
    """Fill the scratch with the loads of the dynamic coordinates."""
    mode, load = state.automaton.mode, state.scratch.load
    for i in range(system.counts[0].dynamic):
        if not fill_form(system.equations[mode, i], system.reads_forcing[mode, i], state.z, load[i]):
            load[i, :] = 0.0


@part
def _component(system: System, c: int) -> int:
    coordinates, dynamic = system.counts[0].coordinates, system.counts[0].dynamic
    return c if c < dynamic else coordinates + c - dynamic


@part
def _solve_forced_motion(system: System, state: State, motion: Rows, point: Row) -> None:
    """Fill `motion` with the motion under the segment's loads that has the components of `point` in the middle, so that
    a system at rest stays at rest exactly."""
    for c in range(len(motion)):
        motion[c, 0] = point[_component(system, c)]
    fill_loads(system, state)
    solve_series(system, state, motion)


@part
def _needs_free_motion(system: System, state: State, forced: Rows, point: Row) -> bool:
    """Store the difference between `point` and the forced motion at the segment's start; return whether it is not
    zero."""
    difference = state.scratch.free_at_start
    needed: bool = False
    for c in range(len(forced)):
        difference[c] = point[_component(system, c)] - value(forced[c], -1.0)
        needed = needed or difference[c] != 0.0
    return needed


@part
def _coupled_components(system: System, state: State, c: int) -> tuple[int, int]:
    """Return first index and step of the components on which component c depends: all, or only its coordinate's
    position and velocity if the coordinates are not coupled."""
    dynamic = system.counts[0].dynamic
    if system.coupled[state.automaton.mode]:
        return 0, 1
    return (c if c < dynamic else c - dynamic), dynamic


@part
def _free_motion(free: Rows3, c: int, first: int, step: int, middle: Row) -> Vector:
    """Return component c of the free motion that has the components `middle` in the middle, as a vector."""
    motion = middle[first] * vector(free[first, c])
    j = first + step
    while j < len(free):
        motion = motion + middle[j] * vector(free[j, c])
        j += step
    return motion


@part
def _carry_to_middle(system: System, state: State, free: Rows3, free_end: Rows, ratio: float) -> None:
    """Store the free motion's value in the segment's middle, from its value at the start.

    A unit at the start becomes by the middle what a unit in the middle becomes by the end, because the free motion's
    equations do not depend on time. `ratio` is the duration of the segment over that of the motions `free`.
    """
    at_start, at_middle, weights = state.scratch.free_at_start, state.scratch.free_at_middle, powers(ratio)
    for c in range(len(free)):
        first, step = _coupled_components(system, state, c)
        if ratio == 1.0:
            at_middle[c] = 0.0
            j = first
            while j < len(free):
                at_middle[c] += free_end[j, c] * at_start[j]
                j += step
        else:
            at_middle[c] = total(_free_motion(free, c, first, step, at_start) * weights)


@part
def _pass_through(system: System, state: State, point: Row) -> None:
    """Adjust the constant terms, by a rounding or two, so that the series pass through `point` at the start.

    Otherwise the way to the middle and back would add the same rounding error in every segment of this kind.
    """
    powers_above_zero = with_first(powers(-1.0), 0.0)
    for c in range(2 * system.counts[0].dynamic):
        channel = _component(system, c)
        state.z[channel, 0] = point[channel] - total(vector(state.z[channel]) * powers_above_zero)


@part
def _set_magnitudes(system: System, state: State, i: int, position: float, velocity: float, duration: float,
                    share: float) -> None:
    """Set the magnitudes of coordinate i, of its position and its velocity, from the magnitudes of their own terms.

    The rounding error of a force moves a coordinate that no spring of its own holds for the whole `duration` [s]. The
    coordinate's own damping is left out, because the magnitude would increase itself. The magnitude is at least `share`
    of that of the previous segment, however small the terms are.
    """
    mode = state.automaton.mode
    row, terms = system.equations[mode, i], system.reads_forcing[mode, i]
    rate = system.counts[0].coordinates + i
    if row[i] < 0.0:
        duration = min(duration, 1.0 / math.sqrt(-row[i]))
    velocity += sparse_magnitude(row, terms, state.magnitude) * duration
    position += velocity * duration
    state.magnitude[rate] = max(velocity, share * state.magnitude[rate])
    state.magnitude[i] = max(position, share * state.magnitude[i])


@part
def _share_that_stays(state: State) -> float:
    """Return the share of its magnitude that a dynamic coordinate keeps: all of it if the previous segment had zero
    length, because a number that was zero to rounding there is also zero here; else half."""
    return 0.5 if state.automaton.events_without_progress == 0 else 1.0


@part
def fill_accelerations(system: System, state: State) -> None:
    """Fill in series and magnitudes of the dynamic coordinates' accelerations, from their velocities."""
    coordinates, first = system.counts[0].coordinates, first_acceleration(system.counts[0])
    mode = state.automaton.mode
    for i in range(system.counts[0].dynamic):
        differentiate(state.z[coordinates + i], state.segment.half, state.z[first + i])
        state.magnitude[first + i] = sparse_magnitude(system.equations[mode, i], system.reads_all[mode, i],
                                                      state.magnitude)


@part
def solve_dynamic(system: System, state: State, point: Row) -> None:
    """Solve the series of the dynamic coordinates that pass through `point` at the segment's start."""
    z, library, flow = state.z, state.library, system.flow[state.automaton.mode]
    _provide_free_motion(system, state, flow)
    forced, free, ratio = library.forced, library.free[flow], state.segment.half / library.half[flow]
    _solve_forced_motion(system, state, forced, point)
    needs_free = _needs_free_motion(system, state, forced, point)
    if needs_free:
        _carry_to_middle(system, state, free, library.free_end[flow], ratio)
    for c in range(2 * system.counts[0].dynamic):
        channel = _component(system, c)
        if needs_free:
            # The middle part of the free motion over its longest segment.
            first, step = _coupled_components(system, state, c)
            motion = _free_motion(free, c, first, step, state.scratch.free_at_middle)
            store(z[channel], vector(forced[c]) + motion * powers(ratio))
        else:
            store(z[channel], vector(forced[c]))
    duration, share = 2.0 * state.segment.half, _share_that_stays(state)
    for i in range(system.counts[0].dynamic):
        rate = system.counts[0].coordinates + i
        _set_magnitudes(system, state, i, abs(z[i, 0]) + abs(z[i, 1]), abs(z[rate, 0]) + abs(z[rate, 1]),
                        duration, share)
    if needs_free:
        _pass_through(system, state, point)
    fill_accelerations(system, state)


@part
def hold_dynamic(system: System, state: State, held: Row) -> None:
    """Fill in the series of dynamic coordinates that stay at the positions in `held`.

    Their accelerations are zero without rounding error, although the terms of a stiff mode are large. Over a segment of
    a second, rounding errors of these terms would count as micrometres of a driven body's height, and the body would
    land above the ground.
    """
    coordinates, share = system.counts[0].coordinates, _share_that_stays(state)
    first = first_acceleration(system.counts[0])
    for i in range(system.counts[0].dynamic):
        state.z[i, :] = 0.0
        state.z[i, 0] = held[i]
        state.z[coordinates + i, :] = 0.0
        _set_magnitudes(system, state, i, abs(held[i]), 0.0, 0.0, share)  # a coordinate that is held does not drift
        state.z[first + i, :] = 0.0
        state.magnitude[first + i] = 0.0


@part
def solve_driven(system: System, state: State, point: Row) -> None:
    """Solve the series of the driven coordinates that pass through `point` at the mode's start."""
    coordinates, mode = system.counts[0].coordinates, state.automaton.mode
    z, segment = state.z, state.segment
    half, start = segment.half, segment.mode_start
    acceleration = state.scratch.acceleration
    for i in range(system.counts[0].dynamic, coordinates):
        row = system.equations[mode, i]
        rate = z[coordinates + i]
        if fill_form(row, system.reads_forcing[mode, i], z, acceleration):
            integrate_through(acceleration, half, start, point[coordinates + i], rate)
        else:
            rate[:] = 0.0
            rate[0] = point[coordinates + i]
        integrate_through(rate, half, start, point[i], z[i])
        _set_magnitudes(system, state, i, abs(point[i]), abs(point[coordinates + i]), 2.0 * half, 0.0)


# The last terms of the loads over a whole cell, 0.45^LENGTH (`system.CELL_STRIDE`), are above rounding. Therefore terms
# beyond a motion's length are economized, until they are negligible beside the first terms.
_BEYOND = economized_powers(LENGTH, 8)
_NEGLIGIBLE = 1e-18


@part
def _solve_oscillators(load: Rows, rows: Rows, half: float, coordinates: int, i: int, j: int, motion: Rows) -> None:
    """Solve the series of coordinates i and j, which are not coupled, from their constant terms.

    Each obeys q'' = load + stiffness q + damping v. Two are solved at a time, because each operation on one waits for
    the one before it; the last of an odd number is solved twice.
    """
    dynamic = len(motion) // 2
    stiffness, damping = rows[i, i], rows[i, coordinates + i]
    stiffness_j, damping_j = rows[j, j], rows[j, coordinates + j]
    position, velocity = motion[i, 0], motion[dynamic + i, 0]
    position_j, velocity_j = motion[j, 0], motion[dynamic + j, 0]
    for n in range(LENGTH - 1):
        step = half * INVERSE[n]
        acceleration = load[i, n] + stiffness * position + damping * velocity
        acceleration_j = load[j, n] + stiffness_j * position_j + damping_j * velocity_j
        position, position_j = velocity * step, velocity_j * step
        velocity, velocity_j = acceleration * step, acceleration_j * step
        motion[i, n + 1], motion[j, n + 1] = position, position_j
        motion[dynamic + i, n + 1], motion[dynamic + j, n + 1] = velocity, velocity_j


@part
def _economize_oscillator(load: float, stiffness: float, damping: float, half: float, q: Row, v: Row) -> None:
    """Add the terms beyond the length, economized, to the series of q and v; `load` is the last term of the load."""
    position, velocity, positions, velocities = q[LENGTH - 1], v[LENGTH - 1], vector(q), vector(v)
    least_position, least_velocity = _NEGLIGIBLE * (abs(q[0]) + abs(q[1])), _NEGLIGIBLE * (abs(v[0]) + abs(v[1]))
    for k in range(len(_BEYOND)):
        step = half / (LENGTH + k)
        acceleration = load + stiffness * position + damping * velocity
        position = velocity * step
        velocity = acceleration * step
        positions = positions + position * vector(_BEYOND[k])
        velocities = velocities + velocity * vector(_BEYOND[k])
        if abs(position) <= least_position and abs(velocity) <= least_velocity:
            break
        load = 0.0
    store(q, positions)
    store(v, velocities)


@part
def _economize_coupled(loads: Rows, row: Rows, half: float, coordinates: int, dynamic: int, terms: Rows,
                       motion: Rows) -> None:
    """Add the terms beyond the length, economized, to the series of coupled coordinates; `terms` is overwritten."""
    for c in range(2 * dynamic):
        terms[0, c] = motion[c, LENGTH - 1]
    for k in range(len(_BEYOND)):
        present, following, step = terms[k % 2], terms[1 - k % 2], half / (LENGTH + k)
        for i in range(dynamic):
            acceleration = loads[i, LENGTH - 1] if k == 0 else 0.0
            for j in range(dynamic):
                acceleration += row[i, j] * present[j] + row[i, coordinates + j] * present[dynamic + j]
            following[i] = present[dynamic + i] * step
            following[dynamic + i] = acceleration * step
        ends: bool = True
        for c in range(2 * dynamic):
            ends = ends and abs(following[c]) <= _NEGLIGIBLE * (abs(motion[c, 0]) + abs(motion[c, 1]))
            store(motion[c], vector(motion[c]) + following[c] * vector(_BEYOND[k]))
        if ends:
            return


@part
def _solve_coupled(loads: Rows, row: Rows, half: float, coordinates: int, dynamic: int, terms: Rows,
                   motion: Rows) -> None:
    """Solve the series of coupled coordinates; `loads` has a row for each coordinate, `motion` two. `terms` is
    overwritten."""
    for n in range(LENGTH - 1):
        step = half * INVERSE[n]
        for i in range(dynamic):
            acceleration = loads[i, n]
            for j in range(dynamic):
                acceleration += row[i, j] * motion[j, n] + row[i, coordinates + j] * motion[dynamic + j, n]
            motion[dynamic + i, n + 1] = acceleration * step
        for i in range(dynamic):
            motion[i, n + 1] = motion[dynamic + i, n] * step
    _economize_coupled(loads, row, half, coordinates, dynamic, terms, motion)


@part
def _solve_pair(loads: Rows, row: Rows, half: float, coordinates: int, terms: Rows, motion: Rows) -> None:
    """`_solve_coupled` for two coordinates, which most machines have; their terms stay in the processor's registers."""
    first, second, first_rate, second_rate = motion[0, 0], motion[1, 0], motion[2, 0], motion[3, 0]
    for n in range(LENGTH - 1):
        step = half * INVERSE[n]
        of_first = loads[0, n] + (row[0, 0] * first + row[0, coordinates] * first_rate)
        of_second = loads[1, n] + (row[1, 0] * first + row[1, coordinates] * first_rate)
        of_first += row[0, 1] * second + row[0, coordinates + 1] * second_rate
        of_second += row[1, 1] * second + row[1, coordinates + 1] * second_rate
        first, second = first_rate * step, second_rate * step
        first_rate, second_rate = of_first * step, of_second * step
        motion[0, n + 1], motion[1, n + 1] = first, second
        motion[2, n + 1], motion[3, n + 1] = first_rate, second_rate
    _economize_coupled(loads, row, half, coordinates, 2, terms, motion)


@part
def solve_series(system: System, state: State, motion: Rows) -> None:
    """Solve the series of a motion's components from their constant terms, under the loads in the scratch."""
    coordinates, dynamic = system.counts[0].coordinates, system.counts[0].dynamic
    mode, half, load = state.automaton.mode, state.segment.half, state.scratch.load
    rows = system.equations[mode]
    if system.coupled[mode] and dynamic == 2:
        _solve_pair(load, rows, half, coordinates, state.scratch.terms, motion)
        return
    if system.coupled[mode]:
        _solve_coupled(load, rows, half, coordinates, dynamic, state.scratch.terms, motion)
        return
    for i in range(0, dynamic, 2):
        _solve_oscillators(load, rows, half, coordinates, i, min(i + 1, dynamic - 1), motion)
    for i in range(dynamic):
        _economize_oscillator(load[i, LENGTH - 1], rows[i, i], rows[i, coordinates + i], half, motion[i],
                              motion[dynamic + i])
