"""A scene in motion: the state of its solver, advanced in time and changed by commands, with its events and energy.

Arguments are not checked here, because `Simulator` checks them. Every call that advances time or begins a segment
raises a SimulationError if the motion cannot go on.
"""

import math
import time as wall_clock
from collections.abc import Mapping, Sequence

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model, compile_scene
from vibro_ros.simulation.actuators import Actuators
from vibro_ros.simulation.disturbances import PATCH, PUSH, SAG, STALL, Disturbances
from vibro_ros.simulation.given_state import book_given_state, carried_over, checked_state, set_point, started
from vibro_ros.simulation.readout import AT_ONCE, EventLog, Readout, cut_to_laws, energy_accounts
from vibro_ros.simulation.samples import FIELDS, Trace
from vibro_ros.solver import event_loop
from vibro_ros.solver.events import EVENT_COLUMNS
from vibro_ros.solver.lowpass import filtered_rates, new_filters
from vibro_ros.solver.methods import SCHEMES, Exact, FixedStep, Stepper
from vibro_ros.solver.rotor import give_integral
from vibro_ros.solver.state import State, new_state

EVENTS_AT_ONCE = 4096
#: `EVENTS_AT_ONCE` events take at least this time [s]; less only in an impossible state, as of a forged checkpoint.
_PROGRESS = 1e-9

# Computing time [s] at which a part of `Motion.advance` aims; robot time [s] of the first part, longer than a tick;
# largest factor by which a part is longer than the previous one.
_PART, _FIRST_PART, _GROWTH = 0.02, 0.1, 1000.0

_CAUSES = {
    event_loop.STUCK: "events follow each other without any progress of time",
    event_loop.DIVERGED: "a coordinate is no longer finite",
    event_loop.ROOT_LOST: "the search for a guard's root did not end",
}


class SimulationError(RuntimeError):
    """Error of a run that cannot go on; the message gives time, mode and cause.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("damped").with_parameters({"solver.method": "rk4", "solver.step": 0.005})
    >>> try:
    ...     run = vibro_ros.simulate(scene, duration=1.0, rate=10.0)
    ... except vibro_ros.SimulationError as error:
    ...     print(error)
    at 0.385 s in mode closed, closed, slip_backward: a coordinate is no longer finite; rk4 may need a solver.step ...
    """


def new_stepper(scene: Scene, model: Model) -> Stepper:
    """Return the stepper of a scene, compiled as `model`, for its `solver.method`."""
    name, step = scene["solver.method"], scene["solver.step"]
    if name == "exact":
        return Exact(model.laid)
    return FixedStep(model.laid, SCHEMES[name], step)


