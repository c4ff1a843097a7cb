"""Where an integration stands: the current segment, its mode, and what its forcing does next."""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.polynomial import LENGTH
from vibro_ros.solver.system import Channels, System

# Entries of `State.clock`.
START = 0  # instant at which the segment starts [s] ...
START_RESIDUE = 1  # ... and what rounding took from it: an hour of segments must not move the clock
DURATION = 2  # of the segment [s]
ANCHOR = 3  # where in the segment (0 to 1) the mode began
NEXT = 4  # where in the segment the next event is; 1 at its end
OFFSET = 5  # phase past the start of the cell [rad]
SPEED = 6  # rate of the phase [rad/s] ...
SPEED_CHANGE = 7  # ... its rate of change [rad/s²] ...
SPEED_TARGET = 8  # ... what it changes to ...
SPEED_TIME = 9  # ... and in how long [s]
LAG = 10  # time constant [s] with which the speed approaches its target instead, or 0
CELL_TIME = 11  # time from the segment's start to the end of the cell [s]
_CLOCK_ENTRIES = 12

# Entries of `State.index`.
MODE = 0
CELL = 1
TURNS = 2
GUARD = 3  # that fires at NEXT, or NOTHING at the segment's end
SEGMENTS = 4
STANDSTILLS = 5  # events in a row without any progress of time
_INDEX_ENTRIES = 6

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
        First root of each guard row in the segment, or a negative number while it is not known.
    work : ndarray, shape (4, LENGTH)
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
    work: np.ndarray
    trial: np.ndarray


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
        root=np.full(len(system.row), -1.0),
        work=np.zeros((4, LENGTH)),
        trial=np.zeros(channels.count),
    )
    state.ramp[:, VALUE] = state.ramp[:, TARGET] = ramp_values
    state.clock[[SPEED, SPEED_TARGET]] = phase_speed
    state.index[MODE] = mode
    return state
