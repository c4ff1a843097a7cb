"""The rotor: a phase that is a coordinate, whose flow is not linear, as Taylor series about a segment's start.

The phase turns by a motor's current and by the torque of what the signals drive,

    T = sum over the signals of (g z) df/dphase,

and the signals are functions of the phase. Their products make the flow nonlinear. The series of all channels are found
order by order: the coefficient n + 1 of every position and velocity follows from the coefficients n of all channels,
which follow from the coefficients up to n of positions and velocities. Sine, cosine, root and quotient have recurrences
with one product of series each (R. E. Moore, Interval Analysis, 1966, ch. 11): fourteen products for two sliders.

Where a signal's second derivative enters the equations, the coefficient n of the phase's acceleration enters the torque
that decides it. It enters linearly, by the same factor for every n, so that one division solves for it.

A segment lasts as long as the last coefficients of the velocities are rounding. Its series in y = 0 ... 1 become
polynomials in the local time x = 2 y - 1, as every other segment has them: guards, events, audit and dense output are
the same.

The motor's controller, if it has one, takes its samples between segments.
"""

import math

import numpy as np

from vibro_ros.solver.compilation import called_kernel, entry_kernel, kernel, rounding_kernel
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import State
from vibro_ros.solver.system import (
    BY_COMMAND,
    BY_VOLTAGE,
    NOTHING,
    System,
    first_acceleration,
    first_ramp,
    first_signal,
    form_magnitude,
    sparse_magnitude,
)
from vibro_ros.solver.vector import LENGTH, store, total, vector

_TURN = 2.0 * math.pi
# A velocity's last coefficient, beside its first ones; those that follow fall by `_FALL` each, so that their sum is a
# quarter of it.
_LAST, _FALL = 4e-16, 0.2
# Phase [rad] of a trial: its series shows how long the segment may be, which is at most `_LONGER` times as long.
_TRIAL, _LONGER = 0.5, 4.0
_REFINEMENTS = 3
# A current that has died away: its products would be lost below the smallest number.
_VANISHING = 1e-250
# A sample is due that lies no further ahead than the rounding of its instant.
_DUE = 8.0 * np.finfo(float).eps
# Row n: coefficients of ((1 + x) / 2)^n.
_FROM_START = np.array([[math.comb(n, k) / 2.0**n for k in range(LENGTH)] for n in range(LENGTH)])
# Rows of the scratch's series: cosine and sine of the phase, then of each signal a cos, a sin, root, the signal itself
# and its slope; after those of all signals one row for numbers.
_COSINE, _SINE, _SIGNALS, _PER_SIGNAL = 0, 1, 3, 5
_RATE = 2  # row of the phase's rate, mirrored only


@kernel
def _product(p, mirrored, n):
    """Coefficient n of the product of two series, of which every coefficient that is not known yet is zero; n is at most
    LENGTH, whose own coefficients do not count.

    Coefficient j of the second series is `mirrored` [LENGTH - j], behind which are zeros: so the terms of the sum stand
    side by side, and the sum takes as few instructions as a vector has parts.
    """
    return total(_terms(p, mirrored, n))


@kernel
def _terms(p, mirrored, n):
    """The terms of that sum."""
    return vector(p) * vector(mirrored[LENGTH - n:])


@kernel
def _row_at(row, terms, z, n):
    """Coefficient n of a form."""
    result = 0.0
    for channel in terms:
        if channel == NOTHING:
            break
        result += row[channel] * z[channel, n]
    return result


@kernel
def _begin_signal(system, k, series, mirrored):
    """Coefficient 0 of signal k and of its slope, from those of the phase's cosine and sine."""
    a, cosine, sine, b = (system.rotor.signal[k, 0], system.rotor.signal[k, 1], system.rotor.signal[k, 2],
                          system.rotor.signal[k, 3])
    along = a * (cosine * series[_COSINE, 0] + sine * series[_SINE, 0])
    across = a * (cosine * series[_SINE, 0] - sine * series[_COSINE, 0])
    if b < 0.0:
        _put_signal(k, 0, along, across, 0.0, along, -across, series, mirrored)
        return
    root = math.sqrt(b + along * along)
    signal = along + root
    _put_signal(k, 0, along, across, root, signal, -across * signal / root, series, mirrored)


