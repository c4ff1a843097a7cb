"""The tables of a piecewise linear system with known forcing, which the event loop integrates; and linear forms.

Coordinates q obey, in mode m, q'' = A_m z with the *channels*

    z = [q, q', a, f, f', f'', r, r', T, h, d, 1]

where a = q'' of the dynamic coordinates; f are periodic signals of a phase, whose speed is constant, changes linearly
or approaches a target exponentially, and f'' exists only in a system that asks for it; r are ramps, which move to
their targets at constant rates; and d, if it exists, is a term that decays exponentially with a coordinate's
velocity (`Decay`). If the phase is a coordinate (`Rotor`), T is the torque on it, and h the voltage or current at which
its motor is held.

The first `dynamic` coordinates may enter their own right-hand sides, with the forcing. The other coordinates are
*driven* by all of these. Only guards and outputs depend on the driven coordinates, so a mode that changes their
equations alone leaves the *flow*, the motion of the dynamic coordinates, as it is.

Every guard is a linear form g = G z that its mode keeps non-negative. Where the guard turns negative the event loop
stops, lets positions and velocities jump if the guard has a jump, and enters the first candidate mode that is valid.
"""

from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from vibro_ros.solver.channels import Counts
from vibro_ros.solver.typed import (
    Flags,
    Flags2,
    Indices,
    Indices2,
    Indices3,
    Indices4,
    Kind,
    Row,
    Rows,
    Rows3,
    entry,
    part,
    record,
)

#: Half a segment at a changing speed over the distance to the signals' nearest singularity, because 0.225^LENGTH is
#: rounding. With 0.22 a cell of the shipped mechanism would take three segments in place of two.
STRIDE = 0.225
#: Half a cell over the distance from its middle to that singularity; economization leaves out 4.2^-LENGTH, rounding.
CELL_STRIDE = 0.45
#: In a table of indices: no (more) row, channel, candidate, jump, monitor, event or coordinate. What it means in each
#: table stands with the table.
NOTHING = -1
#: `GuardTable.effect` of a guard whose candidates need not satisfy any guard of its effect.
UNCHECKED = -2


class GuardTable(NamedTuple):
    """The guards of all modes: when a mode ends, and which mode follows. m modes have at most g guards with c
    candidates, which share linear forms."""

    # Distinct rows of G, shape (rows, channels); the channels that they read, padded with `NOTHING`; and whether they
    # read a coordinate that is not dynamic, shape (rows,).
    form: Rows
    terms: Indices2
    driven: Flags
    # Row of each guard, shape (m, g); `NOTHING` after the last guard of a mode.
    row: Indices2
    # Effect that the guard belongs to, shape (m, g); `NOTHING` after the last guard. A candidate must satisfy its own
    # guards of the same effect, because only this effect changes. `UNCHECKED`: the `entry` rows alone decide.
    effect: Indices2
    # Modes to try when the guard fires, shape (m, g, c), `NOTHING` after the last; the last is entered when no other is
    # valid. A guard without a candidate ends the system: the caller goes on with another one.
    candidate: Indices3
    # Rows that must not be negative, before the jump, for the candidate to be entered, shape (m, g, c, n); else
    # `NOTHING`.
    entry: Indices4
    # Number of the `jump_matrix` by which the coordinates jump on the way to the candidate, shape (m, g, c); `NOTHING`
    # if they go on as they are, or jump by a shock (`Shock.candidate`).
    jump: Indices3
    # Rows of the positions and velocities after a jump, shape (jumps, 2 coordinates, channels).
    jump_matrix: Rows3
    # Monitor for which the guard records a blow without duration, shape (m, g); `NOTHING` if it is no blow.
    blow_monitor: Indices2
    # Kind of the event recorded when the guard fires and `EventTable.kind` has none, shape (m, g), or `NOTHING`.
    event: Indices2


class EventTable(NamedTuple):
    """The events that a change of mode records."""

    # Kind of the event when the mode changes from the first to the second, shape (m, m), or `NOTHING`.
    kind: Indices2
    # Row of the quantity recorded with an event of that kind, before the jump, shape (kinds, channels).
    quantity: Rows


class MonitorTable(NamedTuple):
    """The k monitors, which record the peak of a quantity, such as a contact force, while they are on."""

    # Rows of the quantities, shape (m, k, channels), and the channels that they read, padded with `NOTHING`.
    quantity: Rows3
    terms: Indices3
    # Whether monitor k is on in the mode, shape (m, k).
    active: Flags2
    # Row of the quantity recorded when the monitor is switched on, such as the approach speed, shape (k, channels).
    approach: Rows


