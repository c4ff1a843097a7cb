"""The turn map: the state of a device one or more turns of its crank after a given state; the choice of its cut.

The cut is a phase of the crank. The state at the cut has the masses' positions and velocities and the body's velocity;
in a scene whose body hops also its height and vertical velocity. The body's position along the ground is not part of
the state, because nothing depends on it; the distance that a turn moves the body is returned beside the state. The
motor's command is constant.

A motor whose speed is a given function of time turns the crank once in 2 pi / speed: the map is a stroboscopic map. The
crank of a dc motor is a coordinate:

- At a given voltage nothing depends on time, and the map is a Poincare map: the crank reaches the phase from below. The
  state includes the crank's speed, and the current of a winding with inductance. The duration of a turn follows from
  the state. The multiplier 1 of a shift in time does not occur.
- A controller samples the speed at instants that are not in step with the turns. So its motions repeat only as closely
  as the position of the cut between two samples allows. The state includes the controller's integral; each start begins
  with a sample. Such a device can be observed turn after turn, but this state alone has no derivative that would give
  the growth of a disturbance, and no orbit closes.

States are in units of the machine, so that no coordinate outweighs another: lengths in `crank.radius` l, velocities in
l omega; the speed of a dc motor's crank in omega, its current in K omega / R, the controller's integral in K omega or
K omega / R. omega is `motor.speed`, or at a given voltage the speed without load; K omega is the voltage that the crank
induces at this speed, R the winding's resistance. Every function that advances a device raises a SimulationError if the
run cannot go on.

A good cut is a phase of the crank without contacts and events. A cut within a contact, or at an instant where the
friction changes, makes the map non-smooth: two states that are close could be in different modes there.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibro_ros import LATEST_TIME, Samples, Scene, SimulationError, Simulator, check_scene, motor_coordinates

TURN = 2.0 * math.pi
SEEN = 64
"""Turns whose events decide where the cut lies."""
SETTLED = 200
"""Turns from the scene's own start that are left for settling before the cut is chosen."""
CELLS = 4096
"""Equal parts of a turn that are marked as free of events or not."""
_CONTACT = "_contact"
_LONGEST_TURN = 64.0  # turns without load: a crank that needs longer for one turn is taken to stand
_SAMPLES_PER_TURN = 256  # instants of a turn, between which the angle of an event is interpolated


class TurnEnd(NamedTuple):
    """Result of the turn map."""

    state: np.ndarray  # shape (n,): state at the cut after the turns, in units of the machine
    advance: float  # distance that the body has moved [m], forwards positive
    duration: float  # time that the turns have taken [s]


