"""Flows that are not linear: their Taylor series about a segment's start, term by term.

Two things make a flow nonlinear: a phase that is a coordinate, with the torque on it (`rotor`), and a decaying term

    d = f e,        e = exp(r v),

where v is the velocity of a coordinate, f a linear form of the channels, and r is constant in a mode (`system.Decay`).

Coefficient n + 1 of every position and velocity follows from coefficient n of all channels, which follows from the
coefficients up to n of positions and velocities. Products, quotients, roots and exponentials of series have
recurrences with one product of series each, such as e' = r v' e (R. E. Moore, Interval Analysis, 1966, ch. 11).

Two channels may enter their own equations: the phase's acceleration, if the signals' second derivatives enter
the equations, and d, if f reads channels that d changes. Both enter linearly, and by the same factors for every n, so
that two linear equations give their coefficients.

A segment lasts as long as the last coefficients of the velocities are rounding. Its series in y = 0 ... 1 become
polynomials in the local time x = 2 y - 1, as in every other segment, so that guards, events, accounts and dense output
are computed alike. If e has decayed to less than rounding, the flow goes on without d until e matters again.
"""

import math

import numpy as np

from vibro_ros.solver.channels import first_acceleration, first_ramp, first_signal
from vibro_ros.solver.drive import resolved_time
from vibro_ros.solver.elementary import exp, log
from vibro_ros.solver.guards import NO_ROOT, NOISE, first_root
from vibro_ros.solver.polynomial import differentiate, recentre, scale_argument
from vibro_ros.solver.rotor import (
    SERIES_OF_ROTOR,
    begin_signals,
    enter_rotor,
    longest_rotor_segment,
    product_coefficient,
    read_phase,
    slope_row,
    turn_signals,
)
from vibro_ros.solver.segment import choose_segment, fill_forcing
from vibro_ros.solver.state import MOST_DYNAMIC, State
from vibro_ros.solver.system import NOTHING, System, sparse_magnitude
from vibro_ros.solver.typed import Indices, Row, Rows, entry, part
from vibro_ros.solver.vector import LENGTH, as_column, store, vector

# Largest last coefficient of a velocity, relative to its first ones; the omitted ones fall by `_FALL` each, so that
# their sum is a quarter of it.
_LAST, _FALL = 4e-16, 0.2
# Phase [rad] of a rotor's trial segment; its series shows how long the segment may be, at most `_LONGER` trials.
_TRIAL, _LONGER = 0.5, 4.0
# The ratio of a segment to its trial is found by at most this many refinements, until one changes it by little.
_MOST_REFINEMENTS, _SETTLED = 20, 0.99
# A trial that is too long by more than this factor is repeated, shorter by it, because coefficients may overflow.
_SHORTER, _MOST_TRIALS = 1e-8, 4
# Rate [rad/s] above which a run ends: the phase diverges in a finite time, in ever shorter segments.
_RUNAWAY = 1e9
# Smaller coefficients, as of a current that has died away, are ignored, because their products would underflow.
_VANISHING = 1e-250
# Where -r v exceeds this, e has decayed to 4e-18 and may be left out ...
_OVER = 40.0
# ... but is left out only above this, so that e does not matter again at once. A segment without e ends before e
# matters again, by more than rounding.
_WELL_OVER, _BEFORE = 44.0, 1.0 - 1e-6
# Row n: coefficients of ((1 + x) / 2)^n.
_FROM_START = np.array([[math.ldexp(math.comb(n, k), -n) for k in range(LENGTH)] for n in range(LENGTH)])
# Rows of the scratch's series, after those of `rotor`: e and f.
_EXPONENTIAL, _FACTOR = SERIES_OF_ROTOR, SERIES_OF_ROTOR + 1
# Rows of the responses of other channels to a unit of the phase's acceleration, and of d; the loads of the signals come
# after the accelerations of the coordinates.
_OF_PHASE, _OF_TERM, _LOADS = SERIES_OF_ROTOR + 2, SERIES_OF_ROTOR + 3, MOST_DYNAMIC


@part
def _row_at(row: Row, terms: Indices, z: Rows, n: int) -> float:
    """Return coefficient n of a form."""
    result = 0.0
    for channel in terms:
        if channel == NOTHING:
            break
        result += row[channel] * z[channel, n]
    return result