class SignalTable(NamedTuple):
    """Periodic signals as Taylor polynomials, cell by cell over one period of the phase.

    Attributes
    ----------
    start : ndarray, shape (cells + 1,)
        Phases at which cells begin, ascending; the last is the period.
    reach : ndarray, shape (cells,)
        Distance [rad] in the complex plane from the cell to the nearest singularity.
    series : ndarray, shape (cells, signals, LENGTH)
        Coefficients of the polynomials in 2 (phase - start) / width - 1, with start and width of the cell.
    """

    start: Row
    reach: Row
    series: Rows3


class Decay(NamedTuple):
    """A decaying term d = f exp(r v), where v is a coordinate's velocity; all arrays are empty if there is none.

    Attributes
    ----------
    coordinate : ndarray of int, shape (1,)
        The coordinate whose velocity is v.
    factor : ndarray, shape (m, channels)
        Rows of the factor f.
    terms : ndarray of int, shape (m, channels)
        Channels that the rows of `factor` read, padded with `NOTHING`.
    rate : ndarray, shape (m,)
        r, with r v <= 0 while the mode lasts; 0 in a mode without such a term.
    """

    coordinate: Indices
    factor: Rows
    terms: Indices2
    rate: Row


#: Laws that set the value at which a motor is held (`Rotor.controller`): the command, at once; or a controller, which
#: sets a voltage, or a current, at each sample.
BY_COMMAND, BY_VOLTAGE, BY_CURRENT = 0, 1, 2

#: A sampled controller.
CONTROLLER = record([
    ("law", np.int64),  # BY_COMMAND, BY_VOLTAGE or BY_CURRENT
    ("period", np.float64),  # of the samples [s]
    ("proportional", np.float64),  # gain
    ("integral", np.float64),  # gain
    ("feed_forward", np.float64),  # gain, on the reference or on its rate
    ("supply", np.float64),  # largest voltage [V]
    ("constant", np.float64),  # voltage over speed, and torque over current [V s]
    ("resistance", np.float64),  # [ohm]
    ("limit", np.float64),  # largest current [A]
])
Controllers: TypeAlias = Annotated[np.ndarray, Kind(CONTROLLER, 1)]
Controller: TypeAlias = Annotated[Any, Kind(CONTROLLER, 0)]


class Rotor(NamedTuple):
    """A phase that is a coordinate, turned by a motor and by the loads of its signals; arrays are empty without one.

    Phase and charge are dynamic coordinates with rows of A, which may read the torque T and the held value h.
    T = sum over the signals of (g z) df/dphase. The signals are

        f = a cos(phase - psi) + sqrt(b + a² cos²(phase - psi)),    or the cosine alone where b is negative.

    Attributes
    ----------
    signal : ndarray, shape (signals, 4)
        a, cos(psi), sin(psi) and b.
    load : ndarray, shape (m, signals, channels)
        Rows g.
    load_terms : ndarray of int, shape (m, signals, channels)
        Channels that the rows of `load` read, padded with `NOTHING`.
    current : ndarray, shape (m, channels)
        Row of the charge's rate in an `algebraic` mode.
    current_terms : ndarray of int, shape (m, channels)
        Channels that the rows of `current` read, padded with `NOTHING`.
    algebraic : ndarray of bool, shape (m,)
        Whether the charge's rate is a linear form of the other channels, because no inductance resists its change.
    controller : ndarray of CONTROLLER, shape (1,) or (0,)
        The controller.
    """

    signal: Rows
    load: Rows3
    load_terms: Indices3
    current: Rows
    current_terms: Indices2
    algebraic: Flags
    controller: Controllers


#: A blow that throws a coordinate back from a ramp, or a landing; either changes the velocity of the body.
SHOCK = record([
    ("struck", np.int64), ("plate", np.int64),  # coordinate that is thrown back, and ramp; NOTHING for a landing
    ("impulse", np.float64, (2,)),  # on the body, per unit of the change of the coordinate's speed
    ("lifts", np.bool_),  # whether the body lifts off in a blow
    ("restitution", np.float64),
    ("body", np.int64), ("height", np.int64),  # coordinates along the ground and upwards, or NOTHING
    ("along", np.float64), ("across", np.float64), ("up", np.float64),  # inertia of both, while the phase is held
    ("rotor", np.float64),  # inertia of the phase without the masses of the signals; infinite without a rotor
    ("kinetic", np.float64, (2,)), ("static", np.float64, (2,)),  # coefficients of friction, forwards and backwards
    ("decay_speed", np.float64),  # by which the friction falls from static to kinetic; 0 if it is kinetic at any speed
    ("has_friction", np.bool_), ("has_bearing", np.bool_),  # whether the bearing has states of its own
    ("states", np.int64),  # 1; or 2, forwards and backwards; or 3, at rest as well
])
ShockTable: TypeAlias = Annotated[np.ndarray, Kind(SHOCK, 1)]
ShockNumbers: TypeAlias = Annotated[Any, Kind(SHOCK, 0)]


