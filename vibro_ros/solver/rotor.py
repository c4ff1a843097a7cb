"""The rotor: a phase that is a coordinate, with the signals that follow from it and the controller of its motor.

The phase is driven by a motor's current and by the torque of the signals' loads,

    T = sum over the signals of (g z) df/dphase,

and the signals are functions of the phase. Their Taylor series in time follow order by order from that of the phase,
for `taylor`: sine, cosine, root and quotient have recurrences with one product of series each, fourteen products for
two sliders.

The motor's controller, if it has one, takes its samples between segments.
"""

import math

import numpy as np

from vibro_ros.solver.channels import first_signal
from vibro_ros.solver.elementary import cos, sin
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import MOST_ROTOR_SIGNALS, Motor, State
from vibro_ros.solver.system import BY_COMMAND, BY_VOLTAGE, Controller, System
from vibro_ros.solver.typed import Row, Rows, part
from vibro_ros.solver.vector import LENGTH, Vector, total, vector

_TURN = 2.0 * math.pi
# Phase [rad] that only a diverging step reaches; its turns are not counted, and the step's end finds the divergence.
_LOST = 1e6
# A sample is due if it lies no further ahead than the rounding of its instant.
_DUE = 8.0 * np.finfo(float).eps
# Rows of the scratch's series: cosine and sine of the phase, then of each signal a cos, a sin, root, the signal itself
# and its slope.
_COSINE, _SINE, _SIGNALS, _PER_SIGNAL = 0, 1, 3, 5
_RATE = 2  # row of the phase's rate, mirrored only
#: Rows that a rotor takes.
SERIES_OF_ROTOR = _SIGNALS + _PER_SIGNAL * MOST_ROTOR_SIGNALS


@part
def product_coefficient(p: Row, mirrored: Row, n: int) -> float:
    """Return coefficient n of the product of two series, whose unknown coefficients are zero; n is at most LENGTH, and
    coefficients number LENGTH are left out.

    Coefficient j of the second series is `mirrored` [LENGTH - j], followed by zeros. So the terms of the sum are
    contiguous, and the sum takes as few instructions as a vector has parts.
    """
    return total(_terms(p, mirrored, n))


@part
def _terms(p: Row, mirrored: Row, n: int) -> Vector:
    """Return the terms of the sum in `product_coefficient`."""
    return vector(p) * vector(mirrored[LENGTH - n:])


@part
def _begin_signal(system: System, k: int, series: Rows, mirrored: Rows) -> None:
    """Fill in coefficient 0 of signal k and of its slope, from those of the phase's cosine and sine."""
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


@part
def _put_signal(k: int, n: int, along: float, across: float, root: float, signal: float, slope: float, series: Rows,
                mirrored: Rows) -> None:
    row = _SIGNALS + _PER_SIGNAL * k
    series[row, n], series[row + 1, n], series[row + 2, n] = along, across, root
    series[row + 3, n], series[row + 4, n] = signal, slope
    mirrored[row, LENGTH - n], mirrored[row + 2, LENGTH - n] = along, root
    mirrored[row + 3, LENGTH - n], mirrored[row + 4, LENGTH - n] = signal, slope


@part
def slope_row(k: int) -> int:
    """Return the row of the series of the slope of signal k over the phase."""
    return _SIGNALS + _PER_SIGNAL * k + 4


@part
def begin_signals(system: System, z: Rows, series: Rows, mirrored: Rows) -> None:
    """Fill in the constant terms of the phase's cosine and sine and of all signals, from that of the phase."""
    phase = z[system.counts[0].dynamic - 2, 0]
    series[_COSINE, 0], series[_SINE, 0] = cos(phase), sin(phase)
    for k in range(system.counts[0].signals):
        _begin_signal(system, k, series, mirrored)


@part
def turn_signals(system: System, z: Rows, n: int, step: float, series: Rows, mirrored: Rows) -> None:
    """Fill in coefficient n + 1 of the phase's cosine and sine and of all signals, from those up to n of its rate; and
    coefficient n of the signals' channels, rates and, without the term of the phase's acceleration, accelerations.

    Every sum over older coefficients is computed before the terms of the newest ones are added, because a vector that
    is read just after one of its numbers was written would stall.
    """
    counts = system.counts[0]
    rate, first = z[counts.coordinates + counts.dynamic - 2, n], first_signal(counts)
    turned = mirrored[_RATE]
    cosine = -step * (product_coefficient(series[_SINE], turned, n) + series[_SINE, 0] * rate)
    sine = step * (product_coefficient(series[_COSINE], turned, n) + series[_COSINE, 0] * rate)
    for k in range(counts.signals):
        row = _SIGNALS + _PER_SIGNAL * k
        b, slopes = system.rotor.signal[k, 3], series[row + 4]
        z[first + k, n] = series[row + 3, n]
        z[first + counts.signals + k, n] = product_coefficient(slopes, turned, n) + slopes[0] * rate
        change = (product_coefficient(slopes, turned, n + 1) + slopes[1] * rate
                  if counts.signal_accelerations > 0 else 0.0)
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
        if counts.signal_accelerations > 0:
            of_first = rate if n == 0 else turned[LENGTH]
            z[first + 2 * counts.signals + k, n] = (change + slope * of_first) / step
        _put_signal(k, n + 1, along, across, root, signal, slope, series, mirrored)
    series[_COSINE, n + 1], series[_SINE, n + 1], turned[LENGTH - n] = cosine, sine, rate


