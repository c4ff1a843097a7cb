"""Methods of fixed step, with which the event loop is compared; they see events only at the ends of steps.

The grid starts at time 0 and again at every command, so that the trajectory does not depend on the sampled instants.
A step is taken in the mode of its start. At its end the guards are evaluated, and the mode changes there, by
the same candidates and jumps as in the event loop: an event is up to a step late, and a pair of crossings within
one step goes unseen. `RK4_LOCATED` shortens such a step to the event, and a new grid starts there. Between a step's
ends samples are interpolated by cubic Hermite polynomials of the positions and of the velocities.
"""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.channels import channels_of
from vibro_ros.solver.event_loop import DIVERGED, EVENTS_FULL, REACHED, is_finite
from vibro_ros.solver.events import choose_candidate, jump, record_mode_change, record_reached
from vibro_ros.solver.guards import guard_value
from vibro_ros.solver.right_hand_side import accelerate, advance_values, fill_forcing_at, phase_after
from vibro_ros.solver.rotor import enter_rotor, read_phase
from vibro_ros.solver.segment import advance_clock, local_time
from vibro_ros.solver.state import State
from vibro_ros.solver.system import NOTHING, System, form_value
from vibro_ros.solver.typed import Indices, Row, Rows, entry, part

#: Schemes.
RK4 = 0
RK4_LOCATED = 1


class Step(NamedTuple):
    """State of a method of fixed step beside `State`, whose segment is the step.

    Attributes
    ----------
    scheme : ndarray of int, shape (1,)
        Scheme of the steps, `RK4` or `RK4_LOCATED`.
    length : ndarray, shape (1,)
        Length of a step [s].
    start, end : ndarray, shape (channels,)
        All channels at both ends of the present step, in the mode in which the step is taken.
    start_acceleration, end_acceleration : ndarray, shape (coordinates,)
        The coordinates' accelerations there.
    stage : ndarray, shape (channels,)
        Room for the channels at a stage within the step.
    stage_acceleration : ndarray, shape (coordinates,)
        Room for the accelerations at a stage.
    velocity_sum, acceleration_sum : ndarray, shape (coordinates,)
        Weighted sums over the stages.
    located : ndarray of int, shape (1,)
        Number of steps in a row that have ended at events.
    """

    scheme: Indices
    length: Row
    start: Row
    end: Row
    start_acceleration: Row
    end_acceleration: Row
    stage: Row
    stage_acceleration: Row
    velocity_sum: Row
    acceleration_sum: Row
    located: Indices


# Most changes of mode at the end of one step; then the next step is taken whatever the guards say.
_MOST_CHANGES = 8
# Halvings of a step that locate an event, to 1e-12 of the step; and most steps in a row that end at events, after which
# a whole step is taken whatever the guards say, because there can be infinitely many bounces.
_HALVINGS, _MOST_LOCATED = 40, 16
# A mass rests on its stop if it arrives no faster than this many steps accelerate it, because bounces that are shorter
# than a step would never end.
_STEPS_TO_REST = 2.0


@part
def _broken_guard(system: System, state: State, z: Row) -> int:
    """Return the mode's first guard that is negative by more than its rounding error, or `NOTHING`."""
    magnitude = state.scratch.magnitude
    for channel in range(len(z)):
        magnitude[channel] = abs(z[channel])
    for g in range(system.guards.row.shape[1]):
        row = system.guards.row[state.automaton.mode, g]
        if row == NOTHING:
            break
        total, noise = guard_value(system, row, z, magnitude)
        if total < -noise:
            return g
    return NOTHING


@part
def _resting_candidate(system: System, state: State, step: Step) -> int:
    """Return the candidate of a blow without rebound if steps cannot resolve the bounce, else `NOTHING`."""
    mode, guard = state.automaton.mode, state.automaton.guard
    struck, coordinates, z = system.guards.blow_monitor[mode, guard], system.counts[0].coordinates, step.start
    if struck == NOTHING:
        return NOTHING
    change = 0.0
    for i in range(system.counts[0].dynamic):
        change += system.monitors.approach[struck, coordinates + i] * step.start_acceleration[i]
    if form_value(system.monitors.approach[struck], z) > _STEPS_TO_REST * step.length[0] * abs(change):
        return NOTHING
    for c in range(system.guards.candidate.shape[2]):
        target = system.guards.candidate[mode, guard, c]
        if target != NOTHING and system.monitors.active[target, struck]:
            return c
    return NOTHING


