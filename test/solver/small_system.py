"""Systems of a few rows, built by hand, so that the solver is tested without a robot."""

import math
from dataclasses import dataclass, field

import numpy as np

from vibro_ros.solver import event_loop
from vibro_ros.solver.channels import counts_of
from vibro_ros.solver.equations import (
    couplings,
    equation_terms,
    flow_numbers,
    longest_segments,
    no_rotor,
    no_shock,
    terms,
)
from vibro_ros.solver.events import EVENT_COLUMNS
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.methods import Exact
from vibro_ros.solver.state import new_state
from vibro_ros.solver.system import (
    NOTHING,
    AccountTable,
    Decay,
    EventTable,
    GuardTable,
    MonitorTable,
    SignalTable,
    System,
)
from vibro_ros.solver.vector import LENGTH


@dataclass(frozen=True)
class Guard:
    """A guard form >= 0. When it turns negative, the first of `targets` that holds is entered, after the jump (channel
    to form). If `strike` is true, the event is a blow on monitor 0. `entry` is a form that the first target requires to
    be non-negative before the jump.
    """

    form: np.ndarray
    targets: tuple[int, ...]
    jump: dict[int, np.ndarray] = field(default_factory=dict)
    first_jump: dict[int, np.ndarray] | None = None
    entry: np.ndarray | None = None
    strike: bool = False


def cosine_table(cells=8):
    """cos(phase) as the only signal."""
    start = 2 * math.pi * np.arange(cells + 1) / cells
    order = np.arange(LENGTH)
    factorial = np.cumprod(np.maximum(order, 1.0))
    middle, half = 0.5 * (start[:-1] + start[1:]), 0.5 * np.diff(start)
    series = np.cos(middle[:, None] + order * math.pi / 2) * half[:, None] ** order / factorial
    return SignalTable(start, np.full(cells, 3.5), series[:, None, :])


def build(channels, modes, guards=(), signals=None, monitor=None, decay=None):
    """Build a system whose mode m has the rows `modes[m]` and the guards `guards[m]`; entering mode m is event m.
    `monitor` has the form that is observed, the form that is noted at its start, and the modes in which it is on.
    `decay` has factor and rate of the decaying term for each mode.
    """
    count = len(modes)
    acceleration = np.array(modes, dtype=float).reshape(count, channels.coordinates, channels.count)
    guards = guards or [()] * count
    most = max(1, *map(len, guards))
    row, matrices = [], []
    number, effect, blow = (np.full((count, most), NOTHING) for _ in range(3))
    candidate, jump = (np.full((count, most, 3), NOTHING) for _ in range(2))
    entry = np.full((count, most, 3, 1), NOTHING)
    for m, of_mode in enumerate(guards):
        for g, guard in enumerate(of_mode):
            number[m, g], effect[m, g] = len(row), 0
            row.append(guard.form)
            blow[m, g] = 0 if guard.strike else NOTHING
            candidate[m, g, :len(guard.targets)] = guard.targets
            for c in range(len(guard.targets)):
                jumps = guard.first_jump if c == 0 and guard.first_jump is not None else guard.jump
                if jumps:
                    jump[m, g, c] = len(matrices)
                    matrices.append(np.eye(2 * channels.coordinates, channels.count))
                    for channel, form in jumps.items():
                        matrices[-1][channel] = form
            if guard.entry is not None:
                entry[m, g, 0, 0] = len(row)
                row.append(guard.entry)
    row = np.array(row).reshape(len(row), channels.count)
    driven = np.zeros(channels.count, dtype=bool)
    driven[channels.dynamic:channels.coordinates] = True
    driven[channels.coordinates + channels.dynamic:2 * channels.coordinates] = True
    event = np.tile(np.arange(count), (count, 1))
    np.fill_diagonal(event, NOTHING)
    watched = 0 if monitor is None else 1
    watch = np.zeros((count, 0, channels.count)) if monitor is None else np.tile(monitor[0], (count, 1, 1))
    return System(
        counts=counts_of(channels), equations=acceleration, reads_all=terms(acceleration),
        reads_forcing=equation_terms(acceleration, channels),
        flow=flow_numbers(acceleration[:, :channels.dynamic] if decay is None else acceleration),
        longest_segment=longest_segments(acceleration, channels),
        coupled=couplings(acceleration, channels),
        guards=GuardTable(
            form=row, terms=terms(row), driven=row[:, driven].any(axis=1), row=number, effect=effect,
            candidate=candidate, entry=entry, jump=jump, blow_monitor=blow, event=np.full_like(blow, NOTHING),
            jump_matrix=np.array(matrices).reshape(len(matrices), 2 * channels.coordinates, channels.count)),
        mode_after_ramp_change=np.tile(np.arange(count)[:, None], (1, channels.ramps)),
        events=EventTable(event, np.zeros((count, channels.count))),
        monitors=MonitorTable(
            watch, terms(watch),
            np.array([[m in monitor[2]] * watched if monitor else [] for m in range(count)], dtype=bool),
            np.zeros((0, channels.count)) if monitor is None else np.array([monitor[1]])),
        accounts=_no_accounts(count, most, channels),
        signals=signals or SignalTable(np.array([0.0, 2 * math.pi]), np.full(1, 3.5), np.zeros((1, 0, LENGTH))),
        decay=_decay(channels, decay), rotor=no_rotor(channels.count), shock=no_shock())


