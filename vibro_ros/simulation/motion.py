"""A scene in motion: the state of its solver, advanced in time and changed by commands, with its events and energy.

Arguments are not checked here, because `Simulator` checks them. Every call that advances time or begins a segment
raises a SimulationError if the motion cannot go on.
"""

import math
import time as wall_clock
from collections.abc import Mapping

import numpy as np

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import Model, compile_scene
from vibro_ros.simulation.disturbances import PATCH, PUSH, SAG, STALL, STUCK, Disturbances
from vibro_ros.simulation.given_state import book_given_state, checked_state, place, started
from vibro_ros.simulation.readout import Readout, cut_to_laws
from vibro_ros.simulation.samples import CRANK_ANGLE, FIELDS, MOTOR_SPEED, Trace
from vibro_ros.simulation.statistics import EventLog, energy_accounts
from vibro_ros.solver import event_loop
from vibro_ros.solver.drive import command_drive, speed_and_target
from vibro_ros.solver.events import EVENT_COLUMNS, leave_for_ramp
from vibro_ros.solver.layout import Laid
from vibro_ros.solver.lowpass import filtered_rates, new_filters
from vibro_ros.solver.methods import SCHEMES, Exact, FixedStep, Stepper
from vibro_ros.solver.rotor import command_rotor, give_integral
from vibro_ros.solver.segment import LONGEST_SEGMENT
from vibro_ros.solver.state import State, lasting, new_state
from vibro_ros.solver.system import BY_COMMAND, BY_CURRENT, NOTHING

EVENTS_AT_ONCE = 4096
#: `EVENTS_AT_ONCE` events take at least this time [s]; less only in an impossible state, as of a forged checkpoint.
_PROGRESS = 1e-9
#: Largest number in a device's state, in SI units and counts; largest local time in a segment, with rounding.
_LARGEST, _LOCAL = 1e15, 1.0 + 1e-9
#: Fraction by which rounding may exceed a limit; and largest angle [rad] of a dc motor's crank at the end of a segment
#: that starts within a turn.
_CLOSE, _MOST_TURNED = 1e-6, 30.0

# Computing time [s] at which a part of `Motion.advance` aims; robot time [s] of the first part, longer than a tick;
# largest factor by which a part is longer than the previous one.
_PART, _FIRST_PART, _GROWTH = 0.02, 0.1, 1000.0

