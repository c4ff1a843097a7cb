"""The tables of a piecewise linear system with known forcing, which the event loop integrates.

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

import functools
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from vibro_ros.solver.elementary import exp, log
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


class Channels(NamedTuple):
    """Numbers of coordinates and forcing terms, which give the index of each channel in z."""

    coordinates: int
    dynamic: int
    signals: int
    ramps: int
    decays: int = 0  # or 1
    signal_accelerations: int = 0  # or as many as signals
    rotors: int = 0  # or 1: the phase and the charge are the last two dynamic coordinates

    @property
    def count(self) -> int:  # type: ignore[override]
        """Length of z."""
        twice = self.coordinates + self.signals + self.ramps
        return 2 * twice + self.dynamic + self.signal_accelerations + 2 * self.rotors + self.decays + 1

    def position(self, i: int) -> int:
        """Channel of coordinate i."""
        return i

    def velocity(self, i: int) -> int:
        """Channel of coordinate i's time derivative."""
        return self.coordinates + i

    def acceleration(self, i: int) -> int:
        """Channel of dynamic coordinate i's second time derivative."""
        return 2 * self.coordinates + i

    def signal(self, k: int) -> int:
        """Channel of signal k."""
        return 2 * self.coordinates + self.dynamic + k

    def signal_rate(self, k: int) -> int:
        """Channel of signal k's time derivative."""
        return self.signal(self.signals) + k

    def signal_acceleration(self, k: int) -> int:
        """Channel of signal k's second time derivative, if the system has `signal_accelerations`."""
        return self.signal(2 * self.signals) + k

    def ramp(self, k: int) -> int:
        """Channel of ramp k."""
        return self.signal(2 * self.signals) + self.signal_accelerations + k

    def ramp_rate(self, k: int) -> int:
        """Channel of ramp k's time derivative."""
        return self.ramp(self.ramps) + k

    @property
    def phase(self) -> int:
        """Number of the coordinate that is the phase, in a system with a rotor."""
        return self.dynamic - 2

    @property
    def charge(self) -> int:
        """Number of the coordinate that is the charge, whose rate is the motor's current; with a rotor only."""
        return self.dynamic - 1

    @property
    def torque(self) -> int:
        """Channel of the torque on the phase by the loads of the signals; with a rotor only."""
        return self.ramp_rate(self.ramps)

    @property
    def held(self) -> int:
        """Channel of the voltage or current that the motor is held at until its next sample; with a rotor only."""
        return self.torque + 1

    @property
    def decay(self) -> int:
        """Channel of the decaying term."""
        return self.count - 2

    @property
    def one(self) -> int:
        """Channel of the constant 1."""
        return self.count - 1


#: `Channels` as kernels read it: `system.counts[0].coordinates`.
COUNTS = record([(name, np.int64) for name in Channels._fields])
Counts: TypeAlias = Annotated[np.ndarray, Kind(COUNTS, 1)]
Count: TypeAlias = Annotated[Any, Kind(COUNTS, 0)]


def counts_of(channels: Channels) -> np.ndarray:
    """Return `System.counts` of a system with these channels."""
    return np.array([tuple(channels)], COUNTS)


def channels_of(counts: np.ndarray) -> Channels:
    """Return the `Channels` of a system with this `System.counts`."""
    return Channels(*(int(number) for number in counts[0]))


# First channels of each kind, for kernels, which cannot call methods.


@part
def first_acceleration(counts: Count) -> int:
    """Channel of the first dynamic coordinate's acceleration."""
    return 2 * counts.coordinates


@part
def first_signal(counts: Count) -> int:
    """Channel of the first signal; those of the signals' rates, and of their accelerations, follow the signals."""
    return 2 * counts.coordinates + counts.dynamic


@part
def first_ramp(counts: Count) -> int:
    """Channel of the first ramp; those of the ramps' rates follow the ramps."""
    return 2 * counts.coordinates + counts.dynamic + 2 * counts.signals + counts.signal_accelerations