@part
def _change_modes(system: System, state: State, step: Step, events: Rows, count: int) -> int:
    """Enter the mode whose guards hold at the step's start; return the number of events."""
    z, automaton, after = step.start, state.automaton, state.scratch.after
    for _ in range(_MOST_CHANGES):
        guard = _broken_guard(system, state, z)
        automaton.guard = guard
        if guard == NOTHING:
            break
        candidate = _resting_candidate(system, state, step)
        if candidate == NOTHING:
            candidate = choose_candidate(system, state, z, after)
        else:
            candidate = jump(system, state, candidate, z, after)
        mode = system.guards.candidate[automaton.mode, guard, candidate]
        count = record_mode_change(system, state, mode, z, events, count)
        for channel in range(2 * system.counts[0].coordinates):
            z[channel] = after[channel]
        automaton.mode = mode
        accelerate(system, state, mode, z, step.start_acceleration)
    return count


@part
def _pass_step(system: System, state: State, step: Step, events: Rows, count: int) -> int:
    mode, duration = state.automaton.mode, 2.0 * state.segment.half
    reached = advance_values(system, state, duration)
    advance_clock(state, duration)
    count = record_reached(system, state, reached, step.start, events, count)
    for channel in range(len(step.start)):
        step.start[channel] = step.end[channel]
    if state.automaton.mode == mode:
        for i in range(system.counts[0].coordinates):
            step.start_acceleration[i] = step.end_acceleration[i]
    else:
        mode = state.automaton.mode
        accelerate(system, state, mode, step.start, step.start_acceleration)
    for k in range(len(state.monitor)):
        if system.monitors.active[mode, k]:
            quantity = form_value(system.monitors.quantity[mode, k], step.start)
            state.monitor[k].peak = max(state.monitor[k].peak, quantity)
    if system.counts[0].rotors > 0:
        enter_rotor(system, state, step.start)
        fill_forcing_at(system, state, 0.0, step.start)
        accelerate(system, state, mode, step.start, step.start_acceleration)
    count = _change_modes(system, state, step, events, count)
    _finish_step(system, state, step)
    return count


@part
def _finish_step(system: System, state: State, step: Step) -> None:
    state.segment.half = 0.5 * step.length[0]
    take_step(system, state, step)
    if step.scheme[0] == RK4_LOCATED:
        _end_at_event(system, state, step)
    accelerate(system, state, state.automaton.mode, step.end, step.end_acceleration)
    state.automaton.segments += 1


@part
def _end_at_event(system: System, state: State, step: Step) -> None:
    """Shorten the step, by bisection, to the first instant at which a guard of its mode is negative."""
    in_row = step.located[0]
    if _broken_guard(system, state, step.end) == NOTHING or not 0 <= in_row < _MOST_LOCATED:
        step.located[0] = 0
        return
    step.located[0] = in_row + 1
    segment, before, after = state.segment, 0.0, 0.5 * step.length[0]
    for _ in range(_HALVINGS):
        segment.half = 0.5 * (before + after)
        take_step(system, state, step)
        if _broken_guard(system, state, step.end) == NOTHING:
            before = segment.half
        else:
            after = segment.half
    segment.half = after
    take_step(system, state, step)


@entry
def begin(system: System, state: State, step: Step, point: Row) -> None:
    """Begin the grid now, with the positions and velocities of `point`, shape (channels,)."""
    state.segment.half = 0.5 * step.length[0]
    state.segment.next_event = -1.0  # events are recorded at a step's start
    for channel in range(2 * system.counts[0].coordinates):
        step.start[channel] = point[channel]
    if system.counts[0].rotors > 0:
        enter_rotor(system, state, step.start)
    fill_forcing_at(system, state, 0.0, step.start)
    accelerate(system, state, state.automaton.mode, step.start, step.start_acceleration)
    _finish_step(system, state, step)


@part
def _interpolate(step: Step, length: float, coordinates: int, s: float, z: Row) -> None:
    """Interpolate positions and velocities at the fraction s, from 0 to 1, of the step of `length` [s]."""
    start, end, h = step.start, step.end, length
    rise = s * s * (3.0 - 2.0 * s)
    first, last = s * (1.0 - s) * (1.0 - s) * h, s * s * (s - 1.0) * h
    for i in range(coordinates):
        v = coordinates + i
        z[i] = start[i] + rise * (end[i] - start[i])
        z[v] = start[v] + rise * (end[v] - start[v])
        z[i] += first * start[v] + last * end[v]
        z[v] += first * step.start_acceleration[i] + last * step.end_acceleration[i]