@part
def decays(system: System, mode: int) -> bool:
    """Whether the mode has a decaying term."""
    return len(system.decay.rate) > 0 and system.decay.rate[mode] != 0.0


@part
def _has_faded(system: System, mode: int, speed: float) -> bool:
    """Whether the mode's decaying term may be left out at this velocity of its coordinate."""
    return -system.decay.rate[mode] * speed > _WELL_OVER


@part
def is_linear(system: System, mode: int, point: Row) -> bool:
    """Whether the flow that begins at `point` is linear."""
    if system.counts[0].rotors > 0:
        return False
    return not decays(system, mode) or _has_faded(
        system, mode, point[system.counts[0].coordinates + system.decay.coordinate[0]])


@part
def _respond(system: System, mode: int, series: Rows, of_phase: bool, has_term: bool,
             response: Row) -> tuple[float, float]:
    """Store the response of the other accelerations and the signals' loads to a unit of the phase's acceleration
    (`of_phase`), or of d; return the response of the torque and of f."""
    counts, torque, factor = system.counts[0], 0.0, 0.0
    first, of_signals = first_acceleration(counts), first_signal(counts) + 2 * counts.signals
    masses, decay = counts.dynamic - 2 * counts.rotors, system.guards.form.shape[1] - 2
    shaken = counts.signals if of_phase and counts.signal_accelerations > 0 else 0
    for i in range(masses):
        response[i] = 0.0 if of_phase else system.equations[mode, i, decay]
        for k in range(shaken):
            response[i] += system.equations[mode, i, of_signals + k] * series[slope_row(k), 0]
        if has_term:
            factor += system.decay.factor[mode, first + i] * response[i]
    for k in range(shaken):
        if has_term:
            factor += system.decay.factor[mode, of_signals + k] * series[slope_row(k), 0]
    if counts.rotors > 0:
        for k in range(counts.signals):
            load = 0.0 if of_phase else system.rotor.load[mode, k, decay]
            for j in range(shaken):
                load += system.rotor.load[mode, k, of_signals + j] * series[slope_row(j), 0]
            for i in range(masses):
                load += system.rotor.load[mode, k, first + i] * response[i]
            response[_LOADS + k] = load
            torque += load * series[slope_row(k), 0]
    return torque, factor


@part
def _fill_accelerations(system: System, mode: int, z: Rows, n: int, series: Rows, mirrored: Rows, loads: Rows,
                        has_term: bool, of_phase: tuple[float, float], of_term: tuple[float, float]) -> None:
    """Fill in coefficient n of the accelerations of masses and phase, of d, of the torque, and of the signals' loads.

    `of_phase` and `of_term` are the responses of the torque and of f to a unit of the phase's acceleration, and of d.
    """
    counts, e, f = system.counts[0], series[_EXPONENTIAL], series[_FACTOR]
    phase, first, torque = counts.dynamic - 2, first_acceleration(counts), first_ramp(counts) + 2 * counts.ramps
    masses, decay, pull, change, term = counts.dynamic - 2 * counts.rotors, len(z) - 2, 0.0, 0.0, 0.0
    # First without coefficient n of the phase's acceleration, and with d without coefficient n of f.
    if counts.decays > 0:
        z[decay, n] = 0.0
        if has_term:
            for j in range(n):
                z[decay, n] += f[j] * e[n - j]
    for i in range(masses):
        z[first + i, n] = _row_at(system.equations[mode, i], system.reads_all[mode, i], z, n)
    if counts.rotors > 0:
        z[torque, n] = 0.0
        for k in range(counts.signals):
            known = product_coefficient(loads[k], mirrored[slope_row(k)], n)  # without coefficient n of the load
            load = _row_at(system.rotor.load[mode, k], system.rotor.load_terms[mode, k], z, n)
            loads[k, n] = load
            z[torque, n] += known + load * series[slope_row(k), 0]
        row = system.equations[mode, phase]
        change, pull = _row_at(row, system.reads_all[mode, phase], z, n), row[torque]
    # Then the two equations change = ... + pull T and term = e[0] f[n] are solved together.
    phase_by_phase = 1.0 - pull * of_phase[0]
    if has_term:
        f[n] = _row_at(system.decay.factor[mode], system.decay.terms[mode], z, n)
        phase_by_term, term_by_phase, term_by_term = pull * of_term[0], e[0] * of_phase[1], 1.0 - e[0] * of_term[1]
        determinant, known = phase_by_phase * term_by_term - phase_by_term * term_by_phase, e[0] * f[n]
        change, term = ((change * term_by_term + phase_by_term * known) / determinant,
                        (phase_by_phase * known + term_by_phase * change) / determinant)
        f[n] += of_phase[1] * change + of_term[1] * term
        z[decay, n] += term
        for i in range(masses):
            z[first + i, n] += series[_OF_TERM, i] * term
        if counts.rotors > 0:
            z[torque, n] += of_term[0] * term
            for k in range(counts.signals):
                loads[k, n] += series[_OF_TERM, _LOADS + k] * term
    elif counts.signal_accelerations > 0:
        change /= phase_by_phase
    if counts.rotors > 0:
        if counts.signal_accelerations > 0:
            for i in range(masses):
                z[first + i, n] += series[_OF_PHASE, i] * change
            for k in range(counts.signals):
                z[first_signal(counts) + 2 * counts.signals + k, n] += series[slope_row(k), 0] * change
                loads[k, n] += series[_OF_PHASE, _LOADS + k] * change
            z[torque, n] += of_phase[0] * change
        z[first + phase, n] = change