@part
def _count_turns(system: System, state: State, point: Row) -> None:
    """Count whole turns of the phase, and keep the phase within a turn, where its rounding error is smallest."""
    phase, drive = system.counts[0].dynamic - 2, state.drive
    while _TURN <= point[phase] < _LOST:
        point[phase] -= _TURN
        drive.turns += 1
    while -_LOST < point[phase] < 0.0:
        point[phase] += _TURN
        drive.turns -= 1


@part
def _reference(target: float, reference: float, slope: float, elapsed: float) -> tuple[float, float]:
    """Return the controller's reference [rad/s], `elapsed` [s] after a command, and its rate [rad/s²]."""
    moved = reference + slope * elapsed
    if slope == 0.0 or (target - moved) * slope <= 0.0:
        return target, 0.0
    return moved, slope


@part
def _take_sample(controller: Controller, motor: Motor, time: float, speed: float) -> None:
    """Take a sample of the speed [rad/s] at `time` [s]: set the held value and the controller's integral."""
    reference, slope = _reference(motor.target, motor.reference, motor.slope, time - motor.since)
    error = reference - speed
    motor.before = motor.integral
    if controller.law == BY_VOLTAGE:
        wanted = controller.feed_forward * reference + controller.proportional * error + motor.integral
        counter, swing = controller.constant * speed, controller.resistance * controller.limit
        held = min(max(wanted, counter - swing), counter + swing)
        held = min(max(held, -controller.supply), controller.supply)  # last, because no supply exceeds its voltage
        winds_up: bool = held != wanted and error * (wanted - held) > 0.0
    else:
        wanted = controller.feed_forward * slope + controller.proportional * error + motor.integral
        held = min(max(wanted, -controller.limit), controller.limit)
        winds_up = held != wanted and error * wanted > 0.0
    if not winds_up:
        motor.integral += controller.integral * controller.period * error
    motor.held = held
    motor.samples += 1


@part
def _time_to_sample(system: System, state: State) -> float:
    """Return the time [s] until the next sample is due; infinite without a controller."""
    segment, controller = state.segment, system.rotor.controller[0]
    if controller.law == BY_COMMAND:
        return math.inf
    return (state.motor.samples * controller.period - segment.start) - segment.residue


@part
def read_phase(system: System, point: Row) -> tuple[float, float]:
    """Return the phase [rad] and its rate [rad/s] at `point`."""
    phase = system.counts[0].dynamic - 2
    return point[phase], point[system.counts[0].coordinates + phase]


@part
def enter_rotor(system: System, state: State, point: Row) -> None:
    """Count turns, and take a sample if one is due, before a segment or a step that starts at `point`."""
    _count_turns(system, state, point)
    if _time_to_sample(system, state) <= _DUE * (1.0 + state.segment.start):
        controller, motor = system.rotor.controller[0], state.motor
        _, rate = read_phase(system, point)
        _take_sample(controller, motor, motor.samples * controller.period, rate)


@part
def longest_rotor_segment(system: System, state: State) -> float:
    """Return the longest duration [s] of a segment that samples and ramps allow."""
    duration = min(LONGEST_SEGMENT, _time_to_sample(system, state))
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            duration = min(duration, state.ramp[k].time_left)
    return duration


def start_rotor(system: System, state: State, target: float) -> None:
    """Set the command of a rotor's motor at the start to `target`, a speed [rad/s] or a voltage [V]."""
    motor = state.now["motor"][0]
    motor["target"] = motor["reference"] = target
    if system.rotor.controller[0]["law"] == BY_COMMAND:
        motor["held"] = target


def command_rotor(system: System, state: State, time: float, target: float, acceleration: float) -> None:
    """Command `target`, a speed [rad/s] or a voltage [V], to a rotor's motor from `time` [s], where a segment begins.

    The controller's reference changes to the speed at the `acceleration` [rad/s²], or at once if that is 0. A sample
    that was taken at this very instant is taken again, because it depends on the command. Otherwise the held value
    stays until the next sample; if the supply has fallen below a held voltage, the supply bounds it at once.
    """
    motor, controller = state.now["motor"][0], system.rotor.controller[0]
    if controller["law"] == BY_COMMAND:
        motor["target"], motor["held"] = target, min(max(target, -controller["supply"]), controller["supply"])
        return
    if controller["law"] == BY_VOLTAGE:
        motor["held"] = min(max(motor["held"], -controller["supply"]), controller["supply"])
    reference = float(motor["reference"] + motor["slope"] * (time - motor["since"]))
    if motor["slope"] == 0.0 or (motor["target"] - reference) * motor["slope"] <= 0.0:
        reference = float(motor["target"])
    if reference == target or acceleration == 0.0:
        reference, slope = target, 0.0
    else:
        slope = math.copysign(acceleration, target - reference)
    motor["target"], motor["reference"], motor["since"], motor["slope"] = target, reference, time, slope
    _withdraw_sample(motor, controller, time)


def give_integral(system: System, state: State, time: float, integral: float) -> None:
    """Set the integral of a rotor's controller [V or A] at `time` [s], where a segment begins.

    A sample that was taken at this very instant is taken again, because it depends on the integral and the speed.
    """
    motor = state.now["motor"][0]
    _withdraw_sample(motor, system.rotor.controller[0], time)
    motor["integral"] = motor["before"] = integral


def _withdraw_sample(motor: np.void, controller: np.void, time: float) -> None:
    """Make a sample that was taken at `time` [s] due again."""
    last = motor["samples"] - 1
    if last >= 0 and abs(last * controller["period"] - time) <= _DUE * (1.0 + time):
        motor["samples"], motor["integral"] = last, motor["before"]