@part
def _read(system: System, state: State, step: Step, x: float, z: Row) -> None:
    if x <= -1.0:
        for channel in range(len(z)):
            z[channel] = step.start[channel]
        return
    for channel in range(len(z)):
        z[channel] = 0.0  # even a channel that is multiplied by zero must not be NaN
    _interpolate(step, 2.0 * state.segment.half, system.counts[0].coordinates, 0.5 * (x + 1.0), z)
    fill_forcing_at(system, state, state.segment.half * (x + 1.0), z)
    accelerate(system, state, state.automaton.mode, z, step.stage_acceleration)


@entry
def advance(system: System, state: State, step: Step, times: Row, points: Rows, modes: Indices, phases: Rows,
            events: Rows) -> tuple[int, int, int]:
    """Take all steps up to the last of `times` and sample at each of them; arguments as in `event_loop.advance`."""
    count = 0
    # Most records of a step: for each change of mode a blow, itself and every monitor; then ramps and the speed.
    room = len(events) - (_MOST_CHANGES + 1) * (2 + len(state.monitor)) - 2 * len(state.ramp)
    for k in range(len(times)):
        while local_time(state, times[k]) >= 1.0:
            if count > room:
                return EVENTS_FULL, k, count
            count = _pass_step(system, state, step, events, count)
            if not is_finite(step.end):
                return DIVERGED, k, count
        x = local_time(state, times[k])
        _read(system, state, step, x, points[k])
        modes[k] = state.automaton.mode
        phase, speed = phase_after(system, state, max(0.0, state.segment.half * (x + 1.0)))
        if system.counts[0].rotors > 0:
            phase, speed = read_phase(system, points[k])
        phases[k, 0], phases[k, 1], phases[k, 2] = state.drive.turns, phase, speed
    return REACHED, len(times), count


@entry
def interrupt(system: System, state: State, step: Step, time: float, point: Row) -> None:
    """Move clock and forcing to `time`, within the present step, and read all channels there into `point`, as
    `event_loop.interrupt` does; the caller must then call `begin`."""
    segment = state.segment
    x = local_time(state, time)
    _read(system, state, step, x, point)
    advance_values(system, state, max(0.0, segment.half * (x + 1.0)))
    segment.start, segment.residue = time, 0.0



def new_step(system: System, scheme: int, length: float) -> Step:
    """Return an empty `Step` for steps of `length` [s] by `scheme`."""
    channels = channels_of(system.counts)
    count, coordinates = channels.count, channels.coordinates
    start, end, stage = np.zeros((3, count))
    start_acceleration, end_acceleration, stage_acceleration, velocity_sum, acceleration_sum = np.zeros((
        5, coordinates))
    return Step(np.array([scheme]), np.array([length]), start, end, start_acceleration, end_acceleration, stage,
                stage_acceleration, velocity_sum, acceleration_sum, np.zeros(1, np.int64))


@part
def take_step(system: System, state: State, step: Step) -> None:
    """Fill `Step.end` by the classical Runge-Kutta method of fourth order, for q' = v and v' = a at once."""
    coordinates, mode = system.counts[0].coordinates, state.automaton.mode
    h = 2.0 * state.segment.half
    start, end, stage, rate = step.start, step.end, step.stage, step.stage_acceleration
    speeds, accelerations = step.velocity_sum, step.acceleration_sum
    for i in range(coordinates):
        speeds[i] = start[coordinates + i]
        accelerations[i] = step.start_acceleration[i]
        rate[i] = step.start_acceleration[i]
        stage[coordinates + i] = start[coordinates + i]
    for k in range(1, 4):
        duration = h if k == 3 else 0.5 * h
        weight = 1.0 if k == 3 else 2.0
        for i in range(coordinates):
            stage[i] = start[i] + duration * stage[coordinates + i]
            stage[coordinates + i] = start[coordinates + i] + duration * rate[i]
        if k != 2:  # the second half step is at the instant of the first
            fill_forcing_at(system, state, duration, stage)
        accelerate(system, state, mode, stage, rate)
        for i in range(coordinates):
            speeds[i] += weight * stage[coordinates + i]
            accelerations[i] += weight * rate[i]
    for channel in range(len(end)):
        end[channel] = stage[channel]  # the forcing at the end
    for i in range(coordinates):
        end[i] = start[i] + h / 6.0 * speeds[i]
        end[coordinates + i] = start[coordinates + i] + h / 6.0 * accelerations[i]