@kernel
def _put_signal(k, n, along, across, root, signal, slope, series, mirrored):
    row = _SIGNALS + _PER_SIGNAL * k
    series[row, n], series[row + 1, n], series[row + 2, n] = along, across, root
    series[row + 3, n], series[row + 4, n] = signal, slope
    mirrored[row, LENGTH - n], mirrored[row + 2, LENGTH - n] = along, root
    mirrored[row + 3, LENGTH - n], mirrored[row + 4, LENGTH - n] = signal, slope


@kernel
def _turn_signals(system, z, n, step, series, mirrored):
    """Coefficients n + 1 of the phase's cosine and sine and of all signals, from its rate's up to n; coefficient n of
    the channels of the signals, their rates and, but for the part of the phase's acceleration, their accelerations.

    Every sum over known coefficients comes before what the newest ones add to it: a vector that is read just after one
    of its numbers was written would wait for that.
    """
    size = system.size[0]
    rate, first = z[size.coordinates + size.dynamic - 2, n], first_signal(size)
    turned, per_step = mirrored[_RATE], 1.0 / step  # which no coefficient has to wait for
    cosine = -step * (_product(series[_SINE], turned, n) + series[_SINE, 0] * rate)
    sine = step * (_product(series[_COSINE], turned, n) + series[_COSINE, 0] * rate)
    for k in range(size.signals):
        row = _SIGNALS + _PER_SIGNAL * k
        b, slopes = system.rotor.signal[k, 3], series[row + 4]
        z[first + k, n] = series[row + 3, n]
        z[first + size.signals + k, n] = _product(slopes, turned, n) + slopes[0] * rate
        change = _product(slopes, turned, n + 1) + slopes[1] * rate if size.signal_accelerations > 0 else 0.0
        along = system.rotor.signal[k, 0] * (system.rotor.signal[k, 1] * cosine + system.rotor.signal[k, 2] * sine)
        across = system.rotor.signal[k, 0] * (system.rotor.signal[k, 1] * sine - system.rotor.signal[k, 2] * cosine)
        if b < 0.0:
            root, signal, slope = 0.0, along, -across
        else:  # root² = b + along², signal = along + root, root slope = -across signal
            inverse = 1.0 / series[row + 2, 0]
            square = 0.5 * total(_terms(series[row], mirrored[row], n + 1)
                                 - _terms(series[row + 2], mirrored[row + 2], n + 1))
            quotient = total(_terms(series[row + 1], mirrored[row + 3], n + 1)
                             + _terms(slopes, mirrored[row + 2], n + 1))
            root = (series[row, 0] * along + square) * inverse
            signal = along + root
            slope = -inverse * (quotient + series[row + 1, 0] * signal + across * series[row + 3, 0]
                                + slopes[0] * root)
        if size.signal_accelerations > 0:
            of_first = rate if n == 0 else turned[LENGTH]
            z[first + 2 * size.signals + k, n] = (change + slope * of_first) * per_step
        _put_signal(k, n + 1, along, across, root, signal, slope, series, mirrored)
    series[_COSINE, n + 1], series[_SINE, n + 1], turned[LENGTH - n] = cosine, sine, rate


@kernel
def _respond(system, mode, series):
    """Store what a unit of the phase's acceleration adds to the other accelerations and the loads of the signals;
    return what it adds to the torque."""
    size, response = system.size[0], series[2]
    if size.signal_accelerations == 0:
        return 0.0
    first, of_signals = first_acceleration(size), first_signal(size) + 2 * size.signals
    for i in range(size.dynamic - 2):
        response[i] = 0.0
        for k in range(size.signals):
            response[i] += system.acceleration[mode, i, of_signals + k] * series[_SIGNALS + _PER_SIGNAL * k + 4, 0]
    torque = 0.0
    for k in range(size.signals):
        load = 0.0
        for j in range(size.signals):
            load += system.rotor.load[mode, k, of_signals + j] * series[_SIGNALS + _PER_SIGNAL * j + 4, 0]
        for i in range(size.dynamic - 2):
            load += system.rotor.load[mode, k, first + i] * response[i]
        response[size.dynamic - 2 + k] = load
        torque += load * series[_SIGNALS + _PER_SIGNAL * k + 4, 0]
    return torque