#: Half a segment over the distance to the signals' nearest singularity, because 0.225^LENGTH is rounding. With 0.22 a
#: cell of the shipped mechanism would take three segments in place of two.
STRIDE = 0.225
#: Half a cell over the distance from its middle to that singularity; economization leaves out 4.2^-LENGTH, rounding.
CELL_STRIDE = 0.45
#: Half the longest segment in units of the mode's fastest time constant: 1.7^LENGTH / LENGTH! is below rounding.
RATE_LIMIT = 1.7
#: Entry of a table that means no row, no jump, no monitor, no event, or no (more) candidates.
NOTHING = -1
#: `System.guard_effect` of a guard whose candidates need not satisfy any guard.
UNCHECKED = -2


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
    """The tables of a piecewise linear system; m modes of at most g guards with c candidates, k monitors.

    Attributes
    ----------
    counts : ndarray of COUNTS, shape (1,)
        Numbers of coordinates, dynamic coordinates, signals, ramps, decaying terms and accelerations of signals.
    equations : ndarray, shape (m, coordinates, channels)
        Rows of A.
    flow : ndarray of int, shape (m,)
        Equal for modes whose dynamic coordinates obey the same equations.
    coupled : ndarray of bool, shape (m,)
        Whether dynamic coordinates enter each other's equations.
    longest_segment : ndarray, shape (m,)
        Longest segment [s] that the series of the mode's flow resolves to rounding.
    reads_all : ndarray of int, shape (m, coordinates, channels)
        Channels that the rows of A read, padded with `NOTHING`.
    reads_forcing : ndarray of int, shape (m, coordinates, channels)
        As `reads_all`, but for the rows of dynamic coordinates only the forcing of their linear flow.
    row : ndarray, shape (rows, channels)
        Distinct rows of G.
    row_terms : ndarray of int, shape (rows, channels)
        Channels that the rows of G read, padded with `NOTHING`.
    driven : ndarray of bool, shape (rows,)
        Whether the row reads a coordinate that is not dynamic.
    guard : ndarray of int, shape (m, g)
        Row of each guard of each mode, padded with `NOTHING`.
    guard_effect : ndarray of int, shape (m, g)
        Effect that the guard belongs to, padded with `NOTHING`. A candidate must satisfy its own guards of the same
        effect, because only this effect changes. `UNCHECKED`: the candidates' `entry` rows alone decide.
    candidate : ndarray of int, shape (m, g, c)
        Modes to try when the guard fires, padded with `NOTHING`; the last is entered when no other is valid. A guard
        without a candidate ends the system: the caller goes on with another one.
    entry : ndarray of int, shape (m, g, c, n)
        Rows that must not be negative, before the jump, for the candidate to be entered, padded with `NOTHING`.
    jump : ndarray of int, shape (m, g, c)
        Number of the `jump_matrix` by which the coordinates jump on the way to the candidate, or `NOTHING`.
    jump_matrix : ndarray, shape (jumps, 2 coordinates, channels)
        Rows of the positions and velocities after a jump.
    blow_monitor : ndarray of int, shape (m, g)
        Monitor for which the guard records a blow without duration, or `NOTHING`.
    guard_event : ndarray of int, shape (m, g)
        Kind of the event recorded when the guard fires and `event_kind` has none, or `NOTHING`.
    mode_after_ramp_change : ndarray of int, shape (m, k)
        Mode that follows when the rate of ramp k changes.
    event_kind : ndarray of int, shape (m, m)
        Kind of the event recorded when the mode changes from the first to the second, or `NOTHING`.
    event_quantity : ndarray, shape (kinds, channels)
        Row of the quantity recorded with an event of that kind, before the jump.
    monitor : ndarray, shape (m, k, channels)
        Rows of the quantities whose peaks are recorded while their monitor is on, such as contact forces.
    monitor_terms : ndarray of int, shape (m, k, channels)
        Channels that the rows of `monitor` read, padded with `NOTHING`.
    monitored : ndarray of bool, shape (m, k)
        Whether monitor k is on in the mode.
    approach : ndarray, shape (k, channels)
        Row of the quantity recorded when the monitor is switched on, such as the approach speed.
    accounts : AccountTable
        The energy accounts.
    signals : SignalTable
        The periodic signals.
    decay : Decay
        The decaying term.
    rotor : Rotor
        The phase as a coordinate.
    shock : Shock
        The shocks that no jump matrix gives.
    """

    counts: Counts
    equations: Rows3
    flow: Indices
    coupled: Flags
    longest_segment: Row
    reads_all: Indices3
    reads_forcing: Indices3
    row: Rows
    row_terms: Indices2
    driven: Flags
    guard: Indices2
    guard_effect: Indices2
    candidate: Indices3
    entry: Indices4
    jump: Indices3
    jump_matrix: Rows3
    blow_monitor: Indices2
    guard_event: Indices2
    mode_after_ramp_change: Indices2
    event_kind: Indices2
    event_quantity: Rows
    monitor: Rows3
    monitor_terms: Indices3
    monitored: Flags2
    approach: Rows
    accounts: AccountTable
    signals: SignalTable
    decay: Decay
    rotor: Rotor
    shock: Shock



