"""scipy's integrators on a scene's tables, with its guards located as events.

Each step's guards are evaluated on the dense output; the first that has turned negative is located by `brentq`, the
mode changes there by the tables' candidates and jumps, and the integrator starts again.
"""

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853, LSODA, OdeSolver, Radau
from scipy.optimize import brentq

from vibro_ros.model.modes import MODE_EVENTS
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model
from vibro_ros.simulation.motion import Motion
from vibro_ros.solver.compilation import entry_kernel
from vibro_ros.solver.drive import settling_time
from vibro_ros.solver.events import choose_candidate
from vibro_ros.solver.guards import NOISE
from vibro_ros.solver.right_hand_side import accelerate, fill_forcing_at
from vibro_ros.solver.system import NOTHING

SOLVERS: dict[str, type[OdeSolver]] = {"DOP853": DOP853, "Radau": Radau, "LSODA": LSODA}
# Points between a step's ends at which its guards are evaluated, too.
_WITHIN = np.linspace(0.0, 1.0, 9)[1:]
# Changes of mode at one instant after which one is passed by, because the error of the dense output has guards
# contradict each other; and halvings of a step's first part in search of a guard that rises before it falls.
_MOST_AT_ONCE = 20
_HALVINGS = 30
_ROOT = 4.0 * np.finfo(float).eps  # of `brentq`, the least that it takes


class UnableError(RuntimeError):
    """A method cannot integrate the scene, or not at this cost."""


@entry_kernel
def _fill_point(system, state, mode, time, z, accelerations):
    fill_forcing_at(system, state, time, z)
    accelerate(system, state, mode, z, accelerations)


@entry_kernel
def _settling_time(system, state):
    return settling_time(state.now[0].drive)


@entry_kernel
def _choose(system, state, z):
    return choose_candidate(system, state, z, state.scratch.after)


@dataclass
class Work:
    """What an integration has cost, and may cost."""

    most_evaluations: float
    evaluations: int = 0
    steps: int = 0


class Tables:
    """A scene's right-hand side and guards, by value, from time 0 on.

    Parameters
    ----------
    scene : Scene
        What to integrate.
    motor_speed : float or None
        Speed commanded at t = 0 [rad/s], if any.
    """

    def __init__(self, scene: Scene, motor_speed: float | None = None):
        if scene.has_rotor:
            raise UnableError("a dc motor's controller takes samples, of which the tables know nothing")
        motion = Motion(scene.with_parameters({"solver.method": "exact"}))
        self.first_mode = int(motion.state.now["automaton"]["mode"][0])
        if motor_speed is not None:
            motion.command(scene.checked_motor_speed(motor_speed), {})
        self.model: Model = motion.model
        self.system, self.state = self.model.system, motion.state
        self.channels = self.model.forms.channels
        self.motor_settled = _settling_time(self.system, self.state)
        n = self.channels.coordinates
        self.start = motion.point[:2 * n].copy()
        self._z, self._accelerations = np.zeros(self.channels.count), np.zeros(n)

    def point(self, time: float, y: np.ndarray, mode: int) -> np.ndarray:
        """All channels, shape (channels,); overwritten by the next call."""
        self._z[:len(y)] = y
        _fill_point(self.system, self.state, mode, time, self._z, self._accelerations)
        return self._z

    def slope(self, time: float, y: np.ndarray, mode: int) -> np.ndarray:
        """y', shape (2 coordinates,)."""
        self.point(time, y, mode)
        return np.concatenate([y[self.channels.coordinates:], self._accelerations])

    def guards(self, mode: int, z: np.ndarray) -> np.ndarray:
        """Values of the mode's guards, in their order."""
        rows = self.system.guard[mode]
        return self.system.row[rows[rows != NOTHING]] @ z

    def broken_guard(self, mode: int, z: np.ndarray) -> int:
        """The mode's first guard that is negative beyond its rounding error, or `NOTHING`."""
        rows = self.system.guard[mode]
        terms = self.system.row[rows[rows != NOTHING]] * z
        broken = np.flatnonzero(terms.sum(axis=1) < -NOISE * abs(terms).sum(axis=1))
        return int(broken[0]) if len(broken) else NOTHING

    def change(self, mode: int, guard: int, z: np.ndarray) -> tuple[int, np.ndarray, list[str]]:
        """Mode that follows when a guard of `mode` fires, the coordinates then, and kinds of events to record."""
        automaton = self.state.now["automaton"]
        automaton["mode"], automaton["guard"] = mode, guard
        candidate = _choose(self.system, self.state, z)
        after = int(self.system.candidate[mode, guard, candidate])
        kinds = []
        kind = self.system.event_kind[mode, after]
        if kind == NOTHING:
            kind = self.system.guard_event[mode, guard]
        if kind != NOTHING:
            kinds.append(MODE_EVENTS[kind])
        struck = self.system.blow_monitor[mode, guard]
        met = [k for k in range(self.system.monitored.shape[1])
               if self.system.monitored[after, k] and not self.system.monitored[mode, k]]
        if struck != NOTHING and struck not in met:
            met.append(struck)
        kinds += [f"{self.model.forms.plates[k]}_contact" for k in met]
        return after, self.state.scratch.after[:2 * self.channels.coordinates].copy(), kinds