@part
def fill_series(system: System, state: State, mode: int, duration: float, orders: int, z: Rows) -> None:
    """Fill in the coefficients of all channels except driven coordinates, in y = 0 ... 1 over `duration` [s].

    Parameters
    ----------
    mode : int
        The mode whose equations hold.
    duration : float
        Time [s] from y = 0 to 1.
    orders : int
        Number of coefficients.
    z : ndarray, shape (channels, orders or more)
        Given: the constant terms of positions and velocities, and all coefficients of channels known in time.
    """
    counts, scratch = system.counts[0], state.scratch
    series, mirrored, loads = scratch.series, scratch.mirrored, scratch.load
    coordinates, first, charge, body = counts.coordinates, first_acceleration(counts), counts.dynamic - 1, 0
    has_term: bool = False
    of_phase: tuple[float, float] = (0.0, 0.0)
    of_term: tuple[float, float] = (0.0, 0.0)
    if counts.rotors > 0:
        series[:] = 0.0
        mirrored[:] = 0.0
        loads[:] = 0.0
    if decays(system, mode):
        body = system.decay.coordinate[0]
        has_term = not _has_faded(system, mode, z[coordinates + body, 0])
        # A speed beyond zero is rounding, or a step of fixed length that has passed the stop.
        series[_EXPONENTIAL, 0] = exp(min(system.decay.rate[mode] * z[coordinates + body, 0], 0.0))
    if counts.rotors > 0:
        begin_signals(system, z, series, mirrored)
        of_phase = _respond(system, mode, series, True, has_term, series[_OF_PHASE])
    if has_term:
        of_term = _respond(system, mode, series, False, True, series[_OF_TERM])
    for n in range(orders):
        step = duration / (n + 1)
        if counts.rotors > 0:
            turn_signals(system, z, n, step, series, mirrored)
            if system.rotor.algebraic[mode]:
                z[coordinates + charge, n] = _row_at(system.rotor.current[mode], system.rotor.current_terms[mode], z, n)
        _fill_accelerations(system, mode, z, n, series, mirrored, loads, has_term, of_phase, of_term)
        if counts.rotors > 0:
            z[first + charge, n] = _row_at(system.equations[mode, charge], system.reads_all[mode, charge], z, n)
        if n + 1 == orders:
            return
        for i in range(counts.dynamic):
            z[i, n + 1] = step * z[coordinates + i, n]
            z[coordinates + i, n + 1] = step * z[first + i, n]
        if has_term:
            if body >= counts.dynamic:
                z[body, n + 1] = step * z[coordinates + body, n]
                z[coordinates + body, n + 1] = step * _row_at(
                    system.equations[mode, body], system.reads_all[mode, body], z, n)
            growth = 0.0
            for j in range(n + 1):
                growth += (j + 1) * z[coordinates + body, j + 1] * series[_EXPONENTIAL, n - j]
            series[_EXPONENTIAL, n + 1] = system.decay.rate[mode] * growth / (n + 1)


