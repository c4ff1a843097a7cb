"""The command map of a machine: which motions it has at each motor speed and gap.

The map is a grid of cells over the motor's speed and the gap of the sides that are commanded together, and a row for
each motion that was found in a cell. `study map` makes maps, `controller` reads them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.parameters import BY_NAME, Value
from vibro_ros.model.scene import Scene

PATCHWORK = -1
"""Number of no motion: of cells that are too few together to make one, where what is found changes from cell to cell.
"""
# Where a motion settles does not depend on how motor and plates get to where they are commanded.
_FREE = ("start.", "solver.", "motor.", "effects.motor", "gap_actuator.")


@dataclass(frozen=True)
class Axis:
    """Equally spaced values.

    Attributes
    ----------
    low, high : float
        First and last value, in the unit of the command.
    count : int
        How many there are, at least 2.
    """

    low: float
    high: float
    count: int

    @property
    def step(self) -> float:
        """Distance of neighbours, in the unit of the command."""
        return (self.high - self.low) / (self.count - 1)

    @property
    def values(self) -> np.ndarray:
        """All values, shape (count,)."""
        return np.linspace(self.low, self.high, self.count)

    def nearest(self, value: float) -> int | None:
        """Index of the value nearest to `value`; None more than half a step outside."""
        index = round((value - self.low) / self.step) if math.isfinite(value) else -1
        return index if 0 <= index < self.count else None


@dataclass(frozen=True)
class Found:
    """The motions that were found, a row each: columns of shape (rows,).

    Attributes
    ----------
    speed_index, gap_index : ndarray of int
        Cell of the grid.
    motion : ndarray of int
        Number of the motion: equal in neighbouring cells where the motion changes little from one to the other;
        `PATCHWORK` where it has no number.
    turns : ndarray of int
        Turns of the crank after which it repeats itself; 0 where it does not.
    landings : ndarray of int
        Landings of the body within these turns; 0 where it does not repeat itself.
    sure : ndarray of int
        1 where the robot surely gets into this motion, whatever it did before: it is the only one that was found,
        repeats itself and has a number, and no trial has led to another one; else 0.
    mean_speed : ndarray
        Of the body [m/s], forwards positive.
    cost_of_transport : ndarray
        Mean power / (weight x speed), dimensionless; NaN where it has none.
    stick_share, air_share : ndarray
        Shares of the time in which the body stands on the ground, and is in the air, dimensionless.
    """

    speed_index: np.ndarray
    gap_index: np.ndarray
    motion: np.ndarray
    turns: np.ndarray
    landings: np.ndarray
    sure: np.ndarray
    mean_speed: np.ndarray
    cost_of_transport: np.ndarray
    stick_share: np.ndarray
    air_share: np.ndarray

    def describe(self, row: int) -> str:
        """One motion in words."""
        turns, landings = int(self.turns[row]), int(self.landings[row])
        kind = "without a period" if not turns else (
            f"period {turns} turn{'s' * (turns > 1)}, {landings} landing{'s' * (landings != 1)}")
        return f"{self.mean_speed[row] * 1e3:.0f} mm/s, {kind}"


@dataclass(frozen=True)
class Curve:
    """Where motions change their nature.

    Attributes
    ----------
    kind : str
        As `orbits` names it: fold, period doubling, Neimark-Sacker or grazing.
    turns : int
        Period of the motion [turns].
    motor_speed : tuple of float
        [rad/s], one a point.
    gap : tuple of float
        [m], one a point.
    """

    kind: str
    turns: int
    motor_speed: tuple[float, ...]
    gap: tuple[float, ...]


@dataclass(frozen=True)
class CommandMap:
    """The motions of a machine over motor speed and gap.

    Attributes
    ----------
    scene : str
        Name of the machine's scene.
    parameters : mapping of str to value
        All parameters of the scene that the motions depend on, besides the commands.
    sides : tuple of str
        Sides whose gaps are commanded, both alike if there are two.
    speeds, gaps : Axis
        The grid: motor speeds [rad/s] and gaps [m].
    found : Found
        The motions.
    curves : tuple of Curve
        Where they change their nature.
    """

    scene: str
    parameters: Mapping[str, Value]
    sides: tuple[str, ...]
    speeds: Axis
    gaps: Axis
    found: Found
    curves: tuple[Curve, ...]

    @property
    def commands(self) -> tuple[str, ...]:
        """The commands whose values are a place in the map."""
        return ("motor_speed", *(f"{side}_gap" for side in self.sides))

    def difference(self, scene: Scene) -> str:
        """The first parameter by which `scene` is another machine than the map's, in words; empty without any."""
        for name, value in self.parameters.items():
            if scene[name] != value:
                return f"{name} is {_shown(value)} there, {_shown(scene[name])} here"
        return ""

    def rows_at(self, commands: Mapping[str, float]) -> np.ndarray:
        """Rows of the motions at commands, in the units of the topics; none outside the map, or if the gaps differ."""
        gaps = [commands[f"{side}_gap"] for side in self.sides]
        if max(gaps) - min(gaps) > self.gaps.step / 2.0:
            return np.empty(0, dtype=int)
        speed, gap = self.speeds.nearest(commands["motor_speed"]), self.gaps.nearest(sum(gaps) / len(gaps))
        return np.flatnonzero((self.found.speed_index == speed) & (self.found.gap_index == gap))


def parameters_that_count(scene: Scene, sides: tuple[str, ...]) -> dict[str, Value]:
    """Parameters of a scene that its motions depend on: without commands, their actuators, the start and the solver."""
    free = (*_FREE, *(f"{side}.gap" for side in sides))
    return {name: scene[name] for name in BY_NAME if not name.startswith(free)}


def _shown(value: Value) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
