"""Special points over two parameters: the equations that a curve of them solves, and Newton's method for these.

The unknowns are the state and both parameters. The equations are those of an orbit, which comes back, and one more that
says what is special (Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, section 10.3; W. Govaerts, Numerical
Methods for Bifurcations of Dynamical Equilibria, SIAM 2000). With the derivative A of the turn map this is

- at a fold or a period doubling: g = 0 of the bordered system [A -+ 1, b; c, 0] [v; g] = [0; 1], which is regular
  there, with b and c from a neighbour's null vectors w and v;
- at a grazing: the mass turns back at its plate. From the side without the contact, where the map is smooth, its
  distance from the plate is made 1e-6 crank radii, and the point is carried on to 0 by the derivative, which leaves an
  error of the square.

The first needs derivatives of A, which are second differences of the map: they decide how fast Newton's method
converges, not where to.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.branch import family_of
from vibro_ros.orbits.continuation import DOUBLING, FOLD, GRAZING
from vibro_ros.orbits.family import LONGEST_STEP, LostError, derivative
from vibro_ros.orbits.orbit import CLOSED
from vibro_ros.orbits.passage import EventOrder, Miss, Passage, least_gap, ordered, passage
from vibro_ros.orbits.turn_map import TURN, TurnMap, direction
from vibro_ros.simulation.motion import SimulationError

FOLLOWED = (FOLD, DOUBLING, GRAZING)
"""Kinds of special points that have curves."""
_CRITICAL = {FOLD: 1.0, DOUBLING: -1.0}
_MISS = 1e-6  # crank radii, at which grazing orbits are computed
_MET = 1e-7  # largest defect of the second equation; rounding of the derivative makes 1e-10 to 1e-8
_STEP = 1e-4  # of differences, in units of the machine: with `fine`, rounding / step is the larger error, 1e-10
_MOST_ITERATIONS, _SLOW = 16, 0.1
_APART = 0.3  # rad, farthest that a step moves the instant of a grazing
_DEPTHS = (1e-5, 1e-4, 1e-3, 1e-2)  # crank radii, from which a grazing is approached where the prediction touches


class Plane:
    """What comes back after `turns` turns, for each pair of values of two parameters.

    Parameters
    ----------
    scene : Scene
        The machine.
    ranges : mapping of str to (float, float)
        Two parameters and their ranges, in their units.
    turns : int
        Turns of the crank after which orbits repeat themselves.
    phase : float
        Crank angle at the cut [rad].
    units : ndarray, shape (n,)
        What 1 is of each coordinate [m, m/s, rad/s or A], everywhere.

    Raises
    ------
    ValueError
        For other than two parameters, one that is no number, a range that is none, or a value that the scene refuses.
    """

    def __init__(self, scene: Scene, ranges: Mapping[str, tuple[float, float]], turns: int, phase: float,
                 units: np.ndarray):
        if len(ranges) != 2:
            raise ValueError(f"ranges: {len(ranges)} parameters; give two, such as "
                             "{'motor.speed': (95.0, 115.0), 'upper.gap': (0.0, 0.002)}")
        for name, (low, high) in ranges.items():
            family_of(scene, name, low, high, turns, phase)
        self.scene, self.ranges, self.turns, self.phase, self.units = scene, dict(ranges), turns, phase, units
        first, second = ranges
        self.names = (first, second)
        self._low, self._high = np.array(list(ranges.values()), dtype=float).T
        self._map_at = lru_cache(16)(self._made)

    def values(self, shares: np.ndarray) -> np.ndarray:
        """The parameters at shares of their ranges, in their units, shape (2,)."""
        return self._low + shares * (self._high - self._low)

    def shares(self, values: np.ndarray) -> np.ndarray:
        """The shares of the ranges at values of the parameters, shape (2,)."""
        return (values - self._low) / (self._high - self._low)

    def map_at(self, shares: np.ndarray) -> TurnMap:
        """The turn map there (ValueError where the scene refuses the values)."""
        return self._map_at(*shares.tolist())

    def _made(self, *shares: float) -> TurnMap:
        values = self.values(np.array(shares)).tolist()
        turn_map = TurnMap(self.scene.with_parameters(dict(zip(self.names, values, strict=True))), self.phase)
        turn_map.units = self.units
        return turn_map

    def residual(self, vector: np.ndarray) -> np.ndarray:
        """By how much the state does not come back, shape (n,); 0 of what something holds."""
        found = self.map_at(vector[-2:])(vector[:-2], self.turns).state - vector[:-2]
        return np.where(self.free(vector)[:-2], found, 0.0)

    def free(self, vector: np.ndarray) -> np.ndarray:
        """Which unknowns nothing holds, shape (n + 2,) of bool."""
        return np.append(~self.map_at(vector[-2:]).held(vector[:-2]), [True, True])

    def mean_speed(self, vector: np.ndarray) -> float:
        """Of the body [m/s]."""
        end = self.map_at(vector[-2:])(vector[:-2], self.turns)
        return end.advance / end.duration

    def order(self, vector: np.ndarray) -> EventOrder:
        """The order of the events between the cut and `turns` turns later."""
        return ordered(self.map_at(vector[-2:]), vector[:-2], self.turns)[1]

    def passage(self, vector: np.ndarray) -> Passage:
        """What happens from the cut over `turns` turns."""
        return passage(self.map_at(vector[-2:]), vector[:-2], self.turns)

    def jacobian(self, vector: np.ndarray) -> np.ndarray:
        """Derivative of the residual, shape (n, n + 2)."""
        return derivative(self.map_at, vector, self.turns, ~self.free(vector)[:-2], fine=True, longest=_STEP)

    def recut(self, phase: float, vectors: list[np.ndarray]) -> tuple["Plane", list[np.ndarray]]:
        """The same equations cut at another phase, and there the states to which the given ones lead."""
        other, found = Plane(self.scene, self.ranges, self.turns, phase, self.units), []
        for vector in vectors:
            here, there = self.map_at(vector[-2:]), other.map_at(vector[-2:])
            here.put(here.device, vector[:-2])
            here.advance(here.device, 0, phase)
            found.append(np.append(there.read(here.device.state), vector[-2:]))
        return other, found


class Frame(NamedTuple):
    """What the second equation refers to: null vectors of a fold or doubling; plate and instant of a grazing."""

    left: np.ndarray
    right: np.ndarray
    side: str = ""
    angle: float = 0.0  # rad of the crank, counted over all turns


class _Second(NamedTuple):
    """The second equation at a point: its defect, its derivative by all unknowns, and its frame there."""

    defect: float
    slope: Callable[[], np.ndarray]
    frame: Frame


@dataclass(frozen=True)
class CurvePoint:
    """One orbit of a curve.

    Attributes
    ----------
    plane : Plane
        The equations, with the cut that was used.
    kind : str
        Of `FOLLOWED`.
    vector, tangent : ndarray, shape (n + 2,)
        State, in units of the machine, and shares of the parameters; unit vector along the curve.
    exact : ndarray, shape (n + 2,)
        The same as `vector`, but of a grazing at the distance 0.
    matrix : ndarray, shape (n + 1, n + 2)
        Derivative of the equations.
    frame : Frame
        What the second equation refers to.
    multipliers : ndarray of complex, shape (n,)
        Floquet multipliers, the largest first.
    passage : Passage
        Its events.
    mean_speed : float
        Of the body [m/s].
    """

    plane: Plane
    kind: str
    vector: np.ndarray
    tangent: np.ndarray
    exact: np.ndarray
    matrix: np.ndarray
    frame: Frame
    multipliers: np.ndarray
    passage: Passage
    mean_speed: float

    @property
    def values(self) -> np.ndarray:
        """The parameters, in their units, shape (2,)."""
        return self.plane.values(self.exact[-2:])


def _second(plane: Plane, kind: str, vector: np.ndarray, matrix: np.ndarray, frame: Frame | None) -> _Second:
    """The second equation, where the first one has the derivative `matrix`."""
    if kind == GRAZING:
        miss = _miss(plane, vector, frame)
        angle = _angle(plane, vector, miss) % (TURN * plane.turns)
        return _Second(_distance(plane, vector, miss) - _MISS, lambda: _distance_slope(plane, vector, miss),
                       Frame(np.zeros(0), np.zeros(0), miss.side, angle))
    n = len(vector) - 2
    turn = matrix[:, :n] + np.eye(n)
    singular = turn - _CRITICAL[kind] * np.eye(n)
    if frame is None:
        u, _, v = np.linalg.svd(singular)
        frame = Frame(u[:, -1], v[-1])
    bordered = np.block([[singular, frame.left[:, None]], [frame.right[None, :], np.zeros((1, 1))]])
    last = np.append(np.zeros(n), 1.0)
    right, left = np.linalg.solve(bordered, last), np.linalg.solve(bordered.T, last)
    own = Frame(left[:n] / np.linalg.norm(left[:n]), right[:n] / np.linalg.norm(right[:n]))
    return _Second(float(right[n]), lambda: _derivative_slope(plane, vector, -left[:n], right[:n]), own)


def _reach(seen: Passage, longest: float) -> float:
    """A step of differences of higher order, which stays on one side of all grazings."""
    return max(1e-6, min(longest, 0.005 * seen.softest**2, 0.1 * seen.miss))


def _derivative_slope(plane: Plane, vector: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """l' (dA/dz) r for each unknown z, shape (n + 2,), by second differences; A is the map's derivative."""
    step, n = _reach(plane.passage(vector), _STEP), len(vector) - 2
    free, size, row = plane.free(vector), float(np.linalg.norm(right)), np.zeros(n + 2)
    along = np.append(right / size, [0.0, 0.0]) * free
    for i in np.flatnonzero(free):
        unit = np.eye(n + 2)[i]
        ends = [plane.residual(vector + step * (a * unit + b * along)) for a in (1, -1) for b in (1, -1)]
        row[i] = left @ (ends[0] - ends[1] - ends[2] + ends[3]) * size / (4.0 * step**2)
    return row


def _miss(plane: Plane, vector: np.ndarray, frame: Frame | None) -> Miss:
    """Where the mass turns back that grazes its plate (LostError if it touches the plate)."""
    found, around = plane.passage(vector).misses, TURN * plane.turns

    def apart(miss: Miss) -> float:
        if frame is None:
            return miss.gap
        return abs((_angle(plane, vector, miss) - frame.angle + 0.5 * around) % around - 0.5 * around)

    near = min((miss for miss in found if frame is None or miss.side == frame.side), key=apart, default=None)
    if near is None or apart(near) > _APART:
        raise LostError("the mass touches its plate, or does not turn back before it")
    return near


def _angle(plane: Plane, vector: np.ndarray, miss: Miss) -> float:
    """Crank angle [rad], counted on from the cut's, at which a mass turns back."""
    turn_map = plane.map_at(vector[-2:])
    (turns,), _ = turn_map.shares(vector[:-2], np.array([0.5 * (miss.first + miss.last)]), np.zeros(1))
    return plane.phase + direction(turn_map.scene) * float(turns) * TURN


