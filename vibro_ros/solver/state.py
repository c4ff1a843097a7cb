"""The state of an integration: its segment, its mode, and its forcing.

Times within a segment are *local times* x: -1 at the segment's start, 1 at its end.

A cell, a segment and a mode each have a start of their own. A flow starts with a segment, and goes on in those that
follow:

    cell      |==============================================================|   part of the phase's turn
    segment        |==========================================|                  x = -1 ... 1: one polynomial a channel
    mode                      |===============================                   all equations, and the guards
              ^    ^          ^                       ^
              |    |          mode_start              next_event: the first guard turns negative
              |    start [s]; drive.offset [rad] after the cell's start
"""

from collections.abc import Iterable
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from vibro_ros.solver.channels import channels_of
from vibro_ros.solver.drive import DRIVE, Drive, command_drive
from vibro_ros.solver.system import System
from vibro_ros.solver.typed import Kind, Row, Rows, Rows3, Rows4, record
from vibro_ros.solver.vector import LENGTH

#: Largest number of dynamic coordinates of a system.
MOST_DYNAMIC = 8

#: The present segment.
SEGMENT = record([
    ("start", np.float64),  # instant [s] of the local time -1 ...
    ("residue", np.float64),  # ... and the rounding error of its sum, so that the clock is exact after hours
    ("half", np.float64),  # half the duration [s]
    ("mode_start", np.float64),  # local time at which the mode started
    ("next_event", np.float64),  # local time of the next event: of the first root of a guard, else 1
    ("cell_left", np.float64),  # time [s] from the segment's start to the cell's end
])

#: The present mode.
AUTOMATON = record([
    ("mode", np.int64),  # the present mode
    ("guard", np.int64),  # the mode's guard that turns negative at `next_event`, or `NOTHING`
    ("begins", np.int64),  # whether mode or flow begins next: see `event_loop.FLOW_BEGINS`
    ("events_without_progress", np.int64),  # events in a row at one instant
    ("segments", np.int64),  # number of segments solved since the state was made
])

#: Largest number of accounts of a system.
MOST_ACCOUNTS = 12

#: The energy accounts [J].
ACCOUNTS = record([
    ("booked", np.float64),  # local time up to which the present flow is booked
    ("stored", np.float64),  # energy stored at the start
    ("magnitude", np.float64),  # integral of the magnitude of the motor's power, so far
    ("work", np.float64, (MOST_ACCOUNTS,)),  # on each account, so far
])

#: The motor of a rotor, with its command.
MOTOR = record([
    ("target", np.float64),  # commanded speed [rad/s], or voltage [V]
    ("reference", np.float64),  # speed [rad/s] that the controller follows, at the instant ...
    ("since", np.float64),  # ... [s], after which ...
    ("slope", np.float64),  # ... it changes at this rate [rad/s²] until it is at the target
    ("integral", np.float64),  # of the controller, before the next sample ...
    ("before", np.float64),  # ... and before the last sample
    ("held", np.float64),  # voltage [V] or current [A] until the next sample
    ("samples", np.int64),  # number taken so far; the next one is due after this many periods
])

#: Record of `State.now`. A kernel reads a field as `state.segment.half`, Python as `state.now["segment"]["half"][0]`.
NOW = record([("segment", SEGMENT), ("drive", DRIVE), ("automaton", AUTOMATON), ("accounts", ACCOUNTS),
                 ("motor", MOTOR)])

#: Record of each ramp in `State.ramp`.
RAMP = record([
    ("value", np.float64),  # at the segment's start
    ("rate", np.float64),  # per second; 0 at rest
    ("target", np.float64),
    ("time_left", np.float64),  # time [s] until it is at its target
])

#: Record of each monitor in `State.monitor`, valid while the monitor is on.
MONITOR = record([
    ("since", np.float64),  # instant [s] at which the monitor was switched on
    ("approach", np.float64),  # value of `System.monitors.approach` at that instant
    ("peak", np.float64),  # largest value since then
])

#: Record of each low-pass filter in `State.lowpass`: see `lowpass`.
LOWPASS = record([
    ("channel", np.int64),  # whose rate is filtered
    ("rate", np.float64),  # magnitude [1/s] of the filter's poles; the same for all filters of a state
    ("in_phase", np.float64),  # the filter's complex state, in the unit of the channel ...
    ("quadrature", np.float64),
    ("value", np.float64),  # the channel at the instant that the filter has reached ...
    ("reached", np.float64),  # ... and the local time of that instant, or `UNKNOWN` if the mode has just begun
])

