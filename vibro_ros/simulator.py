"""The stateful device: commands in, samples and events out."""

import functools
import math
import time as wall_clock
import warnings
from collections.abc import Iterator

import numpy as np

from vibro_ros.choice import Choice, Measured, choose, chosen
from vibro_ros.model.force_limits import cut_to_laws
from vibro_ros.model.laws import contact_laws
from vibro_ros.model.promise import broken_promise
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import MODE_EVENTS, compile_scene
from vibro_ros.samples import EVENT_DTYPE, Samples, sampled_quantities
from vibro_ros.solver import event_loop
from vibro_ros.solver import state as at
from vibro_ros.solver.forcing import read_signals
from vibro_ros.solver.methods import SCHEMES, Exact, FixedStep, Method
from vibro_ros.solver.recording import EVENT_COLUMNS, MONITOR_KIND, PHASE_KIND, RAMP_KIND

_EVENTS_AT_ONCE = 4096
#: Latest instant [s] that can be asked for, 31 years: there, doubles tell instants apart that are 1e-7 s apart.
LATEST = 1e9
#: Computing time [s] that a part of `Simulator.sample_in_parts` aims at; robot time [s] of the first; growth from one
#: to the next at most.
_PART, _FIRST_PART, _GROWTH = 0.004, 0.001, 100.0
#: After so many of its time constants a lagging motor has reached its speed, to rounding.
_TIME_CONSTANTS = 40.0

_CAUSES = {
    event_loop.STUCK: "events follow each other without any progress of time",
    event_loop.DIVERGED: "a coordinate is no longer finite",
    event_loop.ROOT_LOST: "the search for a guard's root did not end",
}


class ToleranceWarning(UserWarning):
    """The default `solver.tolerance` promises more than rounding lets be kept; an explicit one is refused."""


class SimulationError(RuntimeError):
    """A run that cannot go on; the message gives time, mode and cause."""