class TurnMap:
    """The turn map of a scene, cut at a phase of the crank.

    Parameters
    ----------
    scene : Scene
        Its crank turns, at `motor.speed` or by a constant `motor.voltage`. The crank may turn backwards at a given
        speed; the robot then moves differently.
    phase : float
        Crank angle [rad] at the cut, from 0 to 2 pi.

    Attributes
    ----------
    names : tuple of str
        Names of the state's coordinates, fields of `Samples`, and `controller_integral`.
    units : ndarray, shape (n,)
        Unit of each coordinate [m, m/s, rad/s, A or V].
    period : float
        Time of a turn [s]; with a dc motor the time of a turn at the unit of speed.
    device : Simulator
        Simulator of the scene; each call puts it into another state.
    """

    def __init__(self, scene: Scene, phase: float = 0.0):
        self.scene, self.phase, self.period = scene, phase, TURN / crank_speed(scene)
        self.names, self.units = state_names(scene), units_of(scene)
        self.device = Simulator(scene)
        if scene.has_rotor and self.device.scene["solver.method"] != "exact":
            raise ValueError(f"solver.method: {scene['solver.method']} does not find the instant at which a dc motor's "
                             "crank passes an angle; choose exact")
        self._start = self.device.checkpoint()

    def __call__(self, state: np.ndarray, turns: int = 1) -> TurnEnd:
        """Return the end of `turns` turns from `state`, shape (n,) (ValueError for a state that is not possible)."""
        self.put(self.device, state)
        self.advance(self.device, turns)
        return TurnEnd(self.read_device(self.device), self.device.state.body_position, self.device.time)

    def put(self, device: Simulator, state: np.ndarray) -> None:
        """Put a device of the scene into a state at the cut, at time 0 and body position 0."""
        given = dict(zip(self.names, (state * self.units).tolist(), strict=True))
        if not given.get("motor_speed", 1.0) > 0.0:
            raise ValueError(f"motor_speed: {given['motor_speed']:g} rad/s does not pass the cut; give a speed above 0")
        device.restore(self._start)
        device.set_state(crank_angle=self.phase, body_position=0.0, **given)

    def advance(self, device: Simulator, turns: int, phase: float | None = None) -> None:
        """Advance a device that was put at the cut over `turns` turns, and on to another `phase` [rad] if given."""
        phase = self.phase if phase is None else phase
        if self.scene.has_rotor:
            advance_to_cut(device, turns + (phase < self.phase), phase)
        else:
            device.advance_to((turns + share_of_turn(self.scene, self.phase, phase)) * self.period)

    def read_device(self, device: Simulator) -> np.ndarray:
        """State of a device, in units of the machine, shape (n,)."""
        return self.read(device.state, device.controller_integral)

    def read(self, sample: Samples[float], integral: float = 0.0) -> np.ndarray:
        """State of a sample and of the controller's integral [V or A], in units of the machine, shape (n,)."""
        return np.array([integral if name == INTEGRAL else getattr(sample, name) for name in self.names]) / self.units

    def cuts(self, device: Simulator, count: int) -> "Cuts":
        """Advance a device from any crank angle over the next `count` cuts, and return them."""
        if self.scene.has_rotor:
            first = math.ceil((device.state.crank_angle - self.phase) / TURN)
            return self.cuts_at_turns(device, range(first, first + count))
        ahead = share_of_turn(self.scene, device.state.crank_angle, self.phase)
        return self.cuts_at_times(device, device.time + (ahead + np.arange(count)) * self.period)

    def cuts_at_turns(self, device: Simulator, turns: Sequence[int]) -> "Cuts":
        """Advance a device with a dc motor to the cut of each of `turns`, ascending, and return these cuts."""
        states, positions, times = np.empty((len(turns), len(self.names))), np.empty(len(turns)), np.empty(len(turns))
        for number, turn in enumerate(turns):
            advance_to_cut(device, turn, self.phase)
            states[number], positions[number] = self.read_device(device), device.state.body_position
            times[number] = device.time
        return Cuts(states, positions, times)

    def cuts_at_times(self, device: Simulator, times: np.ndarray) -> "Cuts":
        """Advance a device whose motor's speed is given to the cuts at `times` [s], ascending, and return them."""
        samples = device.sample(times)
        states = np.column_stack([getattr(samples, name) for name in self.names]) / self.units
        return Cuts(states, samples.body_position, times)

    def shares(self, state: np.ndarray, times: np.ndarray, durations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Convert times after a state at the cut to turns of the crank.

        Returns the turns until each of `times` [s] after the cut, and the turns during the `durations` [s] that begin
        there.
        """
        if not self.scene.has_rotor:
            return times / self.period, durations / self.period
        self.put(self.device, state)
        instants = np.concatenate([times, times + durations])
        order, angles = np.argsort(instants), np.empty(len(instants))
        angles[order] = self.device.sample(instants[order]).crank_angle
        begins, ends = np.split((angles - self.phase) / TURN, 2)
        return begins, ends - begins

    def turn_time(self, state: np.ndarray, turns: int) -> float:
        """Mean time of a turn [s] over the `turns` turns that follow a state at the cut."""
        return self(state, turns).duration / turns if self.scene.has_rotor else self.period

    @property
    def length(self) -> float:
        """Unit of positions [m]."""
        return float(self.units[[name.endswith(("position", "height")) for name in self.names]].max(initial=0.0)
                     or _length(self.scene))

    @property
    def velocity(self) -> float:
        """Unit of velocities [m/s]."""
        return float(self.units[[name.endswith("velocity") for name in self.names]].max(initial=0.0)
                     or _length(self.scene) * crank_speed(self.scene))

    def sample(self, state: np.ndarray) -> Samples[float]:
        """All quantities of a device in a state at the cut, with the body at position 0."""
        self.put(self.device, state)
        return self.device.state

    def held(self, state: np.ndarray) -> np.ndarray:
        """Coordinates that are constrained in `state`, shape (n,) of bool.

        Friction holds a body that stands, the ground a body that does not hop, a rigid plate a mass that rests on it. A
        disturbance of these coordinates vanishes at once.
        """
        sample, held = self.sample(state), dict.fromkeys(self.names, False)
        if sample.body_velocity == 0.0 and not sample.body_height:
            held["body_velocity"] = True
        if sample.body_height == sample.body_vertical_velocity == 0.0:
            held["body_height"] = held["body_vertical_velocity"] = True
        for side in self.scene.plates:
            if (self.scene[f"effects.{side}_contact"] == "restitution"
                    and getattr(sample, f"{side}_position") == getattr(sample, f"{side}_plate_position")):
                held[f"{side}_position"] = held[f"{side}_velocity"] = True
        return np.array([held[name] for name in self.names])


def at_cut(turn_map: TurnMap, state: np.ndarray, other: TurnMap) -> np.ndarray:
    """Advance a state from the cut of a turn map to the next cut of another map; shape (n,)."""
    turn_map.put(turn_map.device, state)
    turn_map.advance(turn_map.device, 0, other.phase)
    return other.read_device(turn_map.device)


INTEGRAL = "controller_integral"


def direction(scene: Scene) -> float:
    """Sign of the crank's speed: 1, or -1 for backwards. A dc motor's is 1, because no turn map has it backwards."""
    return 1.0 if scene.has_rotor else math.copysign(1.0, scene["motor.speed"])


def share_of_turn(scene: Scene, angle: float, phase: float) -> float:
    """Part of a turn, from 0 to 1, from the crank's `angle` to its next passage of `phase` [rad]."""
    return direction(scene) * (phase - angle) % TURN / TURN


def state_names(scene: Scene) -> tuple[str, ...]:
    """Names of the coordinates of a state at the cut: fields of `Samples`, and `INTEGRAL` with a controller."""
    check_scene(scene)
    masses = [f"{side}_{quantity}" for side in scene.guides for quantity in ("position", "velocity")]
    return (*masses, *["body_velocity"] * scene.body_moves,
            *["body_height", "body_vertical_velocity"] * scene.body_hops,
            *["motor_speed"] * scene.has_rotor, *motor_coordinates(scene))


def crank_speed(scene: Scene) -> float:
    """Magnitude of the crank's speed [rad/s], above 0: of `motor.speed`, or at a given voltage the speed without load.
    """
    check_scene(scene)
    if scene.motor_command == "motor_voltage":
        constant, resistance = scene.motor_constant, scene["motor.winding_resistance"]
        driven = constant * scene["motor.voltage"] / resistance - scene["motor.friction"]
        speed = driven / (scene["motor.damping"] + constant**2 / resistance)
        if speed <= 0.0:
            raise ValueError(f"motor.voltage: {scene['motor.voltage']:g} V turns no crank forwards; give more than "
                             f"{scene['motor.friction'] * resistance / constant:g} V")
        return speed
    speed = scene["motor.speed"]
    if speed == 0.0:
        raise ValueError(f"motor.speed: {speed:g} rad/s turns no crank; give the speed at which the motion repeats "
                         "itself")
    if speed < 0.0 and scene.has_rotor:
        raise ValueError(f"motor.speed: {speed:g} rad/s turns a dc motor's crank backwards, whose turns are not looked "
                         "at; give a speed above 0, or choose effects.motor ideal, ramp or lag")
    return abs(speed)


def units_of(scene: Scene) -> np.ndarray:
    """Unit of each coordinate of a state [m, m/s, rad/s, A or V], shape (n,)."""
    speed = crank_speed(scene)
    induced = scene.motor_constant * speed if scene.has_rotor else 0.0
    volts = scene["motor.control"] == "speed_by_voltage"
    return np.array([
        speed if name == "motor_speed" else induced if name == INTEGRAL and volts else
        induced / scene["motor.winding_resistance"] if name in ("motor_current", INTEGRAL) else
        _length(scene) * speed if name.endswith("velocity") else _length(scene) for name in state_names(scene)])


def has_sampled_controller(scene: Scene) -> bool:
    """Whether a controller samples the crank's speed, at instants that are not in step with the turns."""
    return INTEGRAL in state_names(scene)


def check_closes(scene: Scene) -> None:
    """Raise a ValueError for a scene that has no periodic orbits, because its controller takes samples."""
    if has_sampled_controller(scene):
        raise ValueError(
            f"motor.control: {scene['motor.control']} takes samples {scene['motor.control_rate']:g} times a second, "
            "with which the turns are not in step, so that no orbit closes; choose voltage, or effects.motor ramp; "
            "settled_motion and study diagram, basins and map tell motions by their recurrence")


def whole_number(name: str, value: object, least: int, most: int) -> int:
    """Return `value` if it is an integer from `least` to `most`; else raise a ValueError that begins with `name`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise ValueError(f"{name}: {value!r} is out of range; give a whole number from {least} to {most}")
    return int(value)


def _length(scene: Scene) -> float:
    return scene["crank.radius"] or max(scene[f"crank.{side}_rod"] for side in scene.guides or ("upper",))


def advance_to_cut(device: Simulator, turn: int, phase: float) -> None:
    """Advance a device with a dc motor until its crank angle is `turn` full turns plus `phase` [rad]."""
    longest = _LONGEST_TURN * TURN / crank_speed(device.scene)
    if not device.advance_to_angle(turn, phase, min(device.time + longest, LATEST_TIME)):
        command = device.scene.motor_command.replace("_", ".")
        raise SimulationError(f"at {device.time:.9g} s: the crank has not come round for {longest:.3g} s; give more "
                              f"than {device.scene[command]:g} for {command}, or another start")


def turn_round(device: Simulator, turns: int) -> None:
    """Advance a device until its crank has made `turns` turns since the start, if it has made fewer."""
    if not device.scene.has_rotor:
        device.advance_to(max(device.time, turns * TURN / crank_speed(device.scene)))
    elif device.state.crank_angle < turns * TURN:
        for turn in range(math.floor(device.state.crank_angle / TURN) + 1, turns + 1):
            advance_to_cut(device, turn, 0.0)


class Cuts(NamedTuple):
    """States of a device at successive cuts."""

    states: np.ndarray  # shape (cuts, n): states in units of the machine, with the coordinates of `TurnMap`
    positions: np.ndarray  # shape (cuts,): positions of the body along the ground [m], forwards positive
    times: np.ndarray  # shape (cuts,): instants [s]


class Stroboscope:
    """A running device whose state is observed once a turn, at the cut.

    A call of `TurnMap` sets the device's state, which costs as much as twenty turns. A stroboscope sets the state once
    and lets the device run on.
    """

    def __init__(self, turn_map: TurnMap):
        if not turn_map.names:
            raise ValueError(f"{turn_map.scene.name or 'scene'}: nothing moves in it but the crank; give it "
                             "effects.upper_mass or effects.inclined_mass")
        self.turn_map = turn_map
        self._device = Simulator(turn_map.scene)
        self._start = self._device.checkpoint()
        self._cut = 0.0  # s, instant of the last cut ...
        self._turns = 0  # ... and, with a dc motor, the crank's turns until then

    def begin(self, state: np.ndarray) -> None:
        """Begin at the cut in `state`, shape (n,), the body at 0 (ValueError for a state that is not possible)."""
        self.turn_map.put(self._device, state)
        self._cut, self._turns = 0.0, 0

    def begin_as(self, **given: float) -> Cuts:
        """Begin with the scene's own start, changed by `given`, and advance to the first cut.

        `given` has the arguments of `Simulator.set_state`, in SI units (ValueError for a state that is not possible).
        The first cut lies within the first turn, or is the start itself.
        """
        self._device.restore(self._start)
        if given:
            self._device.set_state(**given)
        return self.begin_with(self._device)

    def begin_with(self, device: Simulator) -> Cuts:
        """Take over a device of the scene at any crank angle, its motor steady, and advance it to its first cut."""
        self._device, phase, angle = device, self.turn_map.phase, device.state.crank_angle
        self._turns = math.ceil((angle - phase) / TURN) - 1
        self._cut = device.time + (share_of_turn(self.turn_map.scene, angle, phase) - 1.0) * self.turn_map.period
        return self.turns(1)

    def turns(self, count: int) -> Cuts:
        """Advance over `count` turns, and return the cuts that follow the last one."""
        if self.turn_map.scene.has_rotor:
            cuts = self.turn_map.cuts_at_turns(self._device, range(self._turns + 1, self._turns + 1 + count))
        else:
            cuts = self.turn_map.cuts_at_times(self._device, self._cut + np.arange(1, count + 1) * self.turn_map.period)
        self._device.take_events()  # so that they do not accumulate
        self._cut, self._turns = float(cuts.times[-1]), self._turns + count
        return cuts


def free_phase(scene: Scene, device: Simulator) -> tuple[float, float]:
    """Crank phase farthest from all events of the next `SEEN` turns [rad], and the share of a turn around it without
    any.

    The device has settled; it is advanced. The share is 0 if no phase is free of events and contacts; the phase is then
    one of those with the fewest.
    """
    device.take_events()
    if scene.has_rotor:
        phase, lasting = _events_by_angle(device)
    else:
        period, begin, angle = TURN / crank_speed(scene), device.time, device.state.crank_angle
        device.advance_to(begin + SEEN * period)
        events = device.take_events()
        phase = np.mod((events["time"] - begin) / period + direction(scene) * angle / TURN, 1.0)
        lasting = np.where(_of_contact(events), events["duration"], 0.0) / period
    busy = events_in_cells(phase, lasting)
    middle, share = middle_of_longest(busy == busy.min(), free=bool(busy.min() == 0.0))
    return direction(scene) * middle % TURN, share


def free_cut(scene: Scene) -> TurnMap:
    """Turn map of a scene, cut where the motion from its own start has no events (ValueError for a crank that stands).
    """
    TurnMap(scene)  # refuses a crank that stands
    device = Simulator(scene)
    turn_round(device, SETTLED)
    return TurnMap(scene, free_phase(scene, device)[0])


def _of_contact(events: np.ndarray) -> np.ndarray:
    return np.char.endswith(events["kind"], _CONTACT)


def _events_by_angle(device: Simulator) -> tuple[np.ndarray, np.ndarray]:
    """Phases of the events of about the next `SEEN` turns of a dc motor's crank, from 0 to 1, and durations [turns]."""
    turn = math.floor(device.state.crank_angle / TURN) + 1
    advance_to_cut(device, turn, 0.0)
    begin = device.time
    advance_to_cut(device, turn + 1, 0.0)
    device.take_events()
    step = (device.time - begin) / _SAMPLES_PER_TURN
    samples = device.sample(device.time + np.arange(SEEN * _SAMPLES_PER_TURN + 1) * step)
    events = device.take_events()
    first = np.interp(events["time"], samples.time, samples.crank_angle / TURN)
    last = np.interp(events["time"] + events["duration"], samples.time, samples.crank_angle / TURN)
    return np.mod(first, 1.0), np.where(_of_contact(events), last - first, 0.0)


def events_in_cells(phase: np.ndarray, lasting: np.ndarray) -> np.ndarray:
    """Number of events in each of the `CELLS` of a turn, shape (CELLS,).

    An event begins at a `phase`, from 0 to 1, and is `lasting` so many turns.
    """
    count = np.zeros(CELLS)
    for first, last in zip(phase * CELLS, (phase + np.minimum(lasting, 1.0)) * CELLS, strict=True):
        count[np.arange(int(first), int(last) + 1) % CELLS] += 1.0
    return count


def middle_of_longest(quiet: np.ndarray, free: bool) -> tuple[float, float]:
    """Middle [rad] of the longest run of `quiet` cells on the circle, and its share of the turn; 0 if not `free`."""
    if quiet.all():
        return 0.0, 1.0
    start = int(np.flatnonzero(~quiet)[0])  # count from a cell that is not quiet, so that no run wraps around
    turned = np.concatenate([[False], np.roll(quiet, -start), [False]])
    edges = np.flatnonzero(turned[1:] != turned[:-1]).reshape(-1, 2)
    first, last = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    middle = (start + 0.5 * (first + last)) / len(quiet) % 1.0
    return TURN * middle, (last - first) / len(quiet) if free else 0.0