_TURN = 2.0 * math.pi
# Angle [rad] before the target within which the crank is followed segment by segment; and number of instants at which
# the crank is checked over a longer distance.
_NEAR, _SEEN = 0.5, 8
# Local time to which an angle's instant is found: two roundings of 1.
_NARROWEST = 4e-16

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
    """The motion of a scene from its start.

    Parameters
    ----------
    scene : Scene
        The scene to simulate.
    bandwidth : float
        Bandwidth of the filter of the body's acceleration [Hz], see `Simulator`; 0 for no filter.

    Attributes
    ----------
    model : Model
        The scene, compiled.
    time : float
        Simulated time [s], from 0.
    state : State
        The solver's state.
    point : ndarray, shape (channels,)
        Every channel at the end of the last advance or at the last command.
    events : EventLog
        The events so far.
    disturbances : Disturbances
        The active disturbances, which `end_disturbances` ends.
    """

    def __init__(self, scene: Scene, bandwidth: float = 0.0):
        self.time = 0.0
        self._restored = False
        self._cuts_forces = scene["solver.method"] != "exact"
        self._room = np.empty((EVENTS_AT_ONCE, EVENT_COLUMNS))
        self.disturbances = Disturbances()
        self._set_up(scene)
        self.point = np.zeros(self.model.forms.channels.count)
        state = started(scene, self.model, self.point)
        filters = new_filters(self._body_velocities() if bandwidth else [], 2.0 * math.pi * bandwidth, self.point)
        self._filter = filters["channel"].copy(), filters["rate"].copy()
        self.state = state._replace(lowpass=filters)
        self._begin_segment(self.state)
        self.events = EventLog(self.model.forms.plates)

    def _set_up(self, scene: Scene) -> None:
        self.scene = scene
        self._compiled = self.disturbances.equations(scene)
        self.model: Model = compile_scene(*self._compiled)
        self._stepper = new_stepper(scene, self.model)
        self._readout = Readout(self.model)
        self._instant, self._trace = np.empty(1), self.new_trace(1)
        self._sampled = False  # whether both are of `time`, with no command since
        self._values: np.ndarray | None = None  # the values read from the trace

    def _body_velocities(self) -> list[int]:
        """Channels of the body's velocities along x and upwards, if the body can move so."""
        forms = self.model.forms
        coordinates = [forms.body] * forms.body_moves + [forms.height] * forms.body_hops
        return [forms.channels.velocity(coordinate) for coordinate in coordinates]

    def filtered_acceleration(self) -> tuple[float, float]:
        """The body's acceleration [m/s²] along x and upwards, filtered: see `Simulator.filtered_acceleration`."""
        assert isinstance(self._stepper, Exact)
        self._stepper.filter_rates(self.state, self.time)
        found, forms = filtered_rates(self.state.lowpass).tolist(), self.model.forms
        return (found[0] if forms.body_moves else 0.0), (found[-1] if forms.body_hops else 0.0)

    def command(self, motor: float | None, gaps: Mapping[str, float]) -> None:
        """Command a motor speed [rad/s], or a voltage [V] if the motor takes that, and gaps [m], by side, from now on;
        gaps without a plate change nothing."""
        self._sampled = False
        self._stepper.interrupt(self.state, self.time, self.point)
        if motor is not None:
            self._command_motor(motor)
        for side, gap in gaps.items():
            if side in self.model.forms.plates:
                self._command_plate(side, self.scene[f"crank.{side}_rod"] + gap)
        self._begin_segment(self.state)

    def change(self, scene: Scene) -> None:
        """Go on as `scene`, which differs in parameters that may change while the device runs.

        A motor speed or a plate that is still changing goes on to its target under the parameters of the new scene.
        """
        self._stepper.interrupt(self.state, self.time, self.point)
        self._become(scene)
        self._command_motor(self.motor_target)
        for side in self.model.forms.plates:
            self._command_plate(side, self._plate_target(side))
        self._begin_segment(self.state)

    def _become(self, scene: Scene) -> None:
        old = self.model
        self._sampled = False
        if self.disturbances.equations(scene) == self._compiled:
            self.scene = scene
        else:
            self._set_up(scene)
            self.state, self.point = carried_over(old, self.state, self.point, self.model)

    def disturb(self, name: str, of: str, until: float, numbers: tuple[float, ...] = ()) -> None:
        """Activate one of `disturbances.ROWS` from now until the instant `until` [s], with new `numbers`; an instant
        that does not lie ahead ends the disturbance.

        Parameters
        ----------
        name, of : str
            Name of the disturbance, and the side of a stuck plate.
        until : float
            Instant [s].
        numbers : tuple of float
            For a push its force [N], along x and upwards; for a sag the voltage [V]; for a patch its friction
            coefficient, and its ends [m].
        """
        speed, side = self.motor_target, of if of in self.model.forms.plates else ""
        plate = self._plate_target(side) if side else 0.0
        self._stepper.interrupt(self.state, self.time, self.point)
        self._sampled = False
        self.disturbances.write(name, of, until if until > self.time else 0.0, numbers)
        if name == PATCH:
            self._find_place_on_ground()
        if name in (PUSH, SAG, PATCH) or (name == STALL and self.scene.has_rotor):
            self._become(self.scene)
        if name in (STALL, SAG):
            self._command_motor(speed)
        elif side:
            self._command_plate(side, plate)
        self._begin_segment(self.state)

    def end_disturbances(self) -> None:
        """Advance to the next end of a disturbance, and end the disturbances that end there."""
        self._go_to(self.disturbances.next_end)
        for (name, of), until in self.disturbances.lasting().items():
            if until <= self.time:
                self.disturb(name, of, 0.0)

    def _find_place_on_ground(self) -> bool:
        """Store where the body is relative to a patch of the ground; return whether there is a patch."""
        lasts = (PATCH, "") in self.disturbances.lasting()
        if lasts:
            position = self.model.forms.channels.position(self.model.forms.body)
            self.disturbances.find_place(float(self.point[position]))
        return lasts

    def _cross_edge(self) -> None:
        """Go on at an edge of a patch, where the system has ended, with the system of the ground beyond the edge."""
        system = self.model.system
        position, automaton = self.model.forms.channels.position(self.model.forms.body), self.state.now["automaton"][0]
        forwards = system.row[system.guard[automaton["mode"], automaton["guard"]], position] < 0.0
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
        target = values["motor_speed"] if ideal else self.motor_target
        self._sampled = False
        self._stepper.interrupt(self.state, self.time, self.point)
        before, mode = self.point.copy(), int(self.state.now["automaton"]["mode"][0])
        place(self.scene, self.model, self.state, self.point, values, turned="crank_angle" in given)
        book_given_state(self.scene, self.model, self.state, before, mode, self.point)
        if self._find_place_on_ground():
            self._become(self.scene)
        if "motor_speed" in given and not self.scene.has_rotor:
            self._command_motor(target, values["motor_speed"])
        if "controller_integral" in given:
            give_integral(self.model.system, self.state, self.time, values["controller_integral"])
        for side in self.model.forms.plates:
            if f"{side}_plate_position" in given:
                self._command_plate(side, self._plate_target(side))
        self._begin_segment(self.state)

    @property
    def motor_target(self) -> float:
        """Commanded speed of the motor [rad/s], or commanded voltage [V] if the motor takes that."""
        if self.scene.has_rotor:
            return float(self.state.now["motor"]["target"][0])
        asked = self.disturbances.asked(STALL)
        return speed_and_target(self.state.now["drive"][0])[1] if asked is None else asked

    @property
    def controller_integral(self) -> float:
        """Integral of a dc motor's controller before its next sample [V or A]; 0 without a controller."""
        return float(self.state.now["motor"]["integral"][0])

    def _command_motor(self, target: float, speed: float | None = None) -> None:
        """Command the motor to go to `target` from `speed` [rad/s], or from its present speed if None."""
        if self.scene.has_rotor:
            command_rotor(self.model.system, self.state, self.time, target, self.scene["motor.acceleration"])
            return
        signals, drive, stall = self.model.system.signals, self.state.now["drive"][0], self.disturbances.row(STALL)
        if stall[0]:
            stall[1], target = target, 0.0
        speed = speed_and_target(drive)[0] if speed is None else speed
        if self.scene["effects.motor"] == "ideal":
            command_drive(signals, drive, target, target)
        elif self.scene["effects.motor"] == "lag":
            command_drive(signals, drive, speed, target, lag=self.scene["motor.time_constant"])
        else:
            command_drive(signals, drive, speed, target, acceleration=self.scene["motor.acceleration"])

    def _plate_target(self, side: str) -> float:
        """Return the commanded position of the plate [m]."""
        asked = self.disturbances.asked(STUCK, side)
        return float(self.state.ramp["target"][self.model.forms.plates.index(side)]) if asked is None else asked

    def _command_plate(self, side: str, target: float) -> None:
        plate, stuck = self.model.forms.plates.index(side), self.disturbances.row(STUCK, side)
        ramp = self.state.ramp[plate]
        if stuck[0]:
            stuck[1], target = target, float(ramp["value"])
        speed, difference = self.scene["gap_actuator.speed"], target - ramp["value"]
        rate = math.copysign(speed, difference) if difference != 0.0 else 0.0
        if rate != ramp["rate"]:  # else a mass that rests on the plate goes on resting
            ended = leave_for_ramp(self.model.laid.layout, Laid(self.state).layout, plate, self.point, self._room, 0)
            self.events.add(self._room[:ended])
        ramp["target"], ramp["rate"], ramp["time_left"] = target, rate, abs(difference) / speed

    def lasting(self) -> list[np.ndarray]:
        """Return the arrays, to be read or overwritten, that the future depends on besides time, scene and commands.

        The first is the table of `disturbances`; when it is overwritten, `disturbances_overwritten` gives the arrays
        that follow it.
        """
        return [self.disturbances.table, self.point, *lasting(self.state), *self._stepper.memory]

    def disturbances_overwritten(self) -> None:
        """Compile the scene with the overwritten disturbances, unless `is_possible` will refuse them.

        The present state, which may be impossible, is not carried over, because all of it is overwritten next.
        """
        possible = self.disturbances.are_possible(self.scene, self.model.forms, self.time)
        if possible and self.disturbances.equations(self.scene) != self._compiled:
            ramps, lowpass = self.state.ramp["value"], self.state.lowpass
            self._set_up(self.scene)
            self.state = new_state(self.model.system, 0.0, ramps, self.model.initial_mode)._replace(lowpass=lowpass)
            self.point = np.zeros(self.model.forms.channels.count)

    def lasting_overwritten(self) -> None:
        """Prepare to go on from the overwritten arrays of `lasting`."""
        self._sampled, self._restored = False, True
        self.disturbances.look_for_next_end()

    def is_possible(self) -> bool:
        """Whether a device can go on from the overwritten arrays of `lasting`, which may come from a forged bag.

        All numbers must be finite, all indices that a kernel uses must be within their tables, or the kernel would read
        foreign memory, and the numbers that decide how much is computed must be within the limits of a device.
        Whether the numbers are consistent with each other is not checked.
        """
        system, scene, now = self.model.system, self.scene, self.state.now[0]
        segment, drive, automaton = now["segment"], now["drive"], now["automaton"]
        places = ((automaton["mode"], 0, len(self.model.modes)), (automaton["guard"], NOTHING, system.guard.shape[1]),
                  (drive["cell"], 0, len(system.signals.reach)))
        filters = self.state.lowpass["channel"], self.state.lowpass["rate"]
        if not (all(low <= place < high for place, low, high in places) and drive["direction"] in (-1, 1)
                and all(map(np.array_equal, self._filter, filters))):
            return False
        fastest, width = BY_NAME["motor.max_speed"].maximum, float(np.diff(system.signals.start)[drive["cell"]])
        spans = [(segment["half"], 0.0, LONGEST_SEGMENT), (abs(segment["residue"]), 0.0, LONGEST_SEGMENT),
                 (self.time - segment["start"], -2.0 * LONGEST_SEGMENT, 2.0 * LONGEST_SEGMENT),
                 *((segment[name], -_LOCAL, _LOCAL) for name in ("mode_start", "next_event")),
                 (drive["offset"], 0.0, width * _LOCAL), (abs(drive["target"]), 0.0, fastest),
                 (drive["speed"], 0.0, fastest),
                 (drive["time_left"], 0.0, _LARGEST),
                 *((ramp["time_left"], 0.0, _LARGEST) for ramp in self.state.ramp if ramp["rate"] != 0.0),
                 (abs(drive["acceleration"]), 0.0, scene["motor.acceleration"]), (drive["lag"], 0.0, _LARGEST)]
        if scene.has_rotor:
            spans += self._motor_spans(now["motor"], float(segment["start"]))
        numbers = np.concatenate([np.ravel(part) for part in self.lasting()])
        endless = np.count_nonzero(~(np.abs(numbers) <= _LARGEST))
        return (all(low <= number <= high for number, low, high in spans)
                and drive["lag"] in (0.0, scene["motor.time_constant"])
                and self.disturbances.are_possible(scene, self.model.forms, self.time)
                and endless == (segment["cell_left"] > _LARGEST))  # infinite if the crank stands, or nearly so

    def _motor_spans(self, motor: np.void, start: float) -> list[tuple[float, float, float]]:
        """Return the numbers of a dc motor that decide how much is computed from the instant `start` [s], with their
        limits."""
        scene, controller, phase = self.scene, self.model.system.rotor.controller[0], self.model.forms.phase
        period, law = float(controller["period"]), controller["law"]
        most = scene["motor.current_limit" if law == BY_CURRENT else "motor.supply_voltage"] * (1.0 + _CLOSE)
        angles = self.point[phase], self.state.mode_point[phase], math.fsum(abs(self.state.z[phase]))
        spans = [*((abs(angle), 0.0, _MOST_TURNED) for angle in angles), (abs(motor["held"]), 0.0, most),
                 *((abs(motor[name]), 0.0, BY_NAME["motor.max_speed"].maximum) for name in ("target", "reference"))]
        if law != BY_COMMAND:
            step = scene["solver.step"] * self._cuts_forces
            spans.append((motor["samples"] * period - start, -step - _CLOSE * period, (1.0 + _CLOSE) * period))
        return spans

    def _begin_segment(self, state: State) -> None:
        status = self._stepper.begin(state, self.point)
        if status != event_loop.REACHED:
            self._fail(status, state)

    def _fail(self, status: int, state: State) -> None:
        mode, step = self.model.modes[state.now["automaton"]["mode"][0]], self.scene["solver.step"]
        method, remedy = self.scene["solver.method"], "please report the scene"
        if method != "exact":
            remedy = f"{method} may need a solver.step below {step:g} s, or use solver.method exact"
        elif self._restored:
            remedy = "restore a checkpoint that a device of this scene has made"
        time = state.now["segment"]["start"][0]
        raise SimulationError(f"at {time:.9g} s in mode {', '.join(mode.states)}: {_CAUSES[status]}; {remedy}")

    def sampled(self, times: np.ndarray, filtered: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Advance to each of `times` [s], ascending, and return the fields of `Samples` there; fill in the filtered
        acceleration [m/s²], if its array is given, shape (times, 2)."""
        found = []
        while True:
            before = int(np.searchsorted(times, self.disturbances.next_end))  # a sample at an end is taken after it
            trace = self.new_trace(before)
            if filtered is None:
                taken = self.advance(times[:before], trace)
            else:
                taken = self._advance_filtered(times[:before], trace, filtered)
                filtered = filtered[taken:]
            found.append(self.quantities(times[:taken], trace.part(0, taken)))
            if taken == len(times):
                break
            if taken < before:
                self._cross_edge()
            else:
                self.end_disturbances()
            times = times[taken:]
        if len(found) == 1:
            return found[0]
        return {name: np.concatenate([part[name] for part in found]) for name in FIELDS}

    def advance_to(self, time: float) -> None:
        """Advance to `time` [s], and keep the sample there for `now`."""
        while self.disturbances.next_end <= time:
            self.end_disturbances()
        self._go_to(time)
        self._sampled = True

    def advance_to_angle(self, turn: int, angle: float, latest: float) -> bool:
        """Advance to the instant at which a dc motor's crank first reaches an angle, by the method exact.

        Parameters
        ----------
        turn : int
            Whole turns before the angle.
        angle : float
            Angle within the next turn, from 0 to 2 pi [rad].
        latest : float
            Instant [s] at which to stop if the crank does not reach the angle before.

        Returns
        -------
        bool
            Whether the crank has reached the angle, to rounding, because the angle is a polynomial over each segment.
        """
        phase, hops = self.model.forms.channels.phase, True
        while True:
            segment, turns = self.state.now["segment"][0], int(self.state.now["drive"]["turns"][0])
            start, half = float(segment["start"]) + float(segment["residue"]), float(segment["half"])
            now, end = (self.time - start) / half - 1.0, float(segment["next_event"])
            x = first_reached(self.state.z[phase], (turn - turns) * _TURN + angle, now, end)
            # An event lies at the segment's end to rounding; the next float is after it.
            time = (max(self.time, start + half * (1.0 + x)) if x is not None else
                    max(math.nextafter(self.time, math.inf), start + half * (1.0 + end)))
            if x is None and hops and self.disturbances.next_end == math.inf:
                hops = self._hop(turn, angle, latest)
                continue
            before = min(latest, self.disturbances.next_end)
            self.advance_to(min(time, before))
            if x is not None and time <= before:
                return True
            if self.time >= latest:
                return False

    def _hop(self, turn: int, angle: float, latest: float) -> bool:
        """Advance over many segments at once, for half the time to the angle at the crank's present speed.

        If a sample shows that the crank turns back or has reached the angle, the device is restored to its state before
        the call. Return whether to try another hop.
        """
        now = self.now()
        left, speed = turn * _TURN + angle - now[CRANK_ANGLE], now[MOTOR_SPEED]
        if left < _NEAR or speed <= 0.0 or self.time + 0.5 * left / speed > latest:
            return False
        time, restored, log = self.time, self._restored, self.events.mark()
        kept = [part.copy() for part in self.lasting()]
        trace = self.new_trace(_SEEN)
        self._advance(np.linspace(time, time + 0.5 * left / speed, _SEEN + 1)[1:], trace)
        turns, phase, rate = trace.phases.T
        if (rate > 0.0).all() and ((turns - turn) * _TURN + phase < angle).all():
            return True
        self.time = time
        for part, values in zip(self.lasting(), kept, strict=True):
            part[...] = values
        self.lasting_overwritten()
        self._restored = restored
        self.events.drop_since(log)
        return False

    def _go_to(self, time: float) -> None:
        """Advance to `time` [s], across all edges of a patch, and sample there."""
        advance = self._advance if time <= self.time + _FIRST_PART else self.advance
        self._instant[0] = time
        while advance(self._instant, self._trace) == 0:
            self._cross_edge()
            self._instant[0] = time

    def now(self) -> np.ndarray:
        """Return the values of all `FIELDS` of `Samples` now, shape (fields,); the next call overwrites them."""
        if not self._sampled:
            self.advance_to(self.time)
        if self._values is None and self._cuts_forces:
            self._values = np.concatenate(list(self.quantities(self._instant, self._trace).values()))
        elif self._values is None:
            self._values = self._readout.values(self._instant, self._trace)
        return self._values

    @property
    def steps(self) -> int:
        """Number of segments of the event loop, or of steps of fixed length, so far."""
        return int(self.state.now["automaton"]["segments"][0])

    @property
    def energy(self) -> dict[str, dict[str, float]]:
        """The `energy_accounts` [J], if the scene asks for them: see `Simulator.statistics`."""
        if not self.scene["solver.accounts"]:
            return {}
        return {"energy_accounts": energy_accounts(self.model, self.state, self.time)}

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
        done, part = 0, _FIRST_PART
        while done < len(times):
            until = self.time + max(part, 4.0 * math.ulp(self.time))
            if times[-1] <= until:
                return done + self._advance(times[done:], trace.part(done, len(times)))
            upto, began = int(np.searchsorted(times, until, side="right")), wall_clock.perf_counter()
            if upto == done:
                reached = self._advance(np.array([until]), self.new_trace(1)) == 1
            else:
                done += self._advance(times[done:upto], trace.part(done, upto))
                reached = done == upto
            if not reached:
                return done
            part *= _PART / max(wall_clock.perf_counter() - began, _PART / _GROWTH)
        return done

    def _advance(self, times: np.ndarray, trace: Trace) -> int:
        """Advance as `advance` does, but in one part, during which Python handles no signal."""
        self._sampled, self._values = False, None
        end, status, sampled = float(times[-1]), event_loop.EVENTS_FULL, 0
        while status == event_loop.EVENTS_FULL:
            begun = self._mode_began()
            status, taken, count = self._stepper.advance(self.state, times, self.point, *trace, self._room)
            sampled += taken
            if count:
                self.events.add(self._room[:count])
            if status == event_loop.EVENTS_FULL:
                times, trace = times[taken:], trace.part(taken, len(times))
                if self._mode_began() - begun < _PROGRESS:
                    status = event_loop.STUCK
        if status == event_loop.SYSTEM_ENDS:
            return sampled
        if status != event_loop.REACHED:
            self._fail(status, self.state)
        self.time = end
        return sampled

    def _advance_filtered(self, times: np.ndarray, trace: Trace, filtered: np.ndarray) -> int:
        """Advance as `advance` does, and fill in the filtered acceleration at each instant.

        `_advance` and `filtered_acceleration` in turn would do the same, but cost more.
        """
        assert isinstance(self._stepper, Exact)
        advance, filter_rates, state, lowpass = (
            self._stepper.advance, self._stepper.filter_rates, self.state, self.state.lowpass)
        points, modes, phases = trace
        quadratures, done = np.zeros((len(times), len(lowpass))), len(times)
        self._sampled, self._values = False, None
        for k, time in enumerate(times.tolist()):
            one = slice(k, k + 1)
            status, taken, count = advance(state, times[one], self.point, points[one], modes[one], phases[one],
                                           self._room)
            if count:
                self.events.add(self._room[:count])
            if status != event_loop.REACHED and (status == event_loop.SYSTEM_ENDS or not self._advance(
                    times[one], trace.part(k, k + 1))):
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

    def quantities(self, times: np.ndarray, trace: Trace) -> dict[str, np.ndarray]:
        """Return the fields of `Samples` at `times` [s] from the trace that `advance` has filled."""
        quantities = self._readout.quantities(times, trace)
        if self._cuts_forces:
            cut_to_laws(self.scene, self.model.forms.pressed_only, quantities)
        return quantities


def first_reached(p: np.ndarray, value: float, start: float, end: float) -> float | None:
    """Return the first x from `start` to `end`, within -1 to 1, where the polynomial sum of p[n] x^n reaches `value`
    from below; None if there is none."""
    coefficients = p.tolist()
    bend = sum(n * (n - 1) * abs(coefficient) for n, coefficient in enumerate(coefficients))  # of p'' on [-1, 1]
    parts = [(start, end)]  # to search, the first one last
    while parts:
        low, high = parts.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        position, slope = _value_and_slope(coefficients, middle)
        if position - value + (abs(slope) + 0.5 * bend * half) * half < 0.0:
            continue
        at_low, at_high = (_value_and_slope(coefficients, x)[0] for x in (low, high))
        if at_low >= value:
            return low
        if abs(slope) > bend * half or half < _NARROWEST:  # it rises or falls throughout
            if at_high >= value:
                return _crossing(coefficients, value, low, high)
            continue
        parts += [(middle, high), (low, middle)]
    return None


def _value_and_slope(p: list[float], x: float) -> tuple[float, float]:
    value = slope = 0.0
    for coefficient in reversed(p):
        value, slope = value * x + coefficient, slope * x + value
    return value, slope


def _crossing(p: list[float], value: float, low: float, high: float) -> float:
    """Return where p, which rises from `low` to `high`, reaches `value`, by Newton's method or else by halving."""
    x = high
    while high - low > _NARROWEST:
        position, slope = _value_and_slope(p, x)
        low, high = (low, x) if position >= value else (x, high)
        step = (position - value) / slope if slope > 0.0 else math.inf
        if abs(step) < _NARROWEST:
            break
        x = x - step if low < x - step < high else 0.5 * (low + high)
    return x


def carried_over(model: Model, state: State, point: np.ndarray, new_model: Model) -> tuple[State, np.ndarray]:
    """Return state and channels of `new_model` that continue those of `model` at a segment's end.

    The scenes of the two models differ only in friction coefficients, pushes and numbers of the motor, so that
    coordinates, sliders and plates are the same. The states of the ground may differ, because a coefficient of 0 has
    no states of friction. A state that does not hold any more, such as sticking, is left at the first event.

    Parameters
    ----------
    model : Model
        The compiled scene so far.
    state : State
        State of `model`; not changed.
    point : ndarray, shape (channels of `model`,)
        Every channel now.
    new_model : Model
        The compiled scene from now on.

    Returns
    -------
    State, ndarray, shape (channels of `new_model`,)
        State and channels from which a segment begins.
    """
    old = model.modes[int(state.now["automaton"]["mode"][0])]
    contacts, turns = old.states[:len(model.forms.plates)], 0.0
    if model.forms.has_rotor:
        turns = point[model.forms.channels.velocity(model.forms.phase)]
    bearing = ("stuck", "turns_forward", "turns_backward")[int(np.sign(turns))]
    speed = point[model.forms.channels.velocity(model.forms.body)] if model.forms.body_moves else 0.0
    moving = ("stick", "slip_forward", "slip_backward")[int(np.sign(speed))]
    mode = next(number for ground in (old.ground, moving, "grounded") for turning in (old.motor[0], bearing, "turns")
                for number, one in enumerate(new_model.modes) if one.ground == ground
                and one.states[:len(contacts)] == contacts and one.motor == (turning, old.motor[1]))
    new = new_state(new_model.system, 0.0, state.ramp["value"], mode)._replace(lowpass=state.lowpass)
    for name in ("now", "ramp", "monitor"):
        getattr(new, name)[...] = getattr(state, name)
    new.now["automaton"]["mode"] = mode
    channels, new_point = new_model.forms.channels, np.zeros(new_model.forms.channels.count)
    kept = channels.ramp_rate(channels.ramps)  # later channels are set when the segment begins
    new_point[:kept] = point[:kept]
    return new, new_point