@kernel
def _fill_accelerations(system, mode, z, n, series, mirrored, loads, of_unit):
    """Coefficient n of the accelerations of masses and phase, of the torque, and of the signals' loads."""
    size, response = system.size[0], series[2]
    phase, first, torque = size.dynamic - 2, first_acceleration(size), first_ramp(size) + 2 * size.ramps
    for i in range(phase):
        z[first + i, n] = _row_at(system.acceleration[mode, i], system.rotor.terms[mode, i], z, n)
    z[torque, n] = 0.0
    for k in range(size.signals):
        slope = _SIGNALS + _PER_SIGNAL * k + 4
        known = _product(loads[k], mirrored[slope], n)  # before the coefficient n of the load is written
        loads[k, n] = load = _row_at(system.rotor.load[mode, k], system.rotor.load_terms[mode, k], z, n)
        z[torque, n] += known + load * series[slope, 0]
    row = system.acceleration[mode, phase]
    change = _row_at(row, system.rotor.terms[mode, phase], z, n)
    if size.signal_accelerations > 0:
        change /= 1.0 - row[torque] * of_unit
        for i in range(phase):
            z[first + i, n] += response[i] * change
        for k in range(size.signals):
            slope = series[_SIGNALS + _PER_SIGNAL * k + 4, 0]
            z[first_signal(size) + 2 * size.signals + k, n] += slope * change
            loads[k, n] += response[phase + k] * change
        z[torque, n] += of_unit * change
    z[first + phase, n] = change


@called_kernel
def fill_series(system, mode, duration, orders, z, room):
    """Coefficients of the channels, but of the driven coordinates, in y = 0 ... 1 over `duration` [s].

    Parameters
    ----------
    mode : int
        The mode whose equations hold.
    duration : float
        Time [s] from y = 0 to 1.
    orders : int
        Number of coefficients.
    z : ndarray, shape (channels, orders or more)
        Constant terms of positions, velocities, ramps, held value and 1 are given, and of the ramps their rates.
    room : record
        The scratch's; overwritten.
    """
    size, series, mirrored, loads = system.size[0], room.rotor[:], room.mirrored[:], room.load[:]
    series[:], mirrored[:], loads[:] = 0.0, 0.0, 0.0
    phase, charge, coordinates, first = size.dynamic - 2, size.dynamic - 1, size.coordinates, first_acceleration(size)
    series[_COSINE, 0], series[_SINE, 0] = math.cos(z[phase, 0]), math.sin(z[phase, 0])
    for k in range(size.signals):
        _begin_signal(system, k, series, mirrored)
    of_unit = _respond(system, mode, series)
    for n in range(orders):
        step = duration / (n + 1)
        _turn_signals(system, z, n, step, series, mirrored)
        if system.rotor.algebraic[mode]:
            z[coordinates + charge, n] = _row_at(system.rotor.current[mode], system.rotor.current_terms[mode], z, n)
        _fill_accelerations(system, mode, z, n, series, mirrored, loads, of_unit)
        z[first + charge, n] = _row_at(system.acceleration[mode, charge], system.rotor.terms[mode, charge], z, n)
        if n + 1 < orders:
            for i in range(size.dynamic):
                z[i, n + 1] = step * z[coordinates + i, n]
                z[coordinates + i, n + 1] = step * z[first + i, n]