class Motion:
    """The motion of a scene from its start; `bandwidth` [Hz] is that of the filter of `Simulator`, 0 for none."""

    def __init__(self, scene: Scene, bandwidth: float = 0.0):
        self.time = 0.0  # simulated time [s]
        self._restored = False  # whether a checkpoint was restored
        self._cuts_forces = scene["solver.method"] != "exact"
        self._new_events = np.empty((EVENTS_AT_ONCE, EVENT_COLUMNS))
        self.disturbances = Disturbances()
        self._compile(scene)
        self.point = np.zeros(self.model.forms.channels.count)  # at the end of the last advance, or the last command
        state = started(scene, self.model, self.point)
        filters = new_filters(self._body_velocities() if bandwidth else [], 2.0 * math.pi * bandwidth, self.point)
        self._filter = filters["channel"].copy(), filters["rate"].copy()
        self.state = state._replace(lowpass=filters)
        self._begin_segment(self.state)
        self.events = EventLog(self.model.forms.plates)

    def _compile(self, scene: Scene) -> None:
        self.scene = scene
        self._compiled = self.disturbances.equations(scene)
        self.model: Model = compile_scene(*self._compiled)
        self.stepper = new_stepper(scene, self.model)
        self._readout, self._part = Readout(self.model), _FIRST_PART
        self._instant, self._trace = np.empty(1), self.new_trace(1)
        self._sampled = False  # whether `_instant` and `_trace` are of the present time and commands
        self._values: np.ndarray | None = None  # the fields of `Samples` that were read from `_trace`

    def _body_velocities(self) -> list[int]:
        """Channels of the body's velocities along x and upwards, if the body can move so."""
        forms = self.model.forms
        coordinates = [forms.body] * forms.body_moves + [forms.height] * forms.body_hops
        return [forms.channels.velocity(coordinate) for coordinate in coordinates]

    def filtered_acceleration(self) -> tuple[float, float]:
        """The body's acceleration [m/s²] along x and upwards, filtered: see `Simulator.filtered_acceleration`."""
        assert isinstance(self.stepper, Exact)
        self.stepper.filter_rates(self.state, self.time)
        rates, forms = filtered_rates(self.state.lowpass).tolist(), self.model.forms
        return (rates[0] if forms.body_moves else 0.0), (rates[-1] if forms.body_hops else 0.0)

    @property
    def actuators(self) -> Actuators:
        """The motor and the plates in the present state."""
        return Actuators(self.scene, self.model, self.state, self.disturbances)

    def command(self, motor: float | None, gaps: Mapping[str, float]) -> None:
        """Command a motor speed [rad/s], or a voltage [V] if the motor takes that, and gaps [m], by side, from now on;
        gaps without a plate change nothing."""
        self._interrupt()
        if motor is not None:
            self.actuators.command_motor(self.time, motor)
        for side, gap in gaps.items():
            if side in self.model.forms.plates:
                self._command_plate(side, self.scene[f"crank.{side}_rod"] + gap)
        self._begin_segment(self.state)

    def change(self, scene: Scene) -> None:
        """Go on as `scene`, which differs in parameters that may change while the device runs.

        A motor speed or a plate that is still changing goes on to its target under the parameters of the new scene.
        """
        self._interrupt()
        self._become(scene)
        self.actuators.command_motor(self.time, self.actuators.motor_target)
        for side in self.model.forms.plates:
            self._command_plate(side, self.actuators.plate_target(side))
        self._begin_segment(self.state)

    def _interrupt(self) -> None:
        """End the segment at the present time, because something changes now."""
        self._sampled = False
        self.stepper.interrupt(self.state, self.time, self.point)

    def _command_plate(self, side: str, target: float) -> None:
        ended = self.actuators.command_plate(side, target, self.point, self._new_events)
        self.events.add(self._new_events[:ended])

    def _become(self, scene: Scene) -> None:
        """Go on as `scene` with its disturbances, at the end of an interrupted segment."""
        old = self.model
        self._sampled = False
        if self.disturbances.equations(scene) == self._compiled:
            self.scene = scene
        else:
            self._compile(scene)
            self.state, self.point = carried_over(old, self.state, self.point, self.model)

    def disturb(self, name: str, of: str, until: float, numbers: Sequence[float] = ()) -> None:
        """Activate one of `disturbances.ROWS` from now until the instant `until` [s]; an instant that does not lie
        ahead ends the disturbance.

        `of` is the side of a stuck plate. `numbers` are for a push its force [N], along x and upwards; for a sag the
        voltage [V]; for a patch its friction coefficient, and its ends [m].
        """
        motor_target, is_plate = self.actuators.motor_target, of in self.model.forms.plates
        plate_target = self.actuators.plate_target(of) if is_plate else 0.0
        self._interrupt()
        self.disturbances.write(name, of, until if until > self.time else 0.0, numbers)
        if name == PATCH:
            self._locate_on_patch()
        if name in (PUSH, SAG, PATCH) or (name == STALL and self.scene.has_rotor):
            self._become(self.scene)
        if name in (STALL, SAG):
            self.actuators.command_motor(self.time, motor_target)
        elif is_plate:
            self._command_plate(of, plate_target)
        self._begin_segment(self.state)

    def end_disturbances(self) -> None:
        """Advance to the next end of a disturbance, and end the disturbances that end there."""
        self._go_to(self.disturbances.next_end)
        for (name, of), until in self.disturbances.lasting().items():
            if until <= self.time:
                self.disturb(name, of, 0.0)

    def _locate_on_patch(self) -> bool:
        """Store where the body is relative to a patch of the ground; return whether there is a patch."""
        if not self.disturbances.row(PATCH)[0]:
            return False
        position = self.model.forms.channels.position(self.model.forms.body)
        self.disturbances.locate_on_patch(float(self.point[position]))
        return True

    def _cross_edge(self) -> None:
        """Go on at an edge of a patch, where the system has ended, with the system of the ground beyond the edge."""
        system = self.model.system
        position, automaton = self.model.forms.channels.position(self.model.forms.body), self.state.now["automaton"][0]
        forwards = system.guards.form[system.guards.row[automaton["mode"], automaton["guard"]], position] < 0.0
        # The body is put exactly on the edge, because rounding could put it back behind the edge.
        self.point[position] = self._compiled[2][int(forwards)]
        self.disturbances.row(PATCH)[4] += 1.0 if forwards else -1.0
        self.time = float(self.state.now["segment"]["start"][0])
        self._become(self.scene)
        self._begin_segment(self.state)

    def set_state(self, given: Mapping[str, object]) -> None:
        """Go on from the `given` state, by fields of `Samples`; see `given_state`.

        ValueError for an impossible state; nothing is changed then.
        """
        values = checked_state(self.scene, given, dict(zip(FIELDS, self.now().tolist(), strict=True)))
        ideal = self.scene["effects.motor"] == "ideal"
        target = values["motor_speed"] if ideal else self.actuators.motor_target
        self._interrupt()
        old_point, old_mode = self.point.copy(), int(self.state.now["automaton"]["mode"][0])
        set_point(self.scene, self.model, self.state, self.point, values, turned="crank_angle" in given)
        book_given_state(self.scene, self.model, self.state, old_point, old_mode, self.point)
        if self._locate_on_patch():
            self._become(self.scene)
        if "motor_speed" in given and not self.scene.has_rotor:
            self.actuators.command_motor(self.time, target, values["motor_speed"])
        if "controller_integral" in given:
            give_integral(self.model.system, self.state, self.time, values["controller_integral"])
        for side in self.model.forms.plates:
            if f"{side}_plate_position" in given:
                self._command_plate(side, self.actuators.plate_target(side))
        self._begin_segment(self.state)

    def compile_overwritten(self, scene: Scene) -> None:
        """Compile `scene`, which may have other live parameters, with the overwritten table of disturbances, unless
        the disturbances are impossible.

        The present state, which may be impossible, is not carried over, because all of it is overwritten next.
        """
        self.scene = scene
        possible = self.disturbances.are_possible(scene, self.model.forms, self.time)
        if possible and self.disturbances.equations(scene) != self._compiled:
            ramps, lowpass = self.state.ramp["value"], self.state.lowpass
            self._compile(scene)
            self.state = new_state(self.model.system, 0.0, ramps, self.model.initial_mode)._replace(lowpass=lowpass)
            self.point = np.zeros(self.model.forms.channels.count)

    def go_on_from_overwritten(self, restored: bool = False) -> None:
        """Prepare to go on after `checkpoint.parts_of` were overwritten, by a `restored` checkpoint or otherwise."""
        self._sampled, self._restored = False, self._restored or restored
        self.disturbances.look_for_next_end()

    def has_own_filters(self) -> bool:
        """Return whether the filters in the overwritten state are those that this motion began with."""
        filters = self.state.lowpass["channel"], self.state.lowpass["rate"]
        return all(map(np.array_equal, self._filter, filters))

    def _begin_segment(self, state: State) -> None:
        status = self.stepper.begin(state, self.point)
        if status != event_loop.REACHED:
            self._fail(status, state)

    def _fail(self, status: int, state: State) -> None:
        """Raise the SimulationError for a `status` with which the solver has stopped."""
        mode = self.model.modes[state.now["automaton"]["mode"][0]]
        method = self.scene["solver.method"]
        remedy = "please report the scene"
        if method != "exact":
            remedy = (f"{method} may need a solver.step below {self.scene['solver.step']:g} s, or use solver.method "
                      "exact")
        elif self._restored:
            remedy = "restore a checkpoint that a device of this scene has made"
        time = state.now["segment"]["start"][0]
        raise SimulationError(f"at {time:.9g} s in mode {', '.join(mode.states)}: {_CAUSES[status]}; {remedy}")

    def sampled(self, times: np.ndarray, filtered: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Advance to each of `times` [s], ascending, and return the fields of `Samples` there; fill in the filtered
        acceleration [m/s²], if its array is given, shape (times, 2)."""
        quantities = {name: np.empty(len(times)) for name in FIELDS}
        done, count = 0, min(len(times), AT_ONCE)
        whole_trace, values = self.new_trace(count), np.empty((len(FIELDS), count))
        while done < len(times):
            before_end = int(np.searchsorted(times, self.disturbances.next_end))  # a sample at an end is taken after it
            wanted = times[done:min(before_end, done + count)]
            trace = whole_trace.part(0, len(wanted))
            taken = (self.advance(wanted, trace) if filtered is None
                     else self._advance_filtered(wanted, trace, filtered[done:]))
            self._read(wanted[:taken], trace.part(0, taken), values)
            for array, row in zip(quantities.values(), values, strict=True):
                array[done:done + taken] = row[:taken]
            done += taken
            if taken < len(wanted):
                self._cross_edge()
            elif before_end <= done < len(times):
                self.end_disturbances()
        return quantities

    def advance_to(self, time: float) -> None:
        """Advance to `time` [s], and keep the sample there for `now`."""
        while self.disturbances.next_end <= time:
            self.end_disturbances()
        self._go_to(time)
        self._sampled = True

    def _go_to(self, time: float) -> None:
        """Advance to `time` [s], across all edges of a patch, and sample there."""
        advance = self.advance_at_once if time <= self.time + _FIRST_PART else self.advance
        self._instant[0] = time
        while advance(self._instant, self._trace) == 0:
            self._cross_edge()
            self._instant[0] = time

    def now(self) -> np.ndarray:
        """Return the values of all `FIELDS` of `Samples` now, shape (fields,); the next call overwrites them."""
        if not self._sampled:
            self.advance_to(self.time)
        if self._values is None and self._cuts_forces:
            values = np.empty((len(FIELDS), 1))
            self._read(self._instant, self._trace, values)
            self._values = values[:, 0]
        elif self._values is None:
            self._values = self._readout.values(self._instant, self._trace)
        return self._values

    @property
    def steps(self) -> int:
        """Number of segments of the event loop so far, or of steps of fixed length."""
        return int(self.state.now["automaton"]["segments"][0])

    def energy_accounts(self) -> dict[str, float]:
        """Return the energy accounts [J] of a scene with `solver.accounts`: see `Simulator.statistics`."""
        return energy_accounts(self.model, self.state, self.time)

    def new_trace(self, count: int) -> Trace:
        """Return an empty trace for the samples of `advance` at `count` instants."""
        return Trace(np.empty((count, self.model.forms.channels.count)), np.empty(count, dtype=np.int64),
                     np.empty((count, 3)))

    def advance(self, times: np.ndarray, trace: Trace) -> int:
        """Advance to each of `times` [s], ascending, and fill the trace; return how many instants are sampled.

        Instants at an edge of a patch and after it are not sampled; the caller calls `_cross_edge` next.

        A long advance is made in parts of some milliseconds of computation, between which Python handles Ctrl-C. The
        ends of the parts depend on the computer; the motion does not.
        """
        done = 0
        while done < len(times):
            until = self.time + max(self._part, 4.0 * math.ulp(self.time))
            if times[-1] <= until:
                return done + self.advance_at_once(times[done:], trace.part(done, len(times)))
            upto, began = int(np.searchsorted(times, until, side="right")), wall_clock.perf_counter()
            if upto == done:
                reached = self.advance_at_once(np.array([until]), self.new_trace(1)) == 1
            else:
                done += self.advance_at_once(times[done:upto], trace.part(done, upto))
                reached = done == upto
            if not reached:
                return done
            self._part *= _PART / max(wall_clock.perf_counter() - began, _PART / _GROWTH)
        return done

    def advance_at_once(self, times: np.ndarray, trace: Trace) -> int:
        """Advance as `advance` does, but in one part, during which Python handles no signal."""
        self._sampled, self._values = False, None
        end, status, sampled, previous_start = float(times[-1]), event_loop.EVENTS_FULL, 0, self.time
        while status == event_loop.EVENTS_FULL:
            status, taken, count = self.stepper.advance(self.state, times, self.point, *trace, self._new_events)
            sampled += taken
            if count:
                self.events.add(self._new_events[:count])
            if status == event_loop.EVENTS_FULL:
                times, trace = times[taken:], trace.part(taken, len(times))
                if (began := self._mode_began()) - previous_start < _PROGRESS:
                    status = event_loop.STUCK
                previous_start = began
        if status == event_loop.SYSTEM_ENDS:
            return sampled
        if status != event_loop.REACHED:
            self._fail(status, self.state)
        self.time = end
        return sampled

    def _advance_filtered(self, times: np.ndarray, trace: Trace, filtered: np.ndarray) -> int:
        """Advance as `advance` does, and fill in the filtered acceleration at each instant.

        `advance_at_once` and `filtered_acceleration` in turn would do the same, but cost more.
        """
        assert isinstance(self.stepper, Exact)
        advance, filter_rates, state, lowpass = (
            self.stepper.advance, self.stepper.filter_rates, self.state, self.state.lowpass)
        points, modes, phases = trace
        quadratures, done = np.zeros((len(times), len(lowpass))), len(times)
        self._sampled, self._values = False, None
        for k, time in enumerate(times.tolist()):
            row = slice(k, k + 1)
            status, taken, count = advance(state, times[row], self.point, points[row], modes[row], phases[row],
                                           self._new_events)
            if count:
                self.events.add(self._new_events[:count])
            if status == event_loop.SYSTEM_ENDS or (  # `advance_at_once` goes on after a full table of events
                    status != event_loop.REACHED and not self.advance_at_once(times[row], trace.part(k, k + 1))):
                done = k
                break
            self.time = time
            filter_rates(state, time)
            quadratures[k] = lowpass["quadrature"]
        rates = math.sqrt(2.0) * lowpass["rate"] * quadratures
        forms = self.model.forms
        filtered[:done] = 0.0
        if forms.body_moves:
            filtered[:done, 0] = rates[:done, 0]
        if forms.body_hops:
            filtered[:done, 1] = rates[:done, -1]
        return done

    def _mode_began(self) -> float:
        """Return the instant [s] at which the present mode began."""
        segment = self.state.now["segment"][0]
        return float(segment["start"] + segment["half"] * (segment["mode_start"] + 1.0))

    def _read(self, times: np.ndarray, trace: Trace, values: np.ndarray) -> None:
        """Fill leading columns of `values` with the `FIELDS` at `times` [s], from the trace that `advance` filled."""
        self._readout.fill(times, trace, values)
        if self._cuts_forces:
            columns = values[:, :len(times)]
            cut_to_laws(self.scene, self.model.forms.pressed_only, dict(zip(FIELDS, columns, strict=True)))