def _distance(plane: Plane, vector: np.ndarray, miss: Miss) -> float:
    """From the plate where a mass turns back, in crank radii."""
    turn_map = plane.map_at(vector[-2:])
    return least_gap(turn_map, vector[:-2], miss) / turn_map.length


def _distance_slope(plane: Plane, vector: np.ndarray, miss: Miss) -> np.ndarray:
    """Derivative of a distance, shape (n + 2,)."""
    free = plane.free(vector)
    step, row = max(1e-9, 0.1 * min(_STEP, _distance(plane, vector, miss))), np.zeros(len(vector))
    for i in np.flatnonzero(free):
        moved = np.zeros(len(vector))
        moved[i] = step
        row[i] = (_distance(plane, vector + moved, miss) - _distance(plane, vector - moved, miss)) / (2.0 * step)
    return row


def corrected(plane: Plane, kind: str, guess: np.ndarray, normal: np.ndarray, frame: Frame | None,
              away: np.ndarray | None = None) -> tuple[CurvePoint, int]:
    """The special point on the plane through `guess` that is perpendicular to `normal`, and Newton's iterations.

    Parameters
    ----------
    plane : Plane
        The equations.
    kind : str
        Of `FOLLOWED`.
    guess, normal : ndarray, shape (n + 2,)
        State and shares; the plane's normal, and about the direction of the tangent.
    frame : Frame or None
        Of a neighbour.
    away : ndarray, shape (n + 2,), optional
        Where to, in this plane, a grazing has the distance 1 from its plate.

    Raises
    ------
    LostError
        Where Newton's method does not converge.
    """
    at, row, best, last, step = guess, None, np.inf, None, np.zeros_like(guess)
    sideways = np.zeros_like(guess) if away is None else away
    depths = iter(_DEPTHS if kind == GRAZING and away is not None else ())
    found: tuple[np.ndarray, np.ndarray, _Second] | None = None
    try:
        for iteration in range(_MOST_ITERATIONS):  # noqa: B007  (its last value is returned)
            try:
                matrix = plane.jacobian(at)
                second = _second(plane, kind, at, matrix, frame)
            except LostError:
                if last is not None:
                    step = 0.5 * step
                    at = last - step
                    continue
                depth = next(depths, None)
                if depth is None:
                    raise
                at = guess + depth * sideways
                continue
            defects = plane.residual(at)
            size = max(float(np.abs(defects).max()) / CLOSED, abs(second.defect) / _MET)
            if best <= 1.0 and size >= 0.25 * best:  # as good as rounding lets it become
                break
            if row is None or size > _SLOW * best:
                row = second.slope()
            if size < best:
                best, found = size, (at, np.vstack([matrix, row]), second)
            last, step = at, plane.free(at) * np.linalg.solve(np.vstack([matrix, row, normal]), np.append(
                defects, [second.defect, normal @ (at - guess)]))
            at = last - step
            if not np.all(np.isfinite(at)) or np.abs(at - guess).max() > 10.0 * LONGEST_STEP:
                break
        if found is not None and best <= 1.0:
            return _point(plane, kind, *found, normal), iteration
    except (np.linalg.LinAlgError, SimulationError, ValueError) as error:
        raise LostError(str(error)) from error
    raise LostError(f"Newton's method does not find a {kind} near {where(plane, guess)}")


