"""Attractors: the motions that the starts of a scene lead to, with the shares of the starts and the exponents.

A mean speed over several motions is a speed that no robot has. So all code that runs a scene from several starts groups
them here, and prints an `Attractors`, which has no mean:

1. each start gives a `SettledMotion`, or None if it has not settled, and a mean speed [m/s];
2. `group_starts` distinguishes motions by one rule, `SettledMotion.is_same`: the same period and states within the
   tolerance, or without a period the same cloud of states. Starts that have not settled form one group, which also
   takes the starts of motions beyond the first `MOST_ATTRACTORS`;
3. `Attractors.in_words` is the text for a user, `Attractors.single` the attractor if there is only one;
4. `with_exponents` adds multipliers and Lyapunov exponents, which cost as much as some starts.

`attractors` does all of this for random starts of a scene, and names the motion that the scene's own start leads to.
"""

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.stats import binomtest

from vibro_lab.orbits.chaos import exponent_of_pairs, half_interval
from vibro_lab.orbits.orbit import fixed_point, orbit_at
from vibro_lab.orbits.recurrence import SettledMotion, number_among, settle
from vibro_lab.orbits.starts import SETTLING, drawn_start
from vibro_lab.orbits.turn_map import (
    Stroboscope,
    TurnMap,
    at_cut,
    free_cut,
    free_phase,
    has_sampled_controller,
    whole_number,
)
from vibro_ros import Scene, SimulationError, Simulator, core_count, in_processes

MOST_STARTS = 10_000
MOST_ATTRACTORS = 64
"""Largest number of motions that are distinguished. Without losses every start may have a motion of its own."""
MEASURED = 2000
"""Turns over which the Lyapunov exponent of a motion without multipliers is measured."""
_SAME_SPEED = 1e-6  # relative: a motion and its orbit have the same mean speed
_STEADY = 1e-9  # relative distance from the commanded speed at which the motor counts as steady
_WAIT = 1.0  # s
_OWN_START = ", the scene's own start"


@dataclass(frozen=True)
class Attractor:
    """A motion and the starts that lead to it."""

    # Turns of the crank after which the motion repeats itself; 0 for a motion without a period; None for the starts
    # that have not settled, or whose motions are beyond the first `MOST_ATTRACTORS`: their motions may differ.
    turns: int | None
    # Mean speed of the body [m/s], forwards positive: over the period of a periodic motion, else over all starts of the
    # group.
    mean_speed: float
    # Half the width of its 95 % confidence interval [m/s], by Student's distribution; 0 for a periodic motion, NaN for
    # a single start without a period, and for starts that have not settled, whose motions may differ.
    spread: float
    least: float  # least and largest mean speed of its starts [m/s]
    largest: float
    starts: int  # number of starts that lead to it; 0 if only the scene's own start does, which is not drawn
    share: float  # share of all starts that lead to it, and its 95 % confidence interval; dimensionless
    low: float
    high: float
    # Largest Lyapunov exponent [1/s]: from the multipliers, or else measured over `MEASURED` turns; -inf where every
    # disturbance vanishes within a period, NaN if it was not measured.
    exponent: float = math.nan
    # Half the width of its 95 % confidence interval [1/s]; 0 if it comes from the multipliers.
    exponent_spread: float = math.nan
    # Shape (n,): Floquet multipliers of the orbit, the largest first; empty for a motion without a period, for a dc
    # motor whose controller takes samples, and if Newton's method does not close the orbit.
    multipliers: np.ndarray = field(default_factory=lambda: np.empty(0, complex))
    # Shape (m, n): states at successive cuts, in units of the machine, as `SettledMotion.states`; empty if not settled.
    states: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    of_scene_start: bool = False  # whether the scene's own start leads to it; false where the own start was not run

    def in_words(self) -> str:
        """Return a text such as ``-79.80 mm/s, again after 3 turns``, or ``-45.468 ± 0.008 mm/s, without a period``.

        Starts that have not settled have the range of their mean speeds, ``-0.41 to 0.32 mm/s, not settled``.
        """
        if self.turns is None:
            ends = dict.fromkeys(f"{round(1e3 * speed, 2) + 0.0:.2f}" for speed in (self.least, self.largest))
            return f"{' to '.join(ends)} mm/s, not settled"
        spread, digits = self.spread * 1e3, 2
        if spread > 0.0:
            digits = max(0, -math.floor(math.log10(spread)))
        plus_minus = f" ± {spread:.{digits}f}" if spread > 0.0 else ""
        again = f"again after {self.turns} turn{'s' * (self.turns > 1)}" if self.turns else "without a period"
        return f"{self.mean_speed * 1e3:.{digits}f}{plus_minus} mm/s, {again}"