def located(name: str, tables: Tables, times: np.ndarray, tolerance: float, work: Work):
    """Integrate by the solver `name` with event location: states at `times`, shape (n, 2 coordinates), and events."""
    return _Located(name, tables, times, tolerance, work).integrate()


class _Located:
    """One integration with event location."""

    def __init__(self, name, tables, times, tolerance, work):
        self._make, self._tables, self._times, self._work = SOLVERS[name], tables, times, work
        self._tolerance = tolerance
        self._at_once = 0
        self._states = np.zeros((len(times), len(tables.start)))

    def integrate(self):
        tables, time, y, mode = self._tables, 0.0, self._tables.start, self._tables.first_mode
        done, states, events = 0, self._states, []
        while done < len(self._times):
            stop = self._times[-1] if time >= tables.motor_settled else min(self._times[-1], tables.motor_settled)
            ended, y_end, guard, done = self._piece(time, y, mode, stop, done)
            self._at_once = self._at_once + 1 if ended == time else 0
            time, y = ended, y_end
            if guard == NOTHING and time >= self._times[-1]:
                states[done:] = y
                break
            if guard != NOTHING:
                mode, y, kinds = tables.change(mode, guard, tables.point(time, y, mode))
                events += [(time, kind) for kind in kinds]
        return states, events

    def _piece(self, time, y, mode, stop, done):
        """Integrate to the next event or to `stop`: instant, coordinates, guard that fires, and samples taken."""
        tables, work = self._tables, self._work
        if stop <= time:
            return time, y, NOTHING, done
        solver = self._make(counted(lambda t, y: tables.slope(t, y, mode), work), time, y, stop,
                            rtol=max(self._tolerance, 1e-13), atol=self._tolerance)
        while solver.status == "running":
            step(solver, work)
            dense = solver.dense_output()
            ended, guard = self._first_event(dense, solver.t_old, solver.t, mode)
            upto = int(np.searchsorted(self._times, ended, side="right" if guard == NOTHING else "left"))
            if upto > done:
                self._states[done:upto] = dense(self._times[done:upto]).T
                done = upto
            if guard != NOTHING:
                return ended, dense(ended), guard, done
        return solver.t, solver.y, NOTHING, done

    def _first_event(self, dense, begun, ended, mode):
        """Instant and number of the first guard that turns negative in a step; else its end and `NOTHING`.

        One that is negative from the beginning, and not just by what the last root lacks, fires at once.
        """
        tables = self._tables
        before, values = begun, tables.guards(mode, tables.point(begun, dense(begun), mode))
        for part in _WITHIN:
            after = begun + part * (ended - begun) if part < 1.0 else ended
            z = tables.point(after, dense(after), mode)
            following = tables.guards(mode, z)
            if tables.broken_guard(mode, z) != NOTHING:
                return min((self._root(dense, before, after, mode, g, values[g]), g)
                           for g in np.flatnonzero(following < 0.0))
            before, values = after, following
        return ended, NOTHING

    def _root(self, dense, before, after, mode, guard, first):
        """Where a guard of the value `first` at `before` has turned negative by `after`."""
        def value(time):
            return self._tables.guards(mode, self._tables.point(time, dense(time), mode))[guard]

        if first > 0.0:
            return brentq(value, before, after, xtol=1e-16, rtol=_ROOT)
        for k in range(1, _HALVINGS):
            between = before + (after - before) / 2.0**k
            if value(between) > 0.0:
                return brentq(value, between, after, xtol=1e-16, rtol=_ROOT)
        return before if self._at_once < _MOST_AT_ONCE else after


def step(solver: OdeSolver, work: Work) -> None:
    """Take a step of an integration (`UnableError` where it fails or costs too much)."""
    message = solver.step()
    work.steps += 1
    if solver.status == "failed":
        raise UnableError(f"at {solver.t:g} s: {message}")
    if work.evaluations > work.most_evaluations:
        raise UnableError(f"more than {work.most_evaluations:g} evaluations, at {solver.t:g} s")


def counted(slope: Callable, work: Work) -> Callable:
    """`slope`, whose calls are counted."""
    @functools.wraps(slope)
    def slope_and_count(t, y):
        work.evaluations += 1
        return slope(t, y)
    return slope_and_count


def finite(states: np.ndarray) -> np.ndarray:
    """`states`, or `UnableError` if they are not finite."""
    if not math.isfinite(float(np.sum(states))):
        raise UnableError("a coordinate is no longer finite")
    return states