class Simulator:
    """The device, stepped in simulated time.

    What it holds does not grow with time, except for events: they are kept until `take_events` hands them over.

    Parameters
    ----------
    scene : Scene
        What to simulate.

    Attributes
    ----------
    scene : Scene
        What is simulated; with `solver.method` auto, by the method and step that were picked.
    choice : Choice or None
        What auto has picked, and why.
    time : float
        Simulated time [s], from 0.
    """

    def __init__(self, scene: Scene):
        if fault := broken_promise(scene):
            warnings.warn(fault, ToleranceWarning, stacklevel=2)
        self.choice: Choice | None = choose_method(scene) if scene["solver.method"] == "auto" else None
        self.scene = chosen(scene, self.choice) if self.choice else scene
        self.time = 0.0
        self._model = compile_scene(self.scene)
        self._method = self._new_method()
        self._point = np.zeros(self._model.forms.channels.count)
        self._state = self._start()
        self._room = np.empty((_EVENTS_AT_ONCE, EVENT_COLUMNS))
        self._events: list[np.ndarray] = []
        self._kinds = self._kind_names()
        self._counts = np.zeros(len(self._kinds), dtype=np.int64)

    def _new_method(self) -> Method:
        model, name, step = self._model, self.scene["solver.method"], self.scene["solver.step"]
        if name == "exact":
            return Exact(model.system)
        laws = contact_laws(self.scene, model.forms, model.modes, step) if name == "moreau" else None
        return FixedStep(model.system, SCHEMES[name], step, laws)

    def _start(self) -> at.State:
        model, scene = self._model, self.scene
        system, forms = model.system, model.forms
        plates = {side: scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] for side in forms.plates}
        state = at.new_state(system, scene["motor.speed"],
                             np.array([plates[side] for side in forms.plates]), model.initial_mode)
        position = np.zeros(forms.channels.coordinates)
        if scene["start.state"] == "rest":
            # The very bits that the flow uses: a mass at rest on its slider must feel no force at all.
            read_signals(system, state, position)
            for i, side in enumerate(forms.guides):
                position[i] = min(position[i], plates.get(side, math.inf))
        self._point[:len(position)] = position
        self._begin_segment(state)
        return state

    def _kind_names(self) -> np.ndarray:
        """Names of the kinds of recorded events, by their number."""
        names = np.zeros(PHASE_KIND + 1, dtype=EVENT_DTYPE["kind"])
        names[:len(MODE_EVENTS)] = MODE_EVENTS
        names[PHASE_KIND] = "motor_ramp_end"
        for k, side in enumerate(self._model.forms.plates):
            names[MONITOR_KIND + k], names[RAMP_KIND + k] = f"{side}_contact", "gap_reached"
        return names

    @property
    def state(self) -> Samples:
        """The device now: every field of `Samples` as one number."""
        arrays = self._sample(np.array([self.time]))
        return Samples(**{name: float(values[0]) for name, values in arrays.items()})

    def command(self, motor_speed: float | None = None, upper_gap: float | None = None,
                inclined_gap: float | None = None) -> None:
        """Ask for a motor speed [rad/s] and for gaps [m], from now on.

        The speed follows at once or on a ramp, as the scene's motor does; the plates move at
        `gap_actuator.speed`.

        Raises
        ------
        ValueError
            For a value that is not finite or beyond its limit; nothing is changed then.
        """
        speed = None if motor_speed is None else self.scene.checked_motor_speed(motor_speed)
        gaps = {side: self.scene.checked_gap(side, gap)
                for side, gap in (("upper", upper_gap), ("inclined", inclined_gap)) if gap is not None}
        self._method.interrupt(self._state, self.time, self._point)
        if speed is not None:
            self._command_speed(speed)
        for side, gap in gaps.items():
            if side in self._model.forms.plates:
                self._command_plate(side, self.scene[f"crank.{side}_rod"] + gap)
        self._begin_segment(self._state)

    def _command_speed(self, target: float) -> None:
        clock = self._state.clock
        clock[at.SPEED_TARGET] = target
        clock[at.SPEED_CHANGE] = clock[at.SPEED_TIME] = clock[at.LAG] = 0.0
        difference = target - clock[at.SPEED]
        if self.scene["effects.motor"] == "ideal":
            clock[at.SPEED] = target
        elif difference != 0.0 and self.scene["effects.motor"] == "lag":
            clock[at.LAG] = self.scene["motor.time_constant"]
            clock[at.SPEED_TIME] = _TIME_CONSTANTS * clock[at.LAG]
        elif difference != 0.0:
            clock[at.SPEED_CHANGE] = math.copysign(self.scene["motor.acceleration"], difference)
            clock[at.SPEED_TIME] = abs(difference) / self.scene["motor.acceleration"]

    def _command_plate(self, side: str, target: float) -> None:
        plate = self._model.forms.plates.index(side)
        ramp = self._state.ramp[plate]
        speed, difference = self.scene["gap_actuator.speed"], target - ramp[at.VALUE]
        rate = math.copysign(speed, difference) if difference != 0.0 else 0.0
        if rate != ramp[at.RATE]:  # else a mass that rests on the plate rests on
            ended = event_loop.release_from(self._model.system, self._state, plate, self._point, self._room, 0)
            self._keep(self._room[:ended])
        ramp[at.TARGET], ramp[at.RATE], ramp[at.TIME] = target, rate, abs(difference) / speed

    def checkpoint(self) -> np.ndarray:
        """All that the device's future depends on besides its scene and commands, for `restore`; shape (n,).

        Events that were not taken, and the counts of `statistics`, are not in it.
        """
        return np.concatenate([[self.time], *(part.ravel() for part in self._lasting())])

    def restore(self, checkpoint: np.ndarray) -> None:
        """Go on from a `checkpoint` of a device of the same scene, bit for bit as that one; also back in time.

        Raises
        ------
        ValueError
            For a checkpoint of another scene, as far as its size tells; nothing is changed then.
        """
        parts = self._lasting()
        size = 1 + sum(part.size for part in parts)
        if np.shape(checkpoint) != (size,):
            raise ValueError(f"the checkpoint has shape {np.shape(checkpoint)}, this device's have ({size},); give one "
                             "of the same scene and version")
        self.time, end = float(checkpoint[0]), 1
        for part in parts:
            part[...] = checkpoint[end:end + part.size].reshape(part.shape)
            end += part.size
        self._state.library.half[...] = 0.0  # no series there belongs to this state
        self._events.clear()

    def _lasting(self) -> list[np.ndarray]:
        return [self._point, *at.lasting(self._state), *self._method.memory]

    def _begin_segment(self, state: at.State) -> None:
        if not self._method.begin(state, self._point):
            self._fail(event_loop.ROOT_LOST, state)

    def _fail(self, status: int, state: at.State) -> None:
        mode, step = self._model.modes[state.index[at.MODE]], self.scene["solver.step"]
        remedy = "please report the scene" if self.scene["solver.method"] == "exact" else (
            f"{self.scene['solver.method']} may need a solver.step below {step:g} s, or use solver.method exact")
        raise SimulationError(f"at {state.clock[at.START]:.9g} s in mode {', '.join(mode.states)}: {_CAUSES[status]}; "
                              f"{remedy}")

    def advance_to(self, time: float) -> None:
        """Advance to the absolute instant `time` [s]; the trajectory does not depend on how time is cut up.

        Raises
        ------
        ValueError
            If `time` is not finite, lies before `self.time`, or beyond `LATEST`.
        SimulationError
            If the run cannot go on.
        """
        time = float(time)
        if not (math.isfinite(time) and time >= self.time):
            raise ValueError(f"cannot advance to {time:g} s: the device is at {self.time:g} s and time runs forwards")
        if time > LATEST:
            raise ValueError(f"cannot advance to {time:g} s: give at most {LATEST:g} s, beyond which clocks are coarse")
        self._advance(np.array([time]), *self._new_trace(1))

    def sample(self, times: np.ndarray) -> Samples:
        """Advance to each of `times` [s] in turn; the device there, every field of shape (n,).

        Raises
        ------
        ValueError
            If `times` is not one-dimensional, ascending and from `self.time` to `LATEST`.
        SimulationError
            If the run cannot go on.
        """
        times = checked_times(times, self.time)
        return Samples(**self._sample(times))

    def sample_in_parts(self, times: np.ndarray) -> Iterator[Samples | None]:
        """As `sample`, pausing after each part of some milliseconds of computation.

        Where it pauses depends on the machine; the trajectory does not, see `advance_to`.

        Yields
        ------
        None or Samples
            None after each part, and at last the samples.
        """
        times = checked_times(times, self.time)
        trace = self._new_trace(len(times))
        done, part = 0, _FIRST_PART
        while done < len(times):
            began = wall_clock.perf_counter()
            upto = int(np.searchsorted(times, self.time + part, side="right"))
            if upto == done:
                self.advance_to(self.time + part)
            else:
                self._advance(times[done:upto], *(array[done:upto] for array in trace))
            done = upto
            part *= _PART / max(wall_clock.perf_counter() - began, _PART / _GROWTH)
            yield None
        yield Samples(**self._quantities(times, *trace))

    def _sample(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """Advance to each of `times` [s], ascending, and return the fields of `Samples` there."""
        trace = self._new_trace(len(times))
        self._advance(times, *trace)
        return self._quantities(times, *trace)

    def _quantities(self, times: np.ndarray, *trace: np.ndarray) -> dict[str, np.ndarray]:
        """The fields of `Samples` from a filled trace."""
        quantities = sampled_quantities(self._model, times, *trace)
        if self.scene["solver.method"] != "exact":
            cut_to_laws(self.scene, quantities)
        return quantities

    def _new_trace(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Room for what the event loop samples at `count` instants: points, modes, phases."""
        return (np.empty((count, self._model.forms.channels.count)), np.empty(count, dtype=np.int64),
                np.empty((count, 3)))

    def _advance(self, times: np.ndarray, points: np.ndarray, modes: np.ndarray, phases: np.ndarray) -> None:
        """Advance to each of `times` [s], ascending, and fill the trace."""
        done, status = 0, event_loop.EVENTS_FULL
        while status == event_loop.EVENTS_FULL:
            status, taken, count = self._method.advance(self._state, times[done:], self._point, points[done:],
                                                        modes[done:], phases[done:], self._room)
            done += taken
            self._keep(self._room[:count])
        if status != event_loop.REACHED:
            self._fail(status, self._state)
        if done:
            self.time = float(times[-1])

    def _keep(self, events: np.ndarray) -> None:
        if len(events) == 0:
            return
        self._events.append(events.copy())
        self._counts += np.bincount(events[:, 1].astype(np.int64), minlength=len(self._counts))

    def take_events(self) -> np.ndarray:
        """Events completed since the last call, in the order in which they ended; dtype `EVENT_DTYPE`."""
        if not self._events:
            return np.empty(0, dtype=EVENT_DTYPE)
        raw = np.concatenate(self._events)
        self._events.clear()
        events = np.empty(len(raw), dtype=EVENT_DTYPE)
        events["time"], events["speed"], events["peak_force"], events["duration"] = raw[:, [0, 2, 3, 4]].T
        events["kind"] = self._kinds[raw[:, 1].astype(np.int64)]
        return events

    def _events_by_kind(self) -> dict[str, int]:
        counts: dict[str, int] = {}
        for kind in np.flatnonzero(self._counts):
            name = str(self._kinds[kind])
            counts[name] = counts.get(name, 0) + int(self._counts[kind])
        return counts

    @property
    def statistics(self) -> dict:
        """Events by kind; `steps`, the segments of the event loop; `solver.method`, and `solver.step` if it has one;
        and, with `solver.audit` and the method exact, the energy of the masses.

        `energy_residual` [J] is the part of the change of energy that the work of sliders, dampers and plates does not
        account for, `energy_exchanged` [J] the sum of these amounts of work.
        """
        method = {"solver.method": self.scene["solver.method"]}
        if method["solver.method"] != "exact":
            method["solver.step"] = self.scene["solver.step"]
        counts = {**self._events_by_kind(), "steps": int(self._state.index[at.SEGMENTS]), **method}
        if not self.scene["solver.audit"] or self.scene["solver.method"] != "exact":
            return counts
        return {**counts, "energy_residual": float(self._state.audit[at.RESIDUAL]),
                "energy_exchanged": float(self._state.audit[at.EXCHANGED])}


def kernel_count(method: str) -> int:
    """Number of kernels that `compile_kernels` sees to."""
    return 9 if method == "auto" else 6  # three of a family of methods, and three that all share


def compile_kernels(method: str = "exact") -> None:
    """Compile the numerical kernels of a `solver.method`, or load them from the cache, before a clock starts."""
    for name in ("exact", "rk4") if method == "auto" else (method,):  # all steps of fixed length are one kernel
        device = Simulator(Scene(parameters={"solver.method": name}))
        device.advance_to(0.001)
        device.command(motor_speed=1.0, upper_gap=0.001)
        device._sample(np.array([0.001]))


@functools.lru_cache(maxsize=64)
def choose_method(scene: Scene) -> Choice:
    """What `solver.method` auto picks for `scene`; the same in every process."""
    compile_kernels("auto")
    return choose(scene, _measure)


def _measure(scene: Scene, speed: float | None, times: np.ndarray) -> Measured:
    """For `choice.choose`."""
    device = Simulator(scene)
    try:
        if speed is not None:
            device.command(motor_speed=speed)
        samples = device.sample(times)
    except SimulationError:
        return Measured(np.full((4, len(times)), math.nan), 0, 0)
    return Measured(np.array([samples.body_position, samples.body_height, samples.upper_position,
                              samples.inclined_position]), device.statistics["steps"], len(device.take_events()))


def checked_times(times: np.ndarray, start: float) -> np.ndarray:
    """Copy of the instants `times` [s], shape (n,); a ValueError for any that make no sense or lie before `start`."""
    times = np.array(times, dtype=float)  # the caller's may change between parts
    if times.ndim != 1 or not np.isfinite(times).all() or (times < start).any() or (np.diff(times) < 0.0).any():
        raise ValueError("times: give a one-dimensional, ascending array of finite instants, none below "
                         f"{start:.9g} s")
    if (times > LATEST).any():
        raise ValueError(f"times: {times[-1]:g} s is too late; give instants up to {LATEST:g} s")
    return times