class Shock(NamedTuple):
    """Shocks that no jump matrix gives: see `solver.shock`; arrays are empty without one.

    The candidates of a shock follow each other: for each of its states one, or two for a bearing that turns forwards
    and one that turns backwards. The shock decides which candidate is entered.

    Attributes
    ----------
    numbers : ndarray of SHOCK, shape (s,)
        Coordinates, inertia and friction.
    direction : ndarray, shape (s, dynamic, 2)
        Direction in which a dynamic coordinate is free in the shock; 0 if the coordinate is not free.
    mass : ndarray, shape (signals,)
        Mass that each signal moves and that feels the body.
    momentum : ndarray, shape (signals, 2)
        That mass times its direction, along the ground and upwards.
    candidate : ndarray of int, shape (m, g, c)
        Number of the shock that leads to a candidate of a guard, or `NOTHING`.
    """

    numbers: ShockTable
    direction: Rows3
    mass: Row
    momentum: Rows
    candidate: Indices3


class AccountTable(NamedTuple):
    """The energy accounts: p powers, e stored energies, b bodies that ramps may strike; all empty without accounts.

    Attributes
    ----------
    force : ndarray, shape (m, p, channels)
        Forms of the forces.
    terms : ndarray of int, shape (m, p, channels)
        Channels that the rows of `force` read, padded with `NOTHING`.
    rate : ndarray of int, shape (p,)
        Channel of the velocity along the force.
    account : ndarray of int, shape (p,)
        Account on which the force's work is booked.
    stored_form : ndarray, shape (e, channels)
        Forms e of the stored energy E = sum of w (e z)² / 2 + b z.
    stored_weight : ndarray, shape (m, e)
        The weights w.
    stored_linear : ndarray, shape (channels,)
        The form b.
    jump : ndarray of int, shape (m, g, e)
        Account on which the change of a stored energy is booked when a guard fires.
    momentum : ndarray, shape (b, channels)
        Momentum of each body along its ramp. The stored energy of the same number is a kinetic energy of the body; all
        its kinetic energies have the same account.
    struck : ndarray of int, shape (b,)
        The ramp that strikes the body.
    """

    force: Rows3
    terms: Indices3
    rate: Indices
    account: Indices
    stored_form: Rows
    stored_weight: Rows
    stored_linear: Row
    jump: Indices3
    momentum: Rows
    struck: Indices


class System(NamedTuple):
    """The tables of a piecewise linear system of m modes."""

    counts: Counts  # one record: numbers of coordinates, signals, ramps and other channels
    equations: Rows3  # rows of A, shape (m, coordinates, channels)
    # Of each mode, shape (m,): a number that modes share whose dynamic coordinates obey the same equations; whether
    # dynamic coordinates enter each other's equations; the longest segment [s] that the series of the flow resolve.
    flow: Indices
    coupled: Flags
    longest_segment: Row
    # Channels that the rows of A read, padded with `NOTHING`; and the same, but for the rows of dynamic coordinates
    # only the forcing of their linear flow.
    reads_all: Indices3
    reads_forcing: Indices3
    guards: GuardTable
    # Mode that follows when the rate of a ramp changes, shape (m, ramps).
    mode_after_ramp_change: Indices2
    events: EventTable
    monitors: MonitorTable
    accounts: AccountTable
    signals: SignalTable
    decay: Decay
    rotor: Rotor
    shock: Shock


@entry
def form_value(row: Row, point: Row) -> float:
    """Value of a linear form at a point."""
    total = 0.0
    for channel in range(len(point)):
        total += row[channel] * point[channel]
    return total


@part
def sparse_magnitude(row: Row, terms: Indices, magnitude: Row) -> float:
    """Magnitude of the terms of a form, sum of |row| magnitude, from the magnitude of each channel's terms; the form
    reads only the channels in `terms`."""
    total = 0.0
    for channel in terms:
        if channel == NOTHING:
            break
        total += abs(row[channel]) * magnitude[channel]
    return total


@part
def value_and_magnitude(row: Row, terms: Indices, point: Row, magnitude: Row) -> tuple[float, float]:
    """Value of a form at a point and the magnitude of its terms; the form reads only the channels in `terms`."""
    total = 0.0
    terms_magnitude = 0.0
    for channel in terms:
        if channel == NOTHING:
            break
        total += row[channel] * point[channel]
        terms_magnitude += abs(row[channel]) * magnitude[channel]
    return total, terms_magnitude