@kernel
def _resolved_part(p):
    """How much of y = 0 ... 1 a series may span, so that its last coefficients are rounding."""
    part = _LONGER
    for _ in range(_REFINEMENTS):
        size, power = 0.0, 1.0
        for n in range(LENGTH // 2):
            size += abs(p[n]) * power
            power *= part
        last, before = abs(p[LENGTH - 1]), abs(p[LENGTH - 2])
        if last > _VANISHING:
            part = min(part, (_LAST * size / last) ** (1.0 / (LENGTH - 1)))
        if before > _VANISHING:
            part = min(part, (_LAST / _FALL * size / before) ** (1.0 / (LENGTH - 2)))
    return part


@kernel
def _to_local_time(z, part):
    """Turn the coefficients in y = 0 ... 1 over a trial into those in x = -1 ... 1 over `part` of it."""
    for channel in range(len(z)):
        p = z[channel]
        scaled = p[0] * vector(_FROM_START[0])
        power = part
        for n in range(1, LENGTH):
            scaled = scaled + (p[n] * power) * vector(_FROM_START[n])
            power *= part
        store(p, scaled)


@kernel
def _set_scales(system, state):
    """Magnitudes of the terms that make up each channel, of which guards take their rounding error."""
    size, z, scale, mode = system.size[0], state.z, state.scale, state.now[0].automaton.mode
    first, torque = first_acceleration(size), first_ramp(size) + 2 * size.ramps
    duration = 2.0 * state.now[0].segment.half
    for channel in range(len(z)):
        if channel < size.dynamic or size.coordinates <= channel < size.coordinates + size.dynamic or (
                first_signal(size) <= channel):
            scale[channel] = abs(z[channel, 0]) + abs(z[channel, 1])
    if size.signal_accelerations > 0:  # differences of larger terms
        rate = scale[size.coordinates + size.dynamic - 2]
        for k in range(size.signals):
            scale[first_signal(size) + 2 * size.signals + k] += system.rotor.signal[k, 0] * rate * rate
    for i in range(size.dynamic - 2):
        scale[first + i] = form_magnitude(system.acceleration[mode, i], scale)
    for k in range(size.signals):
        a, b = system.rotor.signal[k, 0], system.rotor.signal[k, 3]
        slope = a * (1.0 + a / math.sqrt(b)) if b > 0.0 else a  # the largest
        scale[torque] += slope * sparse_magnitude(system.rotor.load[mode, k], system.rotor.load_terms[mode, k], scale)
    for i in range(size.dynamic - 2, size.dynamic):
        scale[first + i] = form_magnitude(system.acceleration[mode, i], scale)
    # A force is rounded, and moves what no spring of its own holds, for as long as the segment lasts.
    for i in range(size.dynamic):
        if system.acceleration[mode, i, i] == 0.0:
            scale[size.coordinates + i] += scale[first + i] * duration
            scale[i] += scale[size.coordinates + i] * duration


@kernel
def _count_turns(system, state, point):
    """Keep the phase within a turn, where its digits are as fine as they can be."""
    phase, drive = system.size[0].dynamic - 2, state.now[0].drive
    while point[phase] >= _TURN:
        point[phase] -= _TURN
        drive.turns += 1
    while point[phase] < 0.0:
        point[phase] += _TURN
        drive.turns -= 1


@rounding_kernel
def _reference(target, reference, slope, elapsed):
    """Speed [rad/s] that the controller follows `elapsed` [s] after a command, and its rate of change [rad/s²]."""
    moved = reference + slope * elapsed
    return (target, 0.0) if slope == 0.0 or (target - moved) * slope <= 0.0 else (moved, slope)


@rounding_kernel  # a clamped value is compared with itself
def _take_sample(controller, motor, time, speed):
    """Take a sample of the speed [rad/s] at `time` [s]: set what is held, and the controller's integral."""
    reference, slope = _reference(motor.target, motor.reference, motor.slope, time - motor.since)
    error = reference - speed
    motor.before = motor.integral
    if controller.law == BY_VOLTAGE:
        wanted = controller.feed_forward * reference + controller.proportional * error + motor.integral
        counter, swing = controller.constant * speed, controller.resistance * controller.limit
        held = min(max(wanted, max(-controller.supply, counter - swing)), min(controller.supply, counter + swing))
        winds_up = held != wanted and error * (wanted - held) > 0.0
    else:
        wanted = controller.feed_forward * slope + controller.proportional * error + motor.integral
        held = min(max(wanted, -controller.limit), controller.limit)
        winds_up = held != wanted and error * wanted > 0.0
    if not winds_up:
        motor.integral += controller.integral * controller.period * error
    motor.held = held
    motor.samples += 1


@kernel
def _time_to_sample(system, state):
    """Time [s] until the next sample is due; infinite without samples."""
    segment, controller = state.now[0].segment, system.rotor.controller[0]
    if controller.law == BY_COMMAND:
        return math.inf
    return (state.now[0].motor.samples * controller.period - segment.start) - segment.residue


@kernel
def read_phase(system, point):
    """Phase [rad] and its rate [rad/s] at `point`."""
    phase = system.size[0].dynamic - 2
    return point[phase], point[system.size[0].coordinates + phase]


@called_kernel
def enter_rotor(system, state, point):
    """Before a segment, or a step, that starts at `point`: count turns, and take a sample that is due."""
    _count_turns(system, state, point)
    if _time_to_sample(system, state) <= _DUE * (1.0 + state.now[0].segment.start):
        controller, motor, (_, rate) = system.rotor.controller[0], state.now[0].motor, read_phase(system, point)
        _take_sample(controller, motor, motor.samples * controller.period, rate)


@kernel
def _longest_duration(system, state):
    """How long [s] a segment may last, as far as samples and ramps go."""
    duration = min(LONGEST_SEGMENT, _time_to_sample(system, state))
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            duration = min(duration, state.ramp[k].time_left)
    return duration


@kernel
def _fill_start(system, state, point, trial):
    """Constant terms of what the series begin with, and the ramps' slopes over the `trial` [s]."""
    size, z = system.size[0], state.z
    for channel in range(2 * size.coordinates):
        z[channel, 0] = point[channel]
    for k in range(size.ramps):
        channel = first_ramp(size) + k
        z[channel, 0], z[channel, 1] = state.ramp[k].value, state.ramp[k].rate * trial
        z[channel + size.ramps, 0] = state.ramp[k].rate
    z[first_ramp(size) + 2 * size.ramps + 1, 0] = state.now[0].motor.held
    z[len(z) - 1, 0] = 1.0


@called_kernel
def solve_rotor(system, state, point):
    """Begin a segment at `point`, where the flow starts: its duration, and the series of all that moves by itself."""
    size, now, z, room = system.size[0], state.now[0], state.z, state.scratch.room[0]
    mode = now.automaton.mode
    enter_rotor(system, state, point)
    _, rate = read_phase(system, point)
    longest = _longest_duration(system, state)
    trial = min(longest, system.longest_segment[mode], _TRIAL / (1.0 + abs(rate)))
    z[:] = 0.0
    _fill_start(system, state, point, trial)
    fill_series(system, mode, trial, LENGTH, z, room)
    point[size.coordinates + size.dynamic - 1] = z[size.coordinates + size.dynamic - 1, 0]  # a current may jump
    for channel in range(len(state.mode_point)):
        state.mode_point[channel] = point[channel]
    part = longest / trial
    for i in range(size.dynamic):
        part = min(part, _resolved_part(z[size.coordinates + i]))
    _to_local_time(z, part)
    segment = now.segment
    segment.half = 0.5 * (longest if part * trial >= longest else part * trial)
    segment.flow_start = segment.mode_start = -1.0
    segment.slot = 0
    _set_scales(system, state)


@kernel
def evaluate(system, state, mode, point):
    """Fill the channels at `point` that follow from positions, velocities, ramps and held value in `mode`."""
    room = state.scratch.room[0]
    fill_series(system, mode, 1.0, 1, point.reshape((len(point), 1)), room)


def start_rotor(system: System, state: State, target: float) -> None:
    """Let a rotor's motor be asked for `target`, a speed [rad/s] or a voltage [V], since before the start."""
    motor = state.now["motor"][0]
    motor["target"] = motor["reference"] = target
    if system.rotor.controller[0]["law"] == BY_COMMAND:
        motor["held"] = target


def command_rotor(system: System, state: State, time: float, target: float, acceleration: float) -> None:
    """Ask a rotor's motor for `target`, a speed [rad/s] or a voltage [V], from `time` [s] on, where a segment begins.

    The controller follows the speed at the `acceleration` [rad/s²], or at once if that is 0. A sample that was taken at
    this very instant is taken again, because it counts the command. A voltage that is held is at most the supply's.
    """
    motor, controller = state.now["motor"][0], system.rotor.controller[0]
    if controller["law"] == BY_COMMAND:
        motor["target"], motor["held"] = target, min(max(target, -controller["supply"]), controller["supply"])
        return
    if controller["law"] == BY_VOLTAGE:  # until the next sample: the supply may have sagged
        motor["held"] = min(max(motor["held"], -controller["supply"]), controller["supply"])
    reference = float(motor["reference"] + motor["slope"] * (time - motor["since"]))
    if motor["slope"] == 0.0 or (motor["target"] - reference) * motor["slope"] <= 0.0:
        reference = float(motor["target"])
    if reference == target or acceleration == 0.0:
        reference, slope = target, 0.0
    else:
        slope = math.copysign(acceleration, target - reference)
    motor["target"], motor["reference"], motor["since"], motor["slope"] = target, reference, time, slope
    last = motor["samples"] - 1
    if last >= 0 and abs(last * controller["period"] - time) <= _DUE * (1.0 + time):
        motor["samples"], motor["integral"] = last, motor["before"]


@called_kernel
def strike(system, state, point, after):
    """Fill `after` with the channels after a landing at `point` that strikes the rotor; return the candidate's number.

    The inertia of the body along the ground and upwards is A = A_0 - c c^T / J(phase): A_0 while the phase is held, and
    c the body's momentum from a unit of the phase's rate. In the shock the phase's rate changes by -c . dV / J. The
    body slips, stops or sticks by Routh's law; `model.shock` has the rule, for an inertia that does not change.
    """
    size, numbers, shock = system.size[0], system.shock.numbers[0], system.shock
    evaluate(system, state, state.now[0].automaton.mode, point)
    series, coordinates, phase = state.scratch.room[0].rotor[:], size.coordinates, size.dynamic - 2
    inertia, of_speed, of_rise = numbers.rotor, 0.0, 0.0
    for k in range(size.signals):
        slope = series[_SIGNALS + _PER_SIGNAL * k + 4, 0]
        inertia += shock.mass[k] * slope * slope
        of_speed += shock.momentum[k, 0] * slope
        of_rise += shock.momentum[k, 1] * slope
    along = numbers.along - of_speed * of_speed / inertia
    across, up = numbers.across - of_speed * of_rise / inertia, numbers.up - of_rise * of_rise / inertia
    fall = point[coordinates + numbers.height]
    speed = point[coordinates + numbers.body] if numbers.body != NOTHING else 0.0
    state_after, speed_after = 0, 0.0
    if not numbers.has_friction:
        speed_after = speed + across / along * fall
    else:
        forwards = (across + numbers.kinetic[0] * up) / (along + numbers.kinetic[0] * across)
        backwards = (across - numbers.kinetic[1] * up) / (along - numbers.kinetic[1] * across)
        if (speed + forwards * fall if forwards >= 0.0 else speed) >= 0.0:
            speed_after = speed + forwards * fall
        elif (speed + backwards * fall if backwards <= 0.0 else speed) <= 0.0:
            state_after, speed_after = 1, speed + backwards * fall
        elif -numbers.static[0] * up <= across <= numbers.static[1] * up:
            state_after = 2
        elif backwards > 0.0:  # friction is too weak: the body slips back after speed / forwards of the fall has ended
            state_after, speed_after = 1, backwards * (speed / forwards + fall)
        else:
            speed_after = forwards * (speed / backwards + fall)
    for channel in range(len(point)):
        after[channel] = point[channel]
    change = speed_after - speed if numbers.body != NOTHING else 0.0
    after[numbers.height], after[coordinates + numbers.height] = 0.0, 0.0
    if numbers.body != NOTHING:
        after[coordinates + numbers.body] = speed_after
    for i in range(phase):
        after[coordinates + i] -= shock.direction[i, 0] * change - shock.direction[i, 1] * fall
    rate = point[coordinates + phase] - (of_speed * change - of_rise * fall) / inertia
    after[coordinates + phase] = rate
    for k in range(size.signals):
        after[first_signal(size) + size.signals + k] = series[_SIGNALS + _PER_SIGNAL * k + 4, 0] * rate
    if numbers.has_bearing:
        return 2 * state_after + (1 if rate < 0.0 else 0)
    return state_after


@entry_kernel
def read_rotor(system, state, point):
    """`evaluate`, for Python, in the present mode: the very bits that the next segment begins with."""
    evaluate(system, state, state.now[0].automaton.mode, point)
