"""The rotor: a phase that is a coordinate, with the signals that follow from it and the controller of its motor.

The phase turns by a motor's current and by the torque of what the signals drive,

    T = sum over the signals of (g z) df/dphase,

and the signals are functions of the phase. Their Taylor series in time are found order by order from that of the phase,
for `taylor`: sine, cosine, root and quotient have recurrences with one product of series each, fourteen products for
two sliders.

The motor's controller, if it has one, takes its samples between segments.
"""

import math

import numpy as np

from vibro_ros.solver.compilation import called_kernel, kernel, rounding_kernel
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import MOST_ROTOR_SIGNALS, State
from vibro_ros.solver.system import BY_COMMAND, BY_VOLTAGE, System, first_signal

_TURN = 2.0 * math.pi
# A sample is due that lies no further ahead than the rounding of its instant.
_DUE = 8.0 * np.finfo(float).eps
# Rows of the scratch's series: cosine and sine of the phase, then of each signal a cos, a sin, root, the signal itself
# and its slope.
_COSINE, _SINE, _SIGNALS, _PER_SIGNAL = 0, 1, 2, 5
#: Rows that a rotor takes.
SERIES_OF_ROTOR = _SIGNALS + _PER_SIGNAL * MOST_ROTOR_SIGNALS


@kernel
def product_coefficient(p, q, n):
    """Coefficient n of the product of two series."""
    result = 0.0
    for j in range(n + 1):
        result += p[j] * q[n - j]
    return result


@kernel
def _fill_signal(system, k, n, series):
    """Coefficient n of signal k and of its slope, from those of the phase's cosine and sine up to n."""
    a, cosine, sine, b = (system.rotor.signal[k, 0], system.rotor.signal[k, 1], system.rotor.signal[k, 2],
                          system.rotor.signal[k, 3])
    at = _SIGNALS + _PER_SIGNAL * k
    along, across, root, signal, slope = series[at], series[at + 1], series[at + 2], series[at + 3], series[at + 4]
    along[n] = a * (cosine * series[_COSINE, n] + sine * series[_SINE, n])
    across[n] = a * (cosine * series[_SINE, n] - sine * series[_COSINE, n])
    if b < 0.0:
        signal[n], slope[n] = along[n], -across[n]
        return
    # root² = b + along², signal = along + root, root slope = -across signal
    if n == 0:
        root[0] = math.sqrt(b + along[0] * along[0])
        signal[0] = along[0] + root[0]
        slope[0] = -across[0] * signal[0] / root[0]
        return
    square = product_coefficient(along, along, n)
    for j in range(1, n):
        square -= root[j] * root[n - j]
    root[n] = 0.5 * square / root[0]
    signal[n] = along[n] + root[n]
    quotient = -product_coefficient(across, signal, n)
    for j in range(1, n + 1):
        quotient -= root[j] * slope[n - j]
    slope[n] = quotient / root[0]


@kernel
def slope_row(k):
    """Row of the series of the slope of signal k over the phase."""
    return _SIGNALS + _PER_SIGNAL * k + 4


@kernel
def begin_signals(system, z, series):
    """Constant terms of the phase's cosine and sine and of all signals, from that of the phase."""
    phase = z[system.size[0].dynamic - 2, 0]
    series[_COSINE, 0], series[_SINE, 0] = math.cos(phase), math.sin(phase)
    for k in range(system.size[0].signals):
        _fill_signal(system, k, 0, series)


@kernel
def turn_signals(system, z, n, step, series):
    """Coefficients n + 1 of the phase's cosine and sine and of all signals, from its rate's up to n."""
    rate = z[system.size[0].coordinates + system.size[0].dynamic - 2]
    cosine, sine = 0.0, 0.0
    for j in range(n + 1):
        cosine -= series[_SINE, j] * rate[n - j]
        sine += series[_COSINE, j] * rate[n - j]
    series[_COSINE, n + 1], series[_SINE, n + 1] = step * cosine, step * sine
    for k in range(system.size[0].signals):
        _fill_signal(system, k, n + 1, series)


@kernel
def fill_signal_channels(system, z, n, step, series):
    """Coefficient n of the signals, their rates and, but for the part of the phase's acceleration, their accelerations.
    """
    size = system.size[0]
    rate, first = z[size.coordinates + size.dynamic - 2], first_signal(size)
    for k in range(size.signals):
        slope = series[slope_row(k)]
        z[first + k, n] = series[_SIGNALS + _PER_SIGNAL * k + 3, n]
        z[first + size.signals + k, n] = product_coefficient(slope, rate, n)
        if size.signal_accelerations > 0:
            change = slope[n + 1] * rate[0]
            for j in range(1, n + 1):
                change += slope[j] * rate[n + 1 - j]
            z[first + 2 * size.signals + k, n] = change / step


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
def longest_rotor_segment(system, state):
    """How long [s] a segment may last, as far as samples and ramps go."""
    duration = min(LONGEST_SEGMENT, _time_to_sample(system, state))
    for k in range(len(state.ramp)):
        if state.ramp[k].rate != 0.0:
            duration = min(duration, state.ramp[k].time_left)
    return duration


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
