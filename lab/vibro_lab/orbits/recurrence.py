"""Settled motion of a start, identified by recurrence: its states at the cut come back to earlier states.

A motion that repeats itself after p turns is identified by p and its p states, which a start approaches to rounding.
Any other motion, quasi-periodic or chaotic, is identified by a cloud of its states. A start has settled to it when the
last turns have the same cloud as the turns before; two starts have the same motion when half of the states of the one
are near the cloud of the other.

The controller of a dc motor samples at instants that are not in step with the turns. So even a motion in step with the
crank repeats only as closely as the position of the cut between two samples allows: its states at the cut form a short
curve. There a start has settled when the states of each turn of the period, over the second half of all turns, lie
within `JITTER` of each other and do not drift. Two motions, or a period and its double, that are closer than `JITTER`
are not distinguished.

The idea that a motion is identified as soon as its states come back is that of G. Datseris and A. Wagemakers,
Effortless estimation of basins of attraction, Chaos 32 (2022) 023104. They divide the state space into cells and share
the visited cells among all starts. Here each start is judged by itself, so that its motion does not depend on earlier
starts or on the number of processes; and there are no cells, whose size would affect the result.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from vibro_lab.orbits.turn_map import Cuts, Stroboscope, free_cut, has_sampled_controller
from vibro_ros import PARAMETERS, Scene

LONGEST_PERIOD = 64
"""Longest period that `settle` looks for [turns]; a motion without such a period may have a longer one."""
WATCHED = 8192
"""Turns for which `long_cycle` watches a motion; it finds periods up to a quarter of these."""
FIRST_TURNS, MOST_TURNS = 64, 4096
"""Turns after which a start is judged for the first time, and after which it counts as not settled."""
CLOSE = 1e-6
"""Largest remaining distance of a settled periodic start from its motion, in units of the machine, extrapolated from
its approach."""
SAME = 1e-5
"""Largest distance between states of the same periodic motion, in units of the machine."""
JITTER = 5e-3
"""The same for a dc motor with a controller, whose samples are not in step with the turns. Periodic motions of
`machine`, at 1000 samples a second, come back within 2e-3, its motions without a period within 0.4."""
LEAST_WATCHED = 2 * LONGEST_PERIOD
"""Fewest cuts from which `motion_of` identifies a motion without a period."""
KEPT_STATES = 32
"""Number of states of a motion without a period that a study keeps: enough to tell two clouds apart, and a row stays
small."""
CLOUD = 256
"""Number of states that identify a motion without a period, and least number of turns in each of its clouds."""
_ROUNDING = 1e-9  # in units of the machine: fifty times the rounding error after a motion's period of many turns
_DRIFT = 0.25  # of the jitter, between the means of two quarters: what is left of an approach is a few times as much
_STATIONARY_SHARE = 0.8  # a motion whose returns shrink from quarter to quarter to less than this is still settling
# Largest median distance of a motion's states from a cloud of the same motion: in distances between neighbours of the
# cloud, or in extents of the cloud. The first fails where the cloud lingers near a point, the second where it is thin.
_NEIGHBOURS, _EXTENT = 3.0, 0.05
_LEAST_EXTENT = 1e-3  # least extent of a coordinate, in units of the machine, because it may be held


class NotSettledError(RuntimeError):
    """The motion of a start still changes; the message says after how many turns."""


@dataclass(frozen=True)
class SettledMotion:
    """Motion that a start has settled to."""

    # Turns of the crank after which the motion repeats itself; 0 where it has no period up to `LONGEST_PERIOD`.
    turns: int
    # Shape (m, n): states at successive cuts, in units of the machine: one period, or `CLOUD` states of a motion
    # without a period. The last state is the device's present one.
    states: np.ndarray
    # Mean speed of the body [m/s], forwards positive: over one period, or over the second half of all turns.
    mean_speed: float
    after: int  # turns of the crank during which the start was observed
    # Largest distance between states of the same motion, in units of the machine: `SAME`, or twice `JITTER`.
    tolerance: float = SAME

    def is_same(self, other: "SettledMotion") -> bool:
        """Whether two starts have settled to the same motion; both must have been observed with one turn map."""
        if self.turns != other.turns:
            return False
        if self.turns:
            return bool(np.abs(other.states - self.states[0]).max(axis=1).min() <= self.tolerance)
        return bool(other._cloud.holds(self.states) or self._cloud.holds(other.states))

    def kept_states(self) -> np.ndarray:
        """States that a study keeps: one period, or the last `KEPT_STATES` of a motion without a period."""
        return self.states[-(self.turns or KEPT_STATES):]

    @cached_property
    def _cloud(self) -> "Cloud":
        return Cloud(self.states)


def settle(stroboscope: Stroboscope, first: int = FIRST_TURNS, most: int = MOST_TURNS) -> SettledMotion | None:
    """Advance a device until it has settled, and return its motion; None if it has not within `most` turns.

    It is judged for the first time after `first` turns, at least 8; then after twice as many, and so on up to `most`. A
    periodic start has settled when the rest of its approach, extrapolated as a geometric series from the last two
    quarters of all turns, is below `CLOSE`; for a controller that takes samples see the module's docstring. Transient
    chaos that lasts long cannot be distinguished from chaos that stays.
    """
    scene, cuts = stroboscope.turn_map.scene, stroboscope.turns(first)
    while True:
        turns = period_in(cuts.states, scene)
        if turns or (len(cuts.states) >= 4 * CLOUD and _is_stationary(cuts.states)):
            over = turns or len(cuts.states) // 2
            if turns and has_sampled_controller(scene):  # average over many positions of the cut between two samples
                over = turns * (len(cuts.states) // (2 * turns))
            distance, duration = (float(column[-1] - column[-1 - over]) for column in (cuts.positions, cuts.times))
            return SettledMotion(turns, cuts.states[-(turns or CLOUD):].copy(), distance / duration, len(cuts.states),
                                 tolerance_of(scene))
        missing = min(2 * len(cuts.states), most) - len(cuts.states)
        if missing <= 0:
            return None
        next_cuts = stroboscope.turns(missing)
        cuts = Cuts(*map(np.concatenate, zip(cuts, next_cuts, strict=True)))


def motion_of(states: np.ndarray, mean_speed: float, scene: Scene) -> SettledMotion | None:
    """Identify the motion of a start that was observed for a fixed time; None if it still changes.

    `states` are those at successive cuts, in units of the machine, shape (cuts, n); a motion without a period needs
    `LEAST_WATCHED` cuts.
    """
    turns = period_in(states, scene)
    if not turns and (len(states) < LEAST_WATCHED or not _is_stationary(states)):
        return None
    return SettledMotion(turns, states[-(turns or len(states)):], mean_speed, len(states), tolerance_of(scene))


def period_in(states: np.ndarray, scene: Scene) -> int:
    """Period [turns] of states at successive cuts, shape (cuts, n); 0 if they have no period or have not settled."""
    return _period_within_jitter(states) if has_sampled_controller(scene) else period_of(states)


def tolerance_of(scene: Scene) -> float:
    """Largest distance between states of the same motion of a scene, in units of the machine."""
    return 2.0 * JITTER if has_sampled_controller(scene) else SAME


def settled_motion(scene: Scene, **start: float) -> SettledMotion:
    """Return the motion that a scene settles to at `motor.speed` from a start of your choice.

    Parameters
    ----------
    scene : Scene
        Its motor has a constant `motor.speed` or `motor.voltage`.
    start : float
        Changes of the scene's own start: names and SI units [m, m/s, rad] of `Simulator.set_state`.

    Returns
    -------
    SettledMotion
        With its period in turns of the crank, `turns`, and `mean_speed` [m/s].

    Raises
    ------
    ValueError
        For a start that is not possible, or a crank that stands.
    NotSettledError
        When the motion has not settled within `MOST_TURNS` turns.
    SimulationError
        If the run cannot go on.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 160.0})
    >>> for speed in (0.0, 1.0):
    ...     motion = vibro_lab.settled_motion(scene, body_velocity=speed)
    ...     print(f"{motion.mean_speed * 1e3:.4f} mm/s, the same again after {motion.turns} turns")
    -79.8016 mm/s, the same again after 3 turns
    -53.5766 mm/s, the same again after 3 turns
    """
    stroboscope = Stroboscope(free_cut(scene))
    stroboscope.begin_as(**start)
    if motion := settle(stroboscope):
        return motion
    raise NotSettledError(f"{scene.name}: at {command_in_words(scene)} nothing has settled within {MOST_TURNS} turns "
                          "of the crank; without losses nothing ever does")


def command_in_words(scene: Scene) -> str:
    """Commanded motor speed or voltage of a scene, with its unit, as text."""
    name = scene.motor_command.replace("_", ".")
    return f"{scene[name]:g} {PARAMETERS[name].unit}"


def number_among(motion: SettledMotion, known: Sequence[SettledMotion]) -> int | None:
    """Index of the first of the `known` motions that is the same as `motion`; None if there is none."""
    return next((number for number, other in enumerate(known) if motion.is_same(other)), None)


def long_cycle(stroboscope: Stroboscope) -> np.ndarray | None:
    """States of one period that is longer than `LONGEST_PERIOD`, shape (turns, n); None if none is up to `WATCHED` / 4.

    The device stands at a cut of the motion; it is advanced.
    """
    states = stroboscope.turns(WATCHED).states
    turns = period_of(states, WATCHED)
    return states[-turns:] if turns else None


def period_of(states: np.ndarray, longest: int = LONGEST_PERIOD) -> int:
    """Least number of turns after which states at cuts, shape (cuts, n), repeat themselves.

    0 if they have no period or have not settled. No period above `longest`, or a quarter of the states, is tried.
    """
    quarter = len(states) // 4
    for turns in range(1, min(longest, quarter) + 1):
        late, early = _returns(states, turns)
        if late <= _ROUNDING or (late < min(early, CLOSE) and quarter / turns * late * late / (early - late) <= CLOSE):
            return next(part for part in range(1, turns + 1)
                        if turns % part == 0 and np.abs(states[-turns:] - states[-turns - part:-part]).max() <= SAME)
    return 0


def _period_within_jitter(states: np.ndarray) -> int:
    """Least number of turns after which states come back within `JITTER`; 0 without such a period or if not settled.

    States have not settled if the means of the last two quarters differ, or if they approach a motion of a shorter
    period.
    """
    quarter = len(states) // 4
    for turns in range(1, min(LONGEST_PERIOD, quarter // 4) + 1):
        turn_by_turn = [states[-2 * quarter + first::turns] for first in range(turns)]
        if any((np.ptp(of_turn, axis=0) > JITTER).any() for of_turn in turn_by_turn):
            continue
        drifts = [np.abs(np.subtract(*(part.mean(axis=0) for part in np.array_split(of_turn, 2)))).max()
                  for of_turn in turn_by_turn]
        shrinking = (_returns(states, part) for part in range(1, turns) if turns % part == 0)
        settled = max(drifts) <= _DRIFT * JITTER and all(late >= _STATIONARY_SHARE * early for late, early in shrinking)
        return turns if settled else 0
    return 0


class Cloud:
    """States of a motion without a period, shape (k, n), with a test whether other states are near them."""

    def __init__(self, states: np.ndarray):
        self._extent = np.maximum(np.ptp(states, axis=0), _LEAST_EXTENT)
        self._tree = KDTree(states / self._extent)
        neighbours = float(np.median(self._tree.query(states / self._extent, k=2)[0][:, 1]))
        self._reach = max(_EXTENT, _NEIGHBOURS * neighbours)

    def holds(self, states: np.ndarray) -> np.ndarray:
        """Whether `states` of other starts, shape (..., m, n), belong to the same motion: half of them are near."""
        return np.median(self._tree.query(states / self._extent)[0], axis=-1) <= self._reach


def _returns(states: np.ndarray, turns: int) -> tuple[float, float]:
    """Largest difference between states `turns` turns apart, in the last quarter of all cuts and in the quarter before.
    """
    quarter = len(states) // 4
    late = np.abs(states[-quarter:] - states[-quarter - turns:-turns]).max()
    early = np.abs(states[-2 * quarter:-quarter] - states[-2 * quarter - turns:-quarter - turns]).max()
    return float(late), float(early)


def _is_stationary(states: np.ndarray) -> bool:
    """Whether a motion without a period has settled: its smallest returns do not shrink, and its cloud stays."""
    late, early = min((_returns(states, turns) for turns in range(1, LONGEST_PERIOD + 1)), key=lambda pair: pair[0])
    quarter = len(states) // 4
    return late > _STATIONARY_SHARE * early and bool(Cloud(states[-2 * quarter:-quarter]).holds(states[-quarter:]))