def no_rotor(count: int) -> Rotor:
    """Return `System.rotor` of a system of `count` channels whose phase is known in time."""
    forms, row = np.empty((0, 0, count)), np.empty((0, count))
    return Rotor(np.empty((0, 4)), forms, terms(forms), row, terms(row), np.empty(0, bool), np.empty(0, CONTROLLER))


def no_shock() -> Shock:
    """Return `System.shock` of a system whose jumps are all linear forms."""
    return Shock(np.empty(0, SHOCK), np.empty((0, 0, 2)), np.empty(0), np.empty((0, 2)),
                 np.empty((0, 0, 0), dtype=np.int64))


def terms(forms: np.ndarray) -> np.ndarray:
    """Return the indices of the nonzero entries of each form, padded with `NOTHING`; shape as `forms`."""
    return _terms_by_zeros((forms == 0.0).tobytes(), forms.shape)


@functools.lru_cache(maxsize=64)
def _terms_by_zeros(zeros: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """Return `terms` of forms with these zeros; cached, because all systems of a sweep have the same zeros."""
    zero = np.frombuffer(zeros, dtype=bool).reshape(shape)
    order = np.argsort(zero, axis=-1, kind="stable")
    return np.where(np.take_along_axis(zero, order, axis=-1), NOTHING, order)


def equation_terms(acceleration: np.ndarray, channels: Channels) -> np.ndarray:
    """Return `System.reads_forcing` of `System.equations`.

    Raises
    ------
    ValueError
        If a dynamic coordinate's row reads a driven coordinate or an acceleration, which the flow does not contain: the
        equations must have these eliminated.
    """
    forcing = acceleration.copy()
    read = np.asarray(acceleration[:, :channels.dynamic, :channels.signal(0)].any(axis=(0, 1)))
    read[:channels.dynamic] = read[channels.velocity(0):channels.velocity(channels.dynamic)] = False
    if read.any():
        raise ValueError(f"rows of dynamic coordinates read channels {np.flatnonzero(read)}, which no flow sees")
    if channels.decays:
        forcing[:, :channels.dynamic, channels.decay] = 0.0
    forcing[:, :channels.dynamic, :channels.signal(0)] = 0.0
    return terms(forcing)


def longest_segments(acceleration: np.ndarray, channels: Channels) -> np.ndarray:
    """Return the longest segment of each mode [s], from the fastest eigenvalue of its dynamic coordinates.

    Parameters
    ----------
    acceleration : ndarray, shape (m, coordinates, channels)
        Rows of A.
    channels : Channels
        Layout of the rows.

    Returns
    -------
    ndarray, shape (m,)
        Infinite for a mode without an eigenvalue other than zero.
    """
    positions, velocities = _own_rows(acceleration, channels)
    numbers = flow_numbers(np.concatenate([positions, velocities], axis=2))
    first = np.unique(numbers, return_index=True)[1]
    with np.errstate(divide="ignore"):
        return (2.0 * RATE_LIMIT / fastest_rates(positions[first], velocities[first]))[numbers]


def fastest_rates(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return the fastest eigenvalue of each mode [1/s], or a close upper bound where coordinates are coupled.

    Parameters
    ----------
    positions : ndarray, shape (m, n, n)
        K [1/s²] of the equations q'' = K q + C q' of each mode's n coordinates.
    velocities : ndarray, shape (m, n, n)
        C [1/s] of these equations.

    Returns
    -------
    ndarray, shape (m,)
        0 for a mode without an eigenvalue other than zero.
    """
    fastest, coupled = _fastest_own_rates(positions, velocities), _are_coupled(positions, velocities)
    if coupled.any():
        fastest[coupled] = _fastest_coupled_rates(positions[coupled], velocities[coupled])
    return fastest


def _fastest_own_rates(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return the fastest eigenvalue of each mode [1/s], as if no coordinate entered the equation of another one.

    Coordinate i has the equation q'' = k q + c q', with k = positions[:, i, i] and c = velocities[:, i, i].
    """
    own = np.arange(positions.shape[1])
    k, half = positions[:, own, own], abs(0.5 * velocities[:, own, own])
    square = half * half + k
    oscillates = square < 0.0
    rates = np.sqrt(np.where(oscillates, -k, square)) + np.where(oscillates, 0.0, half)
    return rates.max(axis=1, initial=0.0)


# The bound by the power 2^n is too large by the 2^n-th root of the condition of the matrix, some tenths of a percent.
_SQUARINGS = 10


def _fastest_coupled_rates(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return a close upper bound of the fastest eigenvalue of each mode [1/s].

    No eigenvalue of a matrix exceeds the k-th root of a norm of its k-th power, and this root converges to the largest
    one as k grows (I. Gelfand). Powers need only products and sums, whose order is fixed, unlike LAPACK's.
    """
    n = positions.shape[1]
    scale = np.sqrt(abs(positions).max(axis=(1, 2)))[:, None, None]  # of the rates, so that all entries are comparable
    scale[scale == 0.0] = 1.0
    power = np.zeros((len(positions), 2 * n, 2 * n))
    power[:, :n, n:], power[:, n:, :n], power[:, n:, n:] = np.eye(n) * scale, positions / scale, velocities
    exponent, share = np.zeros(len(power)), 1.0
    for _ in range(_SQUARINGS):
        size = abs(power).max(axis=(1, 2))
        exponent += share * np.array([log(number) for number in size.tolist()])
        power /= np.where(size > 0.0, size, 1.0)[:, None, None]
        power = np.asarray(sum(power[:, :, j, None] * power[:, None, j, :] for j in range(2 * n)))
        share *= 0.5
    norm = 2 * n * abs(power).max(axis=(1, 2))  # at least the sum of any row's magnitudes
    return np.array([exp(one + share * log(number)) for one, number in zip(
        exponent.tolist(), norm.tolist(), strict=True)])


def couplings(acceleration: np.ndarray, channels: Channels) -> np.ndarray:
    """Return whether a dynamic coordinate of the mode enters the equation of another one; shape (m,)."""
    return _are_coupled(*_own_rows(acceleration, channels))


def _are_coupled(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Return whether a coordinate enters the equation of another one in each mode; shape (m,)."""
    different = ~np.eye(positions.shape[1], dtype=bool)
    return np.asarray(positions[:, different].any(axis=1) | velocities[:, different].any(axis=1))


def _own_rows(acceleration: np.ndarray, channels: Channels) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts of A by which dynamic coordinates depend on each other's positions and velocities."""
    n, velocity = channels.dynamic, channels.velocity(0)
    return acceleration[:, :n, :n], acceleration[:, :n, velocity:velocity + n]


def flow_numbers(equations: np.ndarray) -> np.ndarray:
    """Return a number for each mode, shape (m,), equal for equal `equations`, shape (m, rows, channels)."""
    numbers: dict[bytes, int] = {}
    return np.array([numbers.setdefault(rows.tobytes(), len(numbers)) for rows in equations])


@entry
def form_value(row: Row, point: Row) -> float:
    """Value of a linear form at a point."""
    total = 0.0
    for channel in range(len(point)):
        total += row[channel] * point[channel]
    return total


@part
def form_magnitude(row: Row, magnitude: Row) -> float:
    """Magnitude of the terms of a form, sum of |row| magnitude, from the magnitude of each channel's terms."""
    total = 0.0
    for channel in range(len(row)):
        total += abs(row[channel]) * magnitude[channel]
    return total


@part
def sparse_magnitude(row: Row, terms: Indices, magnitude: Row) -> float:
    """`form_magnitude` of a form that reads only the channels in `terms`."""
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