class Attractors(tuple[Attractor, ...]):
    """The attractors of a scene: those of most starts first, then the starts that have not settled.

    It has no mean speed, because several motions have no common one.
    """

    __slots__ = ()

    @property
    def single(self) -> Attractor | None:
        """The attractor that all starts lead to; None if there are several attractors."""
        return self[0] if len(self) == 1 else None

    @property
    def drawn(self) -> "Attractors":
        """Those to which random starts lead."""
        return Attractors(attractor for attractor in self if attractor.starts)

    def in_words(self) -> str:
        """Return the text for a user: each motion, and if there are several, the starts that lead to each."""
        if self.single:
            return self.single.in_words()
        total = sum(attractor.starts for attractor in self)
        return "; ".join(f"{attractor.in_words()} ({attractor.starts} of {total} starts, {100 * attractor.low:.0f} to "
                         f"{100 * attractor.high:.0f} %{_OWN_START * attractor.of_scene_start})" for attractor in self)


def share_of(starts: int, total: int) -> tuple[float, float, float]:
    """Share of starts, and its 95 % confidence interval (E. B. Wilson, J. Am. Stat. Assoc. 22 (1927) 209)."""
    interval = binomtest(starts, total).proportion_ci(method="wilson")
    return starts / total, float(interval.low), float(interval.high)


def group_starts(motions: Sequence[SettledMotion | None],
                 mean_speeds: Sequence[float]) -> tuple[Attractors, np.ndarray]:
    """Group starts by the motions that they lead to; returns the attractors and the index of each start's one.

    `motions` has the motion of each start at the cut of one turn map, None for a start that has not settled;
    `mean_speeds` are those of the body [m/s]. Multipliers and exponents are added by `with_exponents`.
    """
    numbers, distinct = [], list[SettledMotion]()
    for motion in motions:
        number = None if motion is None else number_among(motion, distinct)
        if motion is not None and number is None and len(distinct) < MOST_ATTRACTORS:
            number = len(distinct)
            distinct.append(motion)
        numbers.append(len(motions) if number is None else number)
    of_start = np.array(numbers, dtype=int)
    groups, count = np.unique(of_start, return_counts=True)
    order = sorted(range(len(groups)), key=lambda place: (groups[place] == len(motions), -count[place], groups[place]))
    grouped, places = list[Attractor](), np.empty(len(motions), dtype=int)
    for place, group in enumerate(order):
        is_in_group = of_start == groups[group]
        places[is_in_group] = place
        motion = None if groups[group] == len(motions) else distinct[groups[group]]
        grouped.append(_attractor(motion, np.asarray(mean_speeds)[is_in_group], len(motions)))
    return Attractors(grouped), places


def _attractor(motion: SettledMotion | None, speeds: np.ndarray, total: int) -> Attractor:
    group = (float(min(speeds)), float(max(speeds)), len(speeds), *share_of(len(speeds), total))
    if motion is None:
        return Attractor(None, float(np.mean(speeds)), math.nan, *group)
    if motion.turns:
        return Attractor(motion.turns, motion.mean_speed, 0.0, *group, states=motion.states)
    return Attractor(0, float(np.mean(speeds)), float(half_interval(speeds)), *group, states=motion.states)


def with_exponents(attractor: Attractor, turn_map: TurnMap) -> Attractor:
    """Return the attractor with its multipliers and exponent; unchanged if it has not settled."""
    if attractor.turns is None:
        return attractor
    multipliers = _multipliers(attractor, turn_map) if attractor.turns else np.empty(0, complex)
    if not len(multipliers):
        device = Simulator(turn_map.scene)
        turn_map.put(device, attractor.states[-1])
        exponent, spread = exponent_of_pairs(device, device.time, MEASURED * turn_map.period)
        return replace(attractor, exponent=exponent, exponent_spread=spread)
    largest = float(np.abs(multipliers).max())
    duration = attractor.turns * turn_map.turn_time(attractor.states[-1], attractor.turns)
    rate = math.log(largest) / duration if largest > 0.0 else -math.inf
    return replace(attractor, multipliers=multipliers, exponent=rate, exponent_spread=0.0)


def _multipliers(attractor: Attractor, turn_map: TurnMap) -> np.ndarray:
    """Floquet multipliers of a periodic motion, at a cut without events.

    Empty if Newton's method converges to another orbit or not at all, and with a controller that takes samples.
    """
    if has_sampled_controller(turn_map.scene):
        return np.empty(0, dtype=complex)
    device = Simulator(turn_map.scene)
    turn_map.put(device, attractor.states[-1])
    phase, _ = free_phase(turn_map.scene, device)
    free_map = TurnMap(turn_map.scene, phase)
    state = at_cut(turn_map, attractor.states[-1], free_map)
    try:
        point = fixed_point(free_map, state, attractor.turns or 1)
        orbit = point and orbit_at(free_map, point, attractor.turns or 1)
    except (SimulationError, ValueError):
        orbit = None
    if orbit and abs(orbit.mean_speed - attractor.mean_speed) <= _SAME_SPEED * abs(attractor.mean_speed) + 1e-9:
        return orbit.multipliers
    return np.empty(0, dtype=complex)


