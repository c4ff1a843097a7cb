"""Where an integration stands: the current segment, its mode, and what its forcing does next."""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.system import Channels, System
from vibro_ros.solver.vector import LENGTH

# Entries of `State.clock`.
START = 0  # instant at which the segment starts [s] ...
START_RESIDUE = 1  # ... and what rounding took from it: an hour of segments must not move the clock
HALF = 2  # half the segment's duration [s]
ENTRANCE = 3  # where in the segment (-1 to 1) its flow ...
ANCHOR = 4  # ... and its mode began
NEXT = 5  # where in the segment the next event is; 1 at its end
OFFSET = 6  # phase from the start of the cell to the segment's [rad]
SPEED = 7  # rate of the phase [rad/s] ...
SPEED_CHANGE = 8  # ... its rate of change [rad/s²] ...
SPEED_TARGET = 9  # ... what it changes to ...
SPEED_TIME = 10  # ... and in how long [s]
LAG = 11  # time constant [s] with which the speed approaches its target instead, or 0
CELL_TIME = 12  # time from the segment's start to the end of the cell [s]
REACH = 13  # duration [s] of a segment that the series of a decaying term may resolve
_CLOCK_ENTRIES = 14

# Entries of `State.index`.
MODE = 0
CELL = 1
TURNS = 2
GUARD = 3  # that fires at NEXT, or NOTHING at the segment's end
SEGMENTS = 4
STANDSTILLS = 5  # events in a row without any progress of time
SLOT = 6  # of `Library` for a segment of this kind
VERSION = 7  # of the forcing: what is driven by the same version over the same cell moves alike
_INDEX_ENTRIES = 8

#: Root of a guard that has not been searched in this segment; smaller than any instant of it.
UNKNOWN = -2.0

# Entries of `State.audit` [J].
ENERGY = 0  # at the segment's start
RESIDUAL = 1  # what the audit cannot account for
EXCHANGED = 2  # sum of the amounts of work
_AUDIT_ENTRIES = 3

# Columns of `State.ramp`.
VALUE = 0
RATE = 1
TARGET = 2
TIME = 3

# Columns of `State.monitor`.
SINCE = 0
APPROACH = 1
PEAK = 2


class Library(NamedTuple):
    """Series that many segments share, by flow and slot: one slot for each cell, the last for all other segments.

    n dynamic coordinates have 2 n components, their positions and then their velocities.

    Attributes
    ----------
    half : ndarray, shape (flows, slots)
        Half the duration [s] that the series belong to; 0 while there are none.
    free : ndarray, shape (flows, slots, 2 n, 2 n, LENGTH)
        Motion without load, from a unit of each component in the middle.
    free_end : ndarray, shape (flows, slots, 2 n, 2 n)
        Its values at the segment's end.
    version : ndarray of int, shape (flows, slots)
        Version of the forcing that the forced motion belongs to; 0 while there is none.
    forced : ndarray, shape (flows, slots, 2 n, LENGTH)
        Motion under the cell's load, from rest at zero in the middle.
    forced_start : ndarray, shape (flows, slots, 2 n)
        Its values at the segment's start.
    """

    half: np.ndarray
    free: np.ndarray
    free_end: np.ndarray
    version: np.ndarray
    forced: np.ndarray
    forced_start: np.ndarray


class State(NamedTuple):
    """The mutable state of an integration.

    Attributes
    ----------
    z : ndarray, shape (channels, LENGTH)
        Polynomials of every channel over the current segment.
    scale : ndarray, shape (channels,)
        Magnitude of the terms that make up each channel, which sets its rounding error.
    clock : ndarray
        Times and phase rates, indexed by this module's constants.
    index : ndarray of int
        Mode, cell, turns, next guard and counts.
    ramp : ndarray, shape (ramps, 4)
        Value, rate, target and time left of each ramp.
    monitor : ndarray, shape (k, 3)
        Start, approach and peak of each monitor that is on.
    audit : ndarray
        The energy audit, indexed by this module's constants.
    root : ndarray, shape (rows,)
        First root of each guard row in the segment, or `UNKNOWN`.
    library : Library
        Series that many segments share.
    defect : ndarray, shape (2, 2 n)
        What the forced motion lacks of the wanted one where a flow begins, and what free motion adds in the middle.
    origin : ndarray, shape (2 coordinates,)
        Positions and velocities where the mode began.
    moments : ndarray, shape (2 LENGTH,)
        Integrals of the powers, for the audit.
    work : ndarray, shape (5, LENGTH)
        Room for temporary polynomials; while a candidate is checked, row 3 holds the scales of its accelerations.
    trial : ndarray, shape (channels,)
        Room for the point that a change of mode would lead to.
    """

    z: np.ndarray
    scale: np.ndarray
    clock: np.ndarray
    index: np.ndarray
    ramp: np.ndarray
    monitor: np.ndarray
    audit: np.ndarray
    root: np.ndarray
    library: Library
    defect: np.ndarray
    origin: np.ndarray
    moments: np.ndarray
    work: np.ndarray
    trial: np.ndarray


def lasting(state: State) -> list[np.ndarray]:
    """The arrays that the future depends on: not the library, whose series come out the same again."""
    return [values for name, values in zip(state._fields, state, strict=True) if name != "library"]


def _empty_library(system: System, channels: Channels) -> Library:
    slots = (int(system.flow.max(initial=0)) + 1, len(system.signals.start))
    components = 2 * channels.dynamic
    return Library(half=np.zeros(slots), free=np.zeros((*slots, components, components, LENGTH)),
                   free_end=np.zeros((*slots, components, components)), version=np.zeros(slots, dtype=np.int64),
                   forced=np.zeros((*slots, components, LENGTH)), forced_start=np.zeros((*slots, components)))


def new_state(system: System, phase_speed: float, ramp_values: np.ndarray, mode: int) -> State:
    """State at time 0 and phase 0; `event_loop.begin_segment` gives it coordinates and its first segment.

    Parameters
    ----------
    system : System
        The system.
    phase_speed : float
        Rate of the phase [rad/s].
    ramp_values : ndarray, shape (ramps,)
        Where the ramps stand.
    mode : int
        A mode whose guards hold, at least just after the start.
    """
    channels = Channels(*(int(size) for size in system.sizes))
    state = State(
        z=np.zeros((channels.count, LENGTH)),
        scale=np.zeros(channels.count),
        clock=np.zeros(_CLOCK_ENTRIES),
        index=np.zeros(_INDEX_ENTRIES, dtype=np.int64),
        ramp=np.zeros((channels.ramps, 4)),
        monitor=np.zeros((system.monitor.shape[1], 3)),
        audit=np.zeros(_AUDIT_ENTRIES),
        root=np.full(len(system.row), UNKNOWN),
        library=_empty_library(system, channels),
        defect=np.zeros((2, 2 * channels.dynamic)),
        origin=np.zeros(2 * channels.coordinates),
        moments=np.zeros(2 * LENGTH),
        work=np.zeros((5, LENGTH)),
        trial=np.zeros(channels.count),
    )
    state.ramp[:, VALUE] = state.ramp[:, TARGET] = ramp_values
    state.clock[[SPEED, SPEED_TARGET]] = phase_speed
    state.clock[REACH] = np.inf
    state.index[MODE] = mode
    state.index[VERSION] = 1
    return state