# Types of kernels' arguments: one record, and arrays of records.
Segment: TypeAlias = Annotated[Any, Kind(SEGMENT, 0)]
Automaton: TypeAlias = Annotated[Any, Kind(AUTOMATON, 0)]
Accounts: TypeAlias = Annotated[Any, Kind(ACCOUNTS, 0)]
Motor: TypeAlias = Annotated[Any, Kind(MOTOR, 0)]
Ramp: TypeAlias = Annotated[Any, Kind(RAMP, 0)]
Monitor: TypeAlias = Annotated[Any, Kind(MONITOR, 0)]
Filter: TypeAlias = Annotated[Any, Kind(LOWPASS, 0)]
Now: TypeAlias = Annotated[np.ndarray, Kind(NOW, 1)]
Ramps: TypeAlias = Annotated[np.ndarray, Kind(RAMP, 1)]
Monitors: TypeAlias = Annotated[np.ndarray, Kind(MONITOR, 1)]
Filters: TypeAlias = Annotated[np.ndarray, Kind(LOWPASS, 1)]

#: Largest number of a rotor's signals: two sliders, and a pin's two directions. Rows for series: three of the phase,
#: five of each signal, two of a decaying term, and two for the responses to the phase's acceleration and to that term.
MOST_ROTOR_SIGNALS = 4
SERIES = 3 + 5 * MOST_ROTOR_SIGNALS + 4


class Scratch(NamedTuple):
    """Room for intermediate results of a kernel; nothing in it outlasts the call that fills it.

    Attributes
    ----------
    load : ndarray, shape (MOST_DYNAMIC, LENGTH)
        Loads of the dynamic coordinates.
    free_at_start : ndarray, shape (2 * MOST_DYNAMIC,)
        For `flow`: components of the free motion at the segment's start ...
    free_at_middle : ndarray, shape (2 * MOST_DYNAMIC,)
        ... and in its middle.
    terms : ndarray, shape (2, 2 * MOST_DYNAMIC)
        One term of each component's series, and the next.
    shift : ndarray, shape (LENGTH,)
        Shift of the phase by the change of its speed ...
    displaced : ndarray, shape (2 * LENGTH,)
        ... and a signal whose argument is shifted by it.
    acceleration : ndarray, shape (LENGTH,)
        Acceleration of a driven coordinate.
    guard : ndarray, shape (LENGTH,)
        Guard whose root is searched.
    search : ndarray, shape (2, LENGTH)
        For `guards.first_root`.
    peak : ndarray, shape (LENGTH,)
        Quantity whose peak is searched.
    peak_search : ndarray, shape (3, LENGTH)
        For `guards.maximum`.
    force : ndarray, shape (LENGTH,)
        Force whose power the accounts need.
    power : ndarray, shape (LENGTH,)
        For `energy`: the motor's power at the nodes of a flow ...
    part_power : ndarray, shape (LENGTH,)
        ... and of a part in which it keeps its sign.
    lowpass_rate : ndarray, shape (LENGTH,)
        For `lowpass`: rate of a channel, ...
    lowpass_response : ndarray, shape (2, LENGTH)
        ... and the response to a step, real and imaginary.
    series : ndarray, shape (SERIES, LENGTH + 1)
        Series of `rotor` and `taylor`, ...
    mirrored : ndarray, shape (SERIES, 2 * LENGTH)
        ... and those of `rotor` in reverse order.
    magnitude : ndarray, shape (channels,)
        Magnitude of the terms that make up each channel at a point.
    after : ndarray, shape (channels,)
        All channels after an event.
    """

    load: Rows
    free_at_start: Row
    free_at_middle: Row
    terms: Rows
    shift: Row
    displaced: Row
    acceleration: Row
    guard: Row
    search: Rows
    peak: Row
    peak_search: Rows
    force: Row
    power: Row
    part_power: Row
    lowpass_rate: Row
    lowpass_response: Rows
    series: Rows
    mirrored: Rows
    magnitude: Row
    after: Row


class Library(NamedTuple):
    """Series that many segments share, by flow.

    n dynamic coordinates have 2 n components, their positions and then their velocities.

    Attributes
    ----------
    half : ndarray, shape (flows,)
        Half the duration [s] of the flow's longest segment, over which its free motions are solved; 0 until they are.
    free : ndarray, shape (flows, 2 n, 2 n, LENGTH)
        Motions without load, from a unit of each component in the middle.
    free_end : ndarray, shape (flows, 2 n, 2 n)
        Values of `free` at the segment's end.
    forced : ndarray, shape (2 n, LENGTH)
        Room for the motion under the present segment's loads.
    """

    half: Row
    free: Rows4
    free_end: Rows3
    forced: Rows