def attractors(scene: Scene, starts: int = 16) -> Attractors:
    """Return the motions that a scene settles to, at `motor.speed` or `motor.voltage`, from random starts and its own.

    Each start goes through three stretches of random motor speeds and gaps within its first second. The random numbers
    depend only on the start's number, so a larger number of starts includes those of a smaller one. The starts are
    computed on all cores. The scene's own start is one more: it names its motion (`Attractor.of_scene_start`), which is
    added if no random start leads to it, but it does not count in the shares.

    Parameters
    ----------
    scene : Scene
        Its crank turns.
    starts : int
        From 1 to `MOST_STARTS`.

    Returns
    -------
    tuple of Attractor
        The attractor of most starts first. There is no mean over several attractors; `in_words()` is the text for a
        user.

    Raises
    ------
    ValueError
        For a number of starts out of range, or a crank that stands.
    SimulationError
        If a run cannot go on.

    Examples
    --------
    >>> scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 160.0})
    >>> for one in vibro_lab.attractors(scene, starts=8):
    ...     print(f"{one.in_words()}: {one.share:.0%} of starts, exponent {one.exponent:.1f} 1/s")
    -79.80 mm/s, again after 3 turns: 75% of starts, exponent -7.5 1/s
    -53.58 mm/s, again after 3 turns: 25% of starts, exponent -11.3 1/s
    """
    starts = whole_number("starts", starts, 1, MOST_STARTS)
    turn_map = free_cut(scene)
    jobs = in_processes(partial(_settled, scene, turn_map.phase), range(-1, starts), min(core_count(), starts + 1))
    with closing(jobs):  # else an error's traceback would keep the workers alive until it is collected
        motions, speeds = zip(*(future.result() for _, future in jobs), strict=True)
    grouped, numbers = with_scene_start(motions, speeds)
    return Attractors(_measured_unsettled(attractor, scene, turn_map, number) if attractor.turns is None
                      else with_exponents(attractor, turn_map)
                      for attractor, number in zip(grouped, numbers, strict=True))


def with_scene_start(motions: Sequence[SettledMotion | None], mean_speeds: Sequence[float]
                     ) -> tuple[list[Attractor], list[int]]:
    """Group random starts, and name the motion of the scene's own start, which is the first of `motions`.

    Returns the attractors, last the motion of the own start if no random one leads to it, and the number of a start of
    each, -1 for the own start.
    """
    drawn, places = group_starts(motions[1:], mean_speeds[1:])
    grouped, numbers = list(drawn), [int(np.argmax(places == place)) for place in range(len(drawn))]
    _, all_places = group_starts([*motions[1:], motions[0]], [*mean_speeds[1:], mean_speeds[0]])
    same_motion = np.flatnonzero(all_places[:-1] == all_places[-1])
    if len(same_motion):
        place = int(places[same_motion[0]])
        grouped[place] = replace(grouped[place], of_scene_start=True)
        return grouped, numbers
    ((own,), _), (share, low, high) = group_starts(motions[:1], mean_speeds[:1]), share_of(0, len(motions) - 1)
    return [*grouped, replace(own, starts=0, share=share, low=low, high=high, of_scene_start=True)], [*numbers, -1]


def _settled(scene: Scene, phase: float, number: int) -> tuple[SettledMotion | None, float]:
    """Motion of a start, or None if it does not settle, and its mean speed [m/s], then over all turns.

    `number` is that of a random start, or -1 for the scene's own start.
    """
    stroboscope = Stroboscope(TurnMap(scene, phase))
    begin = stroboscope.begin_as() if number < 0 else stroboscope.begin_with(steady_start(scene, number))
    motion = settle(stroboscope)
    if motion:
        return motion, motion.mean_speed
    end = stroboscope.turns(1)
    return None, float((end.positions[-1] - begin.positions[-1]) / (end.times[-1] - begin.times[-1]))


def steady_start(scene: Scene, number: int) -> Simulator:
    """Return the device of random start `number` at `SETTLING`, or later, once motor and plates reached their commands.
    """
    device = drawn_start(scene, number)
    device.advance_to(SETTLING)
    speed = None if scene.has_rotor else scene["motor.speed"]
    while (device.state.upper_plate_velocity or device.state.inclined_plate_velocity
           or (speed is not None and abs(device.state.motor_speed - speed) > _STEADY * abs(speed))):
        device.advance_to(device.time + _WAIT)
    device.take_events()  # so that they do not accumulate
    return device


def _measured_unsettled(attractor: Attractor, scene: Scene, turn_map: TurnMap, number: int) -> Attractor:
    """Return the attractor of starts that have not settled with the exponent of one of them, as `_settled` numbers it.
    """
    device = Simulator(scene) if number < 0 else steady_start(scene, number)
    exponent, spread = exponent_of_pairs(device, device.time, MEASURED * turn_map.period)
    return replace(attractor, exponent=exponent, exponent_spread=spread)
