"""The turn map: the state of a device one or more turns of its crank after a given one.

The map is cut at a phase of the crank. The state there is made of the masses' positions and velocities and the body's
velocity, in a scene whose body hops of its height and vertical velocity too. The body's place along the ground is none
of it, because nothing depends on it; how far a turn moves the body comes beside the state. The motor is steady.

States are counted in units of the machine, so that no coordinate outweighs another: lengths in `crank.radius` l,
velocities in l omega.
"""

import math
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.event_order import LANDING, EventOrder, event_order
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

TURN = 2.0 * math.pi
_BESIDE = np.array([-2.0, 2.0])  # spacings of floats before and after a landing, whose instant is rounded


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
        With `motor.speed` above 0, which is held.
    phase : float
        Crank angle [rad] at the cut, from 0 to 2 pi.

    Attributes
    ----------
    scene : Scene
        The same.
    phase : float
        The same [rad].
    names : tuple of str
        Names of the state's coordinates, fields of `Samples`.
    units : ndarray, shape (n,)
        What 1 is of each coordinate [m or m/s].
    period : float
        Time of a turn [s].

    Raises
    ------
    ValueError
        For a scene whose crank stands.
    """

    def __init__(self, scene: Scene, phase: float = 0.0):
        speed = scene["motor.speed"]
        if speed <= 0.0:
            raise ValueError(f"motor.speed: {speed:g} rad/s turns no crank; give the speed at which the motion repeats "
                             "itself")
        self.scene, self.phase, self.period = scene, phase, TURN / speed
        self.names = coordinates(scene)
        length = scene["crank.radius"] or max(scene[f"crank.{side}_rod"] for side in scene.guides)
        self.units = np.array([length * speed if name.endswith("velocity") else length for name in self.names])
        self._device = Simulator(scene)
        self._start = self._device.checkpoint()

    def __call__(self, state: np.ndarray, turns: int = 1) -> TurnEnd:
        """Where `turns` turns lead from `state`, shape (n,).

        Raises
        ------
        ValueError
            For a state that cannot be.
        SimulationError
            If the run cannot go on.
        """
        self.put(self._device, state)
        self._device.advance_to(turns * self.period)
        return TurnEnd(self.read(self._device.state), self._device.state.body_position)

    def ordered(self, state: np.ndarray, turns: int = 1) -> tuple[TurnEnd, EventOrder]:
        """The same as a call, with the order of the events that have ended on the way."""
        device, end = self._device, turns * self.period
        self.put(device, state)
        start = device.checkpoint()
        device.take_events()
        device.advance_to(end)
        now, events = device.state, device.take_events()
        landings = events["time"][events["kind"] == LANDING]
        speeds = np.zeros((len(landings), 2))
        if len(landings):  # what a landing has made of the body's speed is not in its event
            device.restore(start)
            beside = landings[:, None] + _BESIDE * np.spacing(landings)[:, None]
            speeds = device.sample(beside.ravel()).body_velocity.reshape(-1, 2)
        return TurnEnd(self.read(now), now.body_position), event_order(events, end, speeds)

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
        self.put(self._device, state)
        return self._device.state

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


def coordinates(scene: Scene) -> tuple[str, ...]:
    """Fields of `Samples` that make up a state at the cut."""
    masses = [f"{side}_{what}" for side in scene.guides for what in ("position", "velocity")]
    return (*masses, *["body_velocity"] * scene.body_moves,
            *["body_height", "body_vertical_velocity"] * scene.body_hops)
