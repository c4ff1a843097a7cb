"""The right-hand side at one instant, by values and not by series, for steps of fixed length.

In the methods of fixed step a *segment* is a step. A step may be longer than a cell of the signals or a change of the
phase's speed.
"""

from vibro_ros.solver.channels import first_acceleration, first_ramp, first_signal
from vibro_ros.solver.drive import advance_speed, settling_time
from vibro_ros.solver.polynomial import value_and_derivatives
from vibro_ros.solver.segment import advance_ramps, phase_at
from vibro_ros.solver.state import Drive, State
from vibro_ros.solver.system import System, form_value
from vibro_ros.solver.taylor import decays, evaluate
from vibro_ros.solver.typed import Row, part


@part
def phase_after(system: System, state: State, elapsed: float) -> tuple[float, float]:
    """Return the phase past the start of the turn [rad] and its rate [rad/s], `elapsed` [s] after the step's start."""
    drive, half = state.drive, state.segment.half
    if system.counts[0].rotors > 0:  # the phase is a coordinate
        return 0.0, 0.0
    change = settling_time(drive)
    if 0.0 < change < elapsed:
        phase, _ = phase_at(system, state, change / half - 1.0)
        target = drive.direction * drive.target
        return phase + target * (elapsed - change), target
    return phase_at(system, state, elapsed / half - 1.0)


@part
def _change_of_speed(drive: Drive, elapsed: float, speed: float) -> float:
    """Return the rate [rad/s²] of the phase's speed, which is `speed` at `elapsed` [s] after the step's start."""
    if elapsed >= settling_time(drive):
        return 0.0
    if drive.lag > 0.0:
        return (drive.direction * drive.target - speed) / drive.lag
    return drive.direction * drive.acceleration


@part
def _cell_of(start: Row, phase: float, cell: int) -> tuple[int, int, float]:
    """Return the cell of a phase, found from another `cell`, the turns between them, and the phase within its turn."""
    turns = 0
    while phase >= start[cell + 1]:
        cell += 1
        if cell == len(start) - 1:
            cell = 0
            turns += 1
            phase -= start[len(start) - 1]
    while phase < start[cell]:
        cell -= 1
        if cell < 0:
            cell = len(start) - 2
            turns -= 1
            phase += start[len(start) - 1]
    return cell, turns, phase


@part
def fill_forcing_at(system: System, state: State, elapsed: float, z: Row) -> None:
    """Set the channels of signals, ramps, held value and the constant to their values `elapsed` [s] after the step's
    start; with a rotor, `accelerate` sets the signals."""
    _fill_ramps_at(system, state, elapsed, z)
    if system.counts[0].rotors > 0:
        z[first_ramp(system.counts[0]) + 2 * system.counts[0].ramps + 1] = state.motor.held
        return
    start, signals, first = system.signals.start, system.counts[0].signals, first_signal(system.counts[0])
    phase, speed = phase_after(system, state, elapsed)
    cell, _, phase = _cell_of(start, phase, state.drive.cell)
    scale = 2.0 / (start[cell + 1] - start[cell])
    y = (phase - start[cell]) * scale - 1.0
    for k in range(signals):
        value, slope, curvature = value_and_derivatives(system.signals.series[cell, k], y)
        z[first + k] = value
        z[first + signals + k] = slope * scale * speed
        if system.counts[0].signal_accelerations > 0:
            change = _change_of_speed(state.drive, elapsed, speed)
            z[first + 2 * signals + k] = (curvature * scale * speed * speed + slope * change) * scale


@part
def _fill_ramps_at(system: System, state: State, elapsed: float, z: Row) -> None:
    first, ramps = first_ramp(system.counts[0]), system.counts[0].ramps
    for k in range(ramps):
        ramp = state.ramp[k]
        moving: bool = ramp.rate != 0.0 and elapsed < ramp.time_left
        rate = ramp.rate if moving else 0.0
        z[first + k] = ramp.value + rate * elapsed if moving or ramp.rate == 0.0 else ramp.target
        z[first + ramps + k] = rate
    z[len(z) - 1] = 1.0


@part
def accelerate(system: System, state: State, mode: int, z: Row, accelerations: Row) -> None:
    """Compute the accelerations of all coordinates in `mode`, from the other channels of z.

    z receives the accelerations of the dynamic coordinates, the decaying term and the channels that depend on a rotor's
    phase.
    """
    coordinates, dynamic = system.counts[0].coordinates, system.counts[0].dynamic
    if system.counts[0].rotors > 0 or decays(system, mode):
        evaluate(system, state, mode, z)
        for i in range(dynamic):
            accelerations[i] = z[first_acceleration(system.counts[0]) + i]
    else:
        for i in range(dynamic):
            accelerations[i] = form_value(system.equations[mode, i], z)
            z[first_acceleration(system.counts[0]) + i] = accelerations[i]
    for i in range(dynamic, coordinates):
        accelerations[i] = form_value(system.equations[mode, i], z)


@part
def advance_values(system: System, state: State, elapsed: float) -> int:
    """Move phase and ramps by `elapsed` [s], but not the clock; return which targets are reached, as
    `segment.advance_forcing` does."""
    if system.counts[0].rotors > 0:
        return advance_ramps(state, elapsed)
    drive, start = state.drive, system.signals.start
    phase, speed = phase_after(system, state, elapsed)
    drive.cell, turns, phase = _cell_of(start, phase, drive.cell)
    drive.turns += turns
    reached = 1 << len(state.ramp) if advance_speed(drive, elapsed, drive.direction * speed) else 0
    drive.offset = phase - start[drive.cell] if drive.direction > 0 else start[drive.cell + 1] - phase
    return reached | advance_ramps(state, elapsed)