def _no_accounts(modes, guards, channels):
    form, none = np.zeros((0, channels.count)), np.zeros(0, dtype=int)
    force = np.zeros((modes, 0, channels.count))
    return AccountTable(force=force, terms=terms(force), rate=none, account=none, stored_form=form,
                        stored_weight=np.zeros((modes, 0)), stored_linear=np.zeros(channels.count),
                        jump=np.zeros((modes, guards, 0), dtype=int), momentum=form, struck=none)


def _decay(channels, decay):
    factors, rates = decay or ((), ())
    factors = np.array(factors, dtype=float).reshape(len(rates), channels.count)
    return Decay(np.array([channels.coordinates - 1] * bool(rates), np.int64), factors, terms(factors),
                 np.array(rates, dtype=float))


class Integration:
    """A system under way.

    Parameters
    ----------
    system : System
    position, velocity : sequence of float
        Coordinates and rates at t = 0.
    mode : int
    speed : float
        Rate of the phase [rad/s].
    ramps : sequence of float
        Where the ramps stand.
    """

    def __init__(self, system, position=(), velocity=(), mode=0, speed=0.0, ramps=()):
        self._stepper = Exact(Laid(system))
        self.state = new_state(system, speed, np.array(ramps, dtype=float), mode)
        self.point = np.zeros(len(self.state.z))
        self.point[:len(position)] = position
        self.point[len(position):2 * len(position)] = velocity
        self.events = []
        assert self._stepper.begin(self.state, self.point) == event_loop.REACHED

    @property
    def segments(self):
        """Number of segments so far."""
        return self.state.now["automaton"]["segments"][0]

    def ramp_speed(self, target, change):
        """Change the speed to `target` at `change` [rad/s²], from the start of the present segment on."""
        drive = self.state.now["drive"][0]
        drive["target"] = target
        drive["acceleration"] = math.copysign(change, target - drive["speed"])
        drive["time_left"] = abs(target - drive["speed"]) / change
        assert self._stepper.begin(self.state, self.point) == event_loop.REACHED

    def move_ramp(self, k, target, rate):
        """Let ramp k move to `target` at `rate`."""
        ramp = self.state.ramp[k]
        ramp["target"], ramp["rate"] = target, math.copysign(rate, target - ramp["value"])
        ramp["time_left"] = abs(target - ramp["value"]) / rate
        assert self._stepper.begin(self.state, self.point) == event_loop.REACHED

    def sample(self, times, room=64):
        """z, shape (n, channels), modes and phases, shape (n, 3), at `times`; events are appended to `.events`."""
        times = np.asarray(times, dtype=float)
        points, modes = np.empty((len(times), len(self.point))), np.empty(len(times), dtype=np.int64)
        phases, events = np.empty((len(times), 3)), np.empty((room, EVENT_COLUMNS))
        done, self.status = 0, event_loop.EVENTS_FULL
        while self.status == event_loop.EVENTS_FULL:
            self.status, taken, count = self._stepper.advance(
                self.state, times[done:], self.point, points[done:], modes[done:], phases[done:], events)
            done += taken
            self.events += [tuple(event) for event in events[:count]]
        return points, modes, phases