def where(plane: Plane, vector: np.ndarray) -> str:
    """The parameters in words."""
    return ", ".join(f"{name} = {value:.9g}" for name, value in
                     zip(plane.names, plane.values(vector[-2:]).tolist(), strict=True))


def _point(plane: Plane, kind: str, vector: np.ndarray, matrix: np.ndarray, second: _Second,
           along: np.ndarray) -> CurvePoint:
    """The curve's point at a solution of the equations."""
    n = len(vector) - 2
    *_, rows = np.linalg.svd(matrix)
    # Rounding must not move what is held: a body at a height of -6e-27 m is refused.
    tangent = plane.free(vector) * (rows[-1] if rows[-1] @ along >= 0.0 else -rows[-1])
    exact = vector
    if kind == GRAZING:
        exact = vector - (_MISS + second.defect) * plane.free(vector) * np.linalg.solve(
            np.vstack([matrix, along]), np.eye(n + 2)[n])
    multipliers = np.linalg.eigvals(matrix[:n, :n] + np.eye(n))
    multipliers = multipliers[np.argsort(-np.abs(multipliers), kind="stable")]
    speed = 2.0 * plane.mean_speed(vector) - plane.mean_speed(2.0 * vector - exact)  # carried on as `exact` is
    return CurvePoint(plane, kind, vector, tangent, exact, matrix, second.frame, multipliers,
                      plane.passage(vector), speed)


def away(point: CurvePoint, normal: np.ndarray) -> np.ndarray:
    """Where to, across `normal`, the second equation grows by 1; what something holds stays."""
    found = np.linalg.solve(np.vstack([point.matrix, normal]), np.eye(len(normal))[-2])
    return np.where(point.plane.free(point.vector), found, 0.0)