class State(NamedTuple):
    """The mutable state of an integration; fields of records are explained where their types are defined.

    Attributes
    ----------
    z : ndarray, shape (channels, LENGTH)
        Polynomials of every channel over the present segment.
    magnitude : ndarray, shape (channels,)
        Magnitude of the terms that make up each channel, which sets the channel's rounding error.
    now : ndarray of NOW, shape (1,)
        The present segment, drive and mode, the energy accounts, and the motor.
    ramp : ndarray of RAMP, shape (ramps,)
        The ramps at the segment's start.
    mode_point : ndarray, shape (2 coordinates,)
        Positions and velocities at the mode's start.
    root : ndarray, shape (rows,)
        First root of each guard row in the segment, or `UNKNOWN`.
    monitor : ndarray of MONITOR, shape (k,)
        The monitors.
    lowpass : ndarray of LOWPASS, shape (filters,)
        The low-pass filters; none unless they are asked for.
    library : Library
        Series that many segments share.
    scratch : Scratch
        Room for intermediate results of a kernel.
    """

    z: Rows
    magnitude: Row
    now: Now
    ramp: Ramps
    mode_point: Row
    root: Row
    monitor: Monitors
    lowpass: Filters
    library: Library
    scratch: Scratch

    @property
    def segment(self) -> Segment:
        """The record `now` has of this name."""
        return self.now[0].segment

    @property
    def drive(self) -> Drive:
        """The record `now` has of this name."""
        return self.now[0].drive

    @property
    def automaton(self) -> Automaton:
        """The record `now` has of this name."""
        return self.now[0].automaton

    @property
    def accounts(self) -> Accounts:
        """The record `now` has of this name."""
        return self.now[0].accounts

    @property
    def motor(self) -> Motor:
        """The record `now` has of this name."""
        return self.now[0].motor


#: Root of a guard that has not been searched in this segment; smaller than any local time.
UNKNOWN = -2.0


def numbers_of(arrays: Iterable[np.ndarray]) -> list[np.ndarray]:
    """Return the arrays, with each array of records replaced by views of its fields, down to arrays of numbers."""
    parts: list[np.ndarray] = []
    for array in arrays:
        parts += numbers_of(array[field] for field in array.dtype.names) if array.dtype.names else [array]
    return parts


def lasting(state: State) -> list[np.ndarray]:
    """Return the arrays of numbers, as views, on which the future of `state` depends.

    The library is left out, because its series would be solved again with the same result, and so is the scratch.
    """
    return numbers_of(getattr(state, name) for name in state._fields if name not in ("library", "scratch"))


def _empty_library(system: System) -> Library:
    components = 2 * int(system.counts["dynamic"][0])
    flows = int(system.flow.max(initial=0)) + 1
    if len(system.rotor.controller):  # flows are not linear, so that no series is shared
        flows = 0
    return Library(half=np.zeros(flows), free=np.zeros((flows, components, components, LENGTH)),
                   free_end=np.zeros((flows, components, components)), forced=np.zeros((components, LENGTH)))


def _scratch(channels: int) -> Scratch:
    return Scratch(
        load=np.zeros((MOST_DYNAMIC, LENGTH)),
        free_at_start=np.zeros(2 * MOST_DYNAMIC),
        free_at_middle=np.zeros(2 * MOST_DYNAMIC),
        terms=np.zeros((2, 2 * MOST_DYNAMIC)),
        shift=np.zeros(LENGTH),
        displaced=np.zeros(2 * LENGTH),
        acceleration=np.zeros(LENGTH),
        guard=np.zeros(LENGTH),
        search=np.zeros((2, LENGTH)),
        peak=np.zeros(LENGTH),
        peak_search=np.zeros((3, LENGTH)),
        force=np.zeros(LENGTH),
        power=np.zeros(LENGTH),
        part_power=np.zeros(LENGTH),
        lowpass_rate=np.zeros(LENGTH),
        lowpass_response=np.zeros((2, LENGTH)),
        series=np.zeros((SERIES, LENGTH + 1)),
        mirrored=np.zeros((SERIES, 2 * LENGTH)),
        magnitude=np.zeros(channels),
        after=np.zeros(channels),
    )


def new_state(system: System, phase_speed: float, ramp_values: np.ndarray, mode: int) -> State:
    """Return a state at time 0 and phase 0; `event_loop.begin_segment` gives it coordinates and a first segment.

    Parameters
    ----------
    system : System
        The system.
    phase_speed : float
        Rate of the phase [rad/s], below 0 backwards.
    ramp_values : ndarray, shape (ramps,)
        Values of the ramps.
    mode : int
        A mode whose guards hold, at least just after the start.

    Raises
    ------
    ValueError
        For a system of more than `MOST_DYNAMIC` dynamic coordinates.
    """
    channels = channels_of(system.counts)
    if channels.dynamic > MOST_DYNAMIC:
        raise ValueError(f"the system has {channels.dynamic} dynamic coordinates; give at most {MOST_DYNAMIC}")
    state = State(
        z=np.zeros((channels.count, LENGTH)),
        magnitude=np.zeros(channels.count),
        now=np.zeros(1, NOW),
        ramp=np.zeros(channels.ramps, RAMP),
        mode_point=np.zeros(2 * channels.coordinates),
        root=np.full(len(system.guards.form), UNKNOWN),
        monitor=np.zeros(system.monitors.quantity.shape[1], MONITOR),
        lowpass=np.zeros(0, LOWPASS),
        library=_empty_library(system),
        scratch=_scratch(channels.count),
    )
    state.ramp["value"] = state.ramp["target"] = ramp_values
    drive = state.now["drive"]
    drive["direction"] = 1
    command_drive(system.signals, drive[0], phase_speed, phase_speed)
    state.now["automaton"]["mode"] = mode
    return state
