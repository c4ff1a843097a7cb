"""The turn map: the state of a device one or more turns of its crank after a given one; where to cut it; many turns.

The map is cut at a phase of the crank. The state there is made of the masses' positions and velocities and the body's
velocity, in a scene whose body hops of its height and vertical velocity too. The body's place along the ground is none
of it, because nothing depends on it; how far a turn moves the body comes beside the state. The motor is steady.

States are counted in units of the machine, so that no coordinate outweighs another: lengths in `crank.radius` l,
velocities in l omega. Whatever lets a device run raises a SimulationError if the run cannot go on.

A good cut is a phase of the crank where nothing touches and nothing happens. A cut that lies within a contact, or at an
instant where the friction changes, makes the map rough: two states that are close could be in different modes there.
"""

import math
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

TURN = 2.0 * math.pi
SEEN = 64
"""Turns that are looked at for a cut."""
SETTLED = 200
"""Turns that a scene is given to settle, from its own start, before they are looked at."""
CELLS = 4096
"""Parts of a turn in which events are told apart."""
_CONTACT = "_contact"


class TurnEnd(NamedTuple):
    """Where a turn leads.

    Attributes
    ----------
    state : ndarray, shape (n,)
        In units of the machine.
    advance : float
        How far the body has moved [m], forwards positive.
    """

    state: np.ndarray
    advance: float


class TurnMap:
    """The turn map of a scene, cut at a phase of the crank.

    Parameters
    ----------
    scene : Scene
        With a `motor.speed` other than 0, which is held. A crank that turns backwards moves the robot in another way.
    phase : float
        Crank angle [rad] at the cut, from 0 to 2 pi.

    Attributes
    ----------
    scene, phase
        The parameters.
    names : tuple of str
        Names of the state's coordinates, fields of `Samples`.
    units : ndarray, shape (n,)
        What 1 is of each coordinate [m or m/s].
    period : float
        Time of a turn [s].
    device : Simulator
        Of the scene; each call puts it into another state.

    Raises
    ------
    ValueError
        For a scene whose crank stands, or has a dc motor, with which no turn takes as long as another.
    """

    def __init__(self, scene: Scene, phase: float = 0.0):
        speed = scene["motor.speed"]
        if scene.has_rotor:
            raise ValueError("effects.motor: a dc motor's crank has no steady speed, and orbits, exponents and basins "
                             "are those of a steady crank; choose ideal, ramp or lag")
        if speed == 0.0:
            raise ValueError(f"motor.speed: {speed:g} rad/s turns no crank; give the speed at which the motion repeats "
                             "itself")
        self.scene, self.phase, self.period = scene, phase, turn_time(scene)
        self.names = coordinates(scene)
        length = scene["crank.radius"] or max(scene[f"crank.{side}_rod"] for side in scene.guides)
        self.units = np.array([length * abs(speed) if name.endswith("velocity") else length for name in self.names])
        self.device = Simulator(scene)
        self._start = self.device.checkpoint()

    def __call__(self, state: np.ndarray, turns: int = 1) -> TurnEnd:
        """Where `turns` turns lead from `state`, shape (n,) (ValueError for a state that cannot be)."""
        self.put(self.device, state)
        self.device.advance_to(turns * self.period)
        return TurnEnd(self.read(self.device.state), self.device.state.body_position)

    def put(self, device: Simulator, state: np.ndarray) -> None:
        """Put a device of the scene at its time 0 into a state at the cut, the body at 0."""
        device.restore(self._start)
        device.set_state(crank_angle=self.phase, body_position=0.0,
                         **dict(zip(self.names, (state * self.units).tolist(), strict=True)))

    def read(self, sample: Samples[float]) -> np.ndarray:
        """The state of a device, shape (n,)."""
        return np.array([getattr(sample, name) for name in self.names]) / self.units

    def sample(self, state: np.ndarray) -> Samples[float]:
        """All quantities of a device in a state at the cut, the body at 0."""
        self.put(self.device, state)
        return self.device.state

    def held(self, state: np.ndarray) -> np.ndarray:
        """Which coordinates something holds in `state`, shape (n,) of bool: friction a body that stands, the ground a
        body that does not hop, a rigid plate a mass. A disturbance of these is gone at once."""
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


def turn_time(scene: Scene) -> float:
    """Time [s] of a turn of the crank, whichever way it turns."""
    return TURN / abs(scene["motor.speed"])


def direction(scene: Scene) -> float:
    """1, or -1 where the crank turns backwards."""
    return math.copysign(1.0, scene["motor.speed"])


def share_of_turn(scene: Scene, here: float, there: float) -> float:
    """Part of a turn, from 0 to 1, that takes the crank from the angle `here` to the next `there` [rad]."""
    return direction(scene) * (there - here) % TURN / TURN


def coordinates(scene: Scene) -> tuple[str, ...]:
    """Fields of `Samples` that make up a state at the cut."""
    masses = [f"{side}_{what}" for side in scene.guides for what in ("position", "velocity")]
    return (*masses, *["body_velocity"] * scene.body_moves,
            *["body_height", "body_vertical_velocity"] * scene.body_hops)