@part
def _resolved_part(p: Row) -> float:
    """Return the multiple of y = 0 ... 1 that a series may span, so that its last coefficients are rounding."""
    ratio, before = _LONGER, 0.0
    for _ in range(_MOST_REFINEMENTS):
        size, power = 0.0, 1.0
        for n in range(LENGTH // 2):
            size += abs(p[n]) * power
            power *= ratio
        before = ratio
        last, last_but_one = abs(p[LENGTH - 1]), abs(p[LENGTH - 2])
        if last > _VANISHING:
            ratio = min(ratio, exp(log(_LAST * size / last) / (LENGTH - 1)))
        if last_but_one > _VANISHING:
            ratio = min(ratio, exp(log(_LAST / _FALL * size / last_but_one) / (LENGTH - 2)))
        if ratio >= _SETTLED * before:
            break
    return ratio


@part
def _to_local_time(z: Rows, ratio: float) -> None:
    """Turn the coefficients in y = 0 ... 1 over a trial into those in x = -1 ... 1 over the part `ratio` of it."""
    for channel in range(len(z)):
        p = z[channel]
        scaled = p[0] * vector(_FROM_START[0])
        power = ratio
        for n in range(1, LENGTH):
            scaled = scaled + (p[n] * power) * vector(_FROM_START[n])
            power *= ratio
        store(p, scaled)


@part
def _set_magnitudes(system: System, state: State) -> None:
    """Set the magnitudes of the terms that make up each channel, from which guards take their rounding error."""
    counts, z, magnitude, mode = system.counts[0], state.z, state.magnitude, state.automaton.mode
    first, torque = first_acceleration(counts), first_ramp(counts) + 2 * counts.ramps
    coordinates, masses = counts.coordinates, counts.dynamic - 2 * counts.rotors
    known = first_signal(counts) if counts.rotors > 0 else len(z)  # without a rotor, the forcing has its magnitudes
    for channel in range(len(z)):
        if channel < counts.dynamic or coordinates <= channel < coordinates + counts.dynamic or known <= channel:
            magnitude[channel] = abs(z[channel, 0]) + abs(z[channel, 1])
    if counts.rotors > 0 and counts.signal_accelerations > 0:  # differences of larger terms
        rate = magnitude[coordinates + counts.dynamic - 2]
        for k in range(counts.signals):
            magnitude[first_signal(counts) + 2 * counts.signals + k] += system.rotor.signal[k, 0] * rate * rate
    if counts.decays > 0:
        magnitude[len(z) - 2] = 0.0
        if decays(system, mode):  # f may read channels that d changes; e is 1 at most
            for i in range(masses):
                magnitude[first + i] = sparse_magnitude(system.equations[mode, i], system.reads_all[mode, i], magnitude)
            magnitude[len(z) - 2] = sparse_magnitude(system.decay.factor[mode], system.decay.terms[mode], magnitude)
    for i in range(masses):
        magnitude[first + i] = sparse_magnitude(system.equations[mode, i], system.reads_all[mode, i], magnitude)
    if counts.rotors > 0:
        for k in range(counts.signals):
            a, b = system.rotor.signal[k, 0], system.rotor.signal[k, 3]
            slope = a * (1.0 + a / math.sqrt(b)) if b > 0.0 else a  # the largest
            load = sparse_magnitude(system.rotor.load[mode, k], system.rotor.load_terms[mode, k], magnitude)
            magnitude[torque] += slope * load
        for i in range(masses, counts.dynamic):
            magnitude[first + i] = sparse_magnitude(system.equations[mode, i], system.reads_all[mode, i], magnitude)
    # The rounding error of a force moves a coordinate that no spring of its own holds, as long as the segment lasts.
    for i in range(counts.dynamic):
        duration, stiffness = 2.0 * state.segment.half, -system.equations[mode, i, i]
        if stiffness > 0.0:
            duration = min(duration, 1.0 / math.sqrt(stiffness))
        magnitude[coordinates + i] += magnitude[first + i] * duration
        magnitude[i] += magnitude[coordinates + i] * duration


@part
def _fill_known_motor(system: System, state: State, trial: float) -> None:
    """Fill in the channels known in time for a system with a rotor: ramps over the `trial` [s], held value and 1."""
    counts, z = system.counts[0], state.z
    z[:] = 0.0
    for k in range(counts.ramps):
        channel = first_ramp(counts) + k
        z[channel, 0], z[channel, 1] = state.ramp[k].value, state.ramp[k].rate * trial
        z[channel + counts.ramps, 0] = state.ramp[k].rate
    z[first_ramp(counts) + 2 * counts.ramps + 1, 0] = state.motor.held
    z[len(z) - 1, 0] = 1.0


@part
def _fill_known_forcing(system: System, state: State, duration: float) -> None:
    """Fill in the forcing over the segment, which lasts `duration` [s], in y = 0 ... 1."""
    counts, z, moved = system.counts[0], state.z, state.scratch.load
    first, ramp = first_signal(counts), first_ramp(counts)
    fill_forcing(system, state)
    for channel in range(first, first + counts.signals):
        recentre(z[channel:channel + 1], -1.0, LENGTH, moved[:1])
        scale_argument(moved[0], 2.0, z[channel])
    for channel in range(first, first + counts.signals + counts.signal_accelerations):
        differentiate(z[channel], duration, z[channel + counts.signals])
    for channel in range(ramp, ramp + counts.ramps):
        z[channel, 0] -= z[channel, 1]
        z[channel, 1] *= 2.0


@part
def solve_by_taylor(system: System, state: State, point: Row) -> None:
    """Begin a segment at `point`, where the flow starts: find its duration and all but the driven series."""
    counts, z, mode, segment = system.counts[0], state.z, state.automaton.mode, state.segment
    if counts.rotors > 0:
        enter_rotor(system, state, point)
        rate = read_phase(system, point)[1]
        longest = longest_rotor_segment(system, state)
        trial = min(longest, system.longest_segment[mode], _TRIAL / (1.0 + abs(rate)))
        _fill_known_motor(system, state, trial)
        segment.mode_start = -1.0
    else:
        choose_segment(system, state)
        longest = trial = min(2.0 * segment.half, resolved_time(state.drive, system.signals.reach[state.drive.cell]))
        segment.half = 0.5 * trial
        _fill_known_forcing(system, state, trial)
    for channel in range(2 * counts.coordinates):
        z[channel, 0] = point[channel]
    ratio = 0.0
    for _ in range(_MOST_TRIALS):
        fill_series(system, state, mode, trial, LENGTH, z)
        ratio = longest / trial
        for i in range(counts.dynamic):
            ratio = min(ratio, _resolved_part(z[counts.coordinates + i]))
        if decays(system, mode):
            ratio = min(ratio, _resolved_part(z[counts.coordinates + system.decay.coordinate[0]]))
        if ratio > _SHORTER:
            break
        trial *= _SHORTER
        for channel in range(len(z)):
            scale_argument(z[channel], _SHORTER, z[channel])
    if not ratio > 0.0 or (counts.rotors > 0 and abs(read_phase(system, point)[1]) > _RUNAWAY):
        point[0] = math.nan  # so that the run ends as diverged
    if counts.rotors > 0:
        current = counts.coordinates + counts.dynamic - 1
        point[current] = z[current, 0]  # the current may jump
    for channel in range(len(state.mode_point)):
        state.mode_point[channel] = point[channel]
    _to_local_time(z, ratio)
    segment.half = 0.5 * (longest if ratio * trial >= longest else ratio * trial)
    _set_magnitudes(system, state)


@part
def end_where_term_returns(system: System, state: State) -> None:
    """If the segment leaves out the mode's decaying term, end it before the term matters again."""
    segment, automaton, mode = state.segment, state.automaton, state.automaton.mode
    if not decays(system, mode) or segment.next_event <= segment.mode_start:
        return
    rate, velocity = system.decay.rate[mode], system.counts[0].coordinates + system.decay.coordinate[0]
    if not _has_faded(system, mode, state.mode_point[velocity]):
        return
    guard = state.scratch.guard
    store(guard, -rate * vector(state.z[velocity]))
    guard[0] -= _OVER
    noise = NOISE * abs(rate) * state.magnitude[velocity]
    root = first_root(guard, segment.mode_start, segment.next_event, noise, state.scratch.search)
    if root != NO_ROOT:
        segment.next_event = segment.mode_start + (root - segment.mode_start) * _BEFORE
        automaton.guard = NOTHING


@part
def evaluate(system: System, state: State, mode: int, point: Row) -> None:
    """Fill in the channels at `point` that follow in `mode` from positions, velocities and channels known in time."""
    fill_series(system, state, mode, 1.0, 1, as_column(point))


@entry
def read_rotor(system: System, state: State, point: Row) -> None:
    """`evaluate` in the present mode, as an entry for Python, with the same bits with which the next segment begins."""
    evaluate(system, state, state.automaton.mode, point)