class Cuts(NamedTuple):
    """A device at successive cuts.

    Attributes
    ----------
    states : ndarray, shape (cuts, n)
        In units of the machine, as `TurnMap` has them.
    positions : ndarray, shape (cuts,)
        Of the body along the ground [m], forwards positive.
    """

    states: np.ndarray
    positions: np.ndarray


class Stroboscope:
    """A device of a turn map's scene that runs on, seen once a turn.

    `TurnMap` puts a device into a state for every turn, which costs as much as twenty turns. A stroboscope puts the
    device once and lets it run on.

    Parameters
    ----------
    turn_map : TurnMap
        Scene, cut and units.

    Raises
    ------
    ValueError
        For a scene in which nothing moves but the crank.
    """

    def __init__(self, turn_map: TurnMap):
        if not turn_map.names:
            raise ValueError(f"{turn_map.scene.name or 'scene'}: nothing moves in it but the crank; give it "
                             "effects.upper_mass or effects.inclined_mass")
        self.turn_map = turn_map
        self._device = Simulator(turn_map.scene)
        self._start = self._device.checkpoint()
        self._cut = 0.0  # s, the last cut

    def begin(self, state: np.ndarray) -> None:
        """Begin at the cut, in a state of shape (n,), the body at 0 (ValueError for a state that cannot be)."""
        self.turn_map.put(self._device, state)
        self._cut = 0.0

    def begin_as(self, **given: float) -> Cuts:
        """Begin as the scene starts, but with what is `given`, and go on to the first cut.

        `given` is as `Simulator.set_state` takes it, in SI units (ValueError for a state that cannot be). The first cut
        lies within the first turn, or is the start itself.
        """
        self._device.restore(self._start)
        if given:
            self._device.set_state(**given)
        ahead = share_of_turn(self.turn_map.scene, self._device.state.crank_angle, self.turn_map.phase)
        self._cut = (ahead - 1.0) * self.turn_map.period
        return self.turns(1)

    def turns(self, count: int) -> Cuts:
        """Go on over `count` turns; the cuts that follow the last one."""
        times = self._cut + np.arange(1, count + 1) * self.turn_map.period
        samples = self._device.sample(times)
        self._device.take_events()  # or they would be kept
        self._cut = float(times[-1])
        states = np.column_stack([getattr(samples, name) for name in self.turn_map.names]) / self.turn_map.units
        return Cuts(states, samples.body_position)


def free_phase(scene: Scene, device: Simulator) -> tuple[float, float]:
    """The phase farthest from all events of the coming `SEEN` turns, and the share of a turn that is free around it.

    Parameters
    ----------
    scene : Scene
        What the device simulates.
    device : Simulator
        It has settled; it is advanced by `SEEN` turns.

    Returns
    -------
    float, float
        Crank angle [rad], from 0 to 2 pi, and the share: 0 where every phase of the turn is within a contact, and the
        phase is one that is within the fewest.
    """
    period = turn_time(scene)
    device.take_events()
    begin, angle = device.time, device.state.crank_angle
    device.advance_to(begin + SEEN * period)
    events = device.take_events()
    phase = np.mod((events["time"] - begin) / period + direction(scene) * angle / TURN, 1.0)
    of_contact = np.char.endswith(events["kind"], _CONTACT)
    lasting = np.where(of_contact, events["duration"], 0.0) / period
    busy = events_in_cells(phase, lasting)
    ahead, share = middle_of_longest(busy == busy.min(), free=bool(busy.min() == 0.0))
    return direction(scene) * ahead % TURN, share


def free_cut(scene: Scene) -> TurnMap:
    """The turn map of a scene, cut where the motion from its own start is free (ValueError for a crank that stands)."""
    TurnMap(scene)  # refuses a crank that stands
    device = Simulator(scene)
    device.advance_to(SETTLED * turn_time(scene))
    return TurnMap(scene, free_phase(scene, device)[0])


def events_in_cells(phase: np.ndarray, lasting: np.ndarray) -> np.ndarray:
    """How many events fall on each of the `CELLS` of a turn, shape (CELLS,).

    Parameters
    ----------
    phase, lasting : ndarray, shape (events,)
        Where in a turn an event begins, from 0 to 1, and for how much of turns it lasts; dimensionless.
    """
    count = np.zeros(CELLS)
    for first, last in zip(phase * CELLS, (phase + np.minimum(lasting, 1.0)) * CELLS, strict=True):
        count[np.arange(int(first), int(last) + 1) % CELLS] += 1.0
    return count


def middle_of_longest(quiet: np.ndarray, free: bool) -> tuple[float, float]:
    """Middle [rad] of the longest run of cells that are `quiet`, on the circle, and its share of the turn."""
    if quiet.all():
        return 0.0, 1.0
    start = int(np.flatnonzero(~quiet)[0])  # count from where a run cannot go on across
    turned = np.concatenate([[False], np.roll(quiet, -start), [False]])
    edges = np.flatnonzero(turned[1:] != turned[:-1]).reshape(-1, 2)
    first, last = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    middle = (start + 0.5 * (first + last)) / len(quiet) % 1.0
    return TURN * middle, (last - first) / len(quiet) if free else 0.0
