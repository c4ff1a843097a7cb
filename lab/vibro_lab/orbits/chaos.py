"""Measures of chaos: Lyapunov exponents, from derivatives of the turn map along a motion.

A small sphere of states becomes an ellipsoid; the exponents are the growth rates of its axes. A QR decomposition after
every turn keeps the axes orthogonal: G. Benettin, L. Galgani, A. Giorgilli and J.-M. Strelcyn, Meccanica 15 (1980) 9-20
and 21-30; J.-P. Eckmann and D. Ruelle, Reviews of Modern Physics 57 (1985) 617-656, section V.

The derivatives are central differences of a map that is exact to rounding; they have seven correct digits. Where a mass
grazes a plate within a difference, the difference is a chord of the map's square root. When the body sticks or lands,
or a mass comes to rest, states that differed become equal: such a direction vanishes within a turn, and its exponent is
-inf.

Where no turn map is available, or for many starts, the largest exponent is measured with pairs of runs that begin close
together, at the cost of two runs.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import sem
from scipy.stats import t as student

from vibro_lab.orbits.orbit import derivative
from vibro_lab.orbits.recurrence import FIRST_TURNS, long_cycle, settle
from vibro_lab.orbits.recurrence import MOST_TURNS as MOST_SETTLING
from vibro_lab.orbits.turn_map import TURN, Stroboscope, TurnMap, check_closes, crank_speed, free_cut, whole_number
from vibro_ros import Scene, Simulator

LEAST_TURNS, MOST_TURNS = 20, 1_000_000
"""Smallest and largest number of turns over which exponents are measured."""
RESOLVED = 1e-7
"""Stretch of an axis in a turn, relative to the largest entry of the derivative, below which it counts as vanished."""
MOST_DOUBLINGS = 4
"""How often the number of turns is doubled, at most, until the sign of the largest exponent is known."""
REPEATED = 1024
"""Approximate number of turns for which the derivatives of a periodic motion are repeated."""
_PARTS = 10  # parts of a run whose means give the confidence interval
_ALIGNMENT_PARTS = 10  # one part in so many of the turns precedes, in which the axes align with the growing directions


@dataclass(frozen=True)
class LyapunovSpectrum:
    """Lyapunov exponents of a motion."""

    # Shape (n,): Lyapunov exponents [1/s], the largest first, one for each coordinate of `TurnMap`; -inf for a
    # direction that vanishes within a turn. The crank's angle and the body's position along the ground are not
    # coordinates; their exponents would be 0.
    exponents: np.ndarray
    # Shape (n,): half the width of 95 % confidence intervals [1/s], from the means of ten parts of the run; 0 for -inf,
    # and for a periodic motion.
    spread: np.ndarray
    turns: int  # turns of the crank over which the exponents were measured: the period of a periodic motion

    @property
    def sign(self) -> int:
        """Sign of the largest exponent, 1 or -1; 0 if it is not known, because 0 lies inside the interval."""
        return sign_of(float(self.exponents[0]), float(self.spread[0]))


def sign_of(value: float, spread: float) -> int:
    """Sign of a mean, 1 or -1; 0 if 0 lies inside its interval of half width `spread`."""
    return int(math.copysign(1.0, value)) if abs(value) > spread else 0


def lyapunov_spectrum(scene: Scene, turns: int = 500, settling: int = MOST_SETTLING) -> LyapunovSpectrum:
    """Compute all Lyapunov exponents of the motion that a scene settles to at `motor.speed`.

    Parameters
    ----------
    scene : Scene
        Its motor has a constant `motor.speed` or `motor.voltage`; the run begins in the scene's `start.state`.
    turns : int
        Turns of the crank over which a motion without a period is measured, from `LEAST_TURNS` to `MOST_TURNS`; 1000
        take about 4 s. If the sign of the largest exponent is not known after them, up to 16 times as many. For a
        periodic motion, one period is enough.
    settling : int
        Turns that the motion may take to settle, from `FIRST_TURNS` to `MOST_TURNS`. A motion that has not settled by
        then is measured as it is.

    Returns
    -------
    LyapunovSpectrum
        Exponents [1/s] with their intervals. A chaotic motion has a largest exponent above 0; a periodic one has the
        logarithms of its Floquet multipliers' magnitudes over its period, to about 1e-6 1/s.

    Raises
    ------
    ValueError
        For numbers of turns out of range, a crank that stands, or a controller that takes samples.
    SimulationError
        If the run cannot go on.

    Examples
    --------
    >>> for name in ("damped", "unilateral"):
    ...     spectrum = vibro_lab.lyapunov_spectrum(vibro_ros.load_scene(name), turns=100)
    ...     print(f"{name}: the largest is {'above' if spectrum.exponents[0] > 0.0 else 'below'} 0")
    damped: the largest is below 0
    unilateral: the largest is above 0
    """
    turns = whole_number("turns", turns, LEAST_TURNS, MOST_TURNS)
    settling = whole_number("settling", settling, FIRST_TURNS, MOST_TURNS)
    check_closes(scene)
    turn_map = free_cut(scene)
    stroboscope = Stroboscope(turn_map)
    stroboscope.begin_as()
    motion = settle(stroboscope, most=settling)
    if motion is not None and motion.turns:
        return spectrum_of_cycle(turn_map, motion.states)
    return spectrum_until_known(turn_map, stroboscope.turns(1).states[-1], turns)


def spectrum_until_known(turn_map: TurnMap, state: np.ndarray, turns: int) -> LyapunovSpectrum:
    """Compute the exponents of a motion without a period up to `LONGEST_PERIOD`, from a state at the cut, shape (n,).

    The largest exponent of a settled motion without a period is not below 0. So a longer period is searched for first;
    without one, `turns` is doubled, up to `MOST_DOUBLINGS` times, until 0 lies outside the interval.
    """
    stroboscope = Stroboscope(turn_map)
    stroboscope.begin(state)
    if (cycle := long_cycle(stroboscope)) is not None:
        return spectrum_of_cycle(turn_map, cycle)
    return spectrum_from(turn_map, state, turns, MOST_DOUBLINGS)


def spectrum_from(turn_map: TurnMap, state: np.ndarray, turns: int, doublings: int = 0) -> LyapunovSpectrum:
    """Compute the exponents of the motion from a state at the cut, shape (n,), over `turns` turns.

    `turns` is doubled, at most `doublings` times, until the sign of the largest exponent is known.
    """
    aligning = turns // _ALIGNMENT_PARTS
    axes, logarithms, durations = _first_axes(len(state)), [], []
    while True:
        matrix, end = derivative(turn_map, state)
        axes, stretched = _stretched(matrix, axes)
        state = end.state
        logarithms.append(stretched)
        durations.append(end.duration)
        if len(logarithms) == aligning + turns:
            spectrum = _spectrum_of(np.array(logarithms[aligning:]) / _mean(durations[aligning:]))
            if spectrum.sign or not doublings:
                return spectrum
            turns, doublings = 2 * turns, doublings - 1


def _spectrum_of(rates: np.ndarray) -> LyapunovSpectrum:
    """Spectrum from the growth rates of the axes in each turn [1/s], shape (turns, n): means and their intervals."""
    exponents = rates.mean(axis=0)
    order = np.argsort(-exponents, kind="stable")
    spread, lasting = np.zeros_like(exponents), np.isfinite(exponents)
    means = np.array([part[:, lasting].mean(axis=0) for part in np.array_split(rates, _PARTS)])
    spread[lasting] = half_interval(means)
    return LyapunovSpectrum(exponents[order], spread[order], len(rates))


def half_interval(means: np.ndarray) -> Any:
    """Half the width of the 95 % confidence interval of a mean, from the means of parts of a run along axis 0.

    NaN for a single part.
    """
    return student.ppf(0.975, len(means) - 1) * sem(means, axis=0) if len(means) > 1 else math.nan


def spectrum_of_cycle(turn_map: TurnMap, states: np.ndarray) -> LyapunovSpectrum:
    """Compute the exponents of a periodic motion whose states at successive cuts are `states`, shape (turns, n).

    The derivatives repeat themselves, so each is computed once, and the sequence is repeated for about `REPEATED`
    turns. The stretch of axes that belong to complex multipliers oscillates for ever. So its mean is weighted, which
    makes it converge faster than any power of the number of turns: S. Das, Y. Saiki, E. Sander and J. A. Yorke,
    Nonlinearity 30 (2017) 4111-4140.
    """
    matrices, ends = zip(*(derivative(turn_map, state) for state in states), strict=True)
    laps = max(64, REPEATED // len(matrices))
    axes, logarithms = _first_axes(len(states[0])), []
    for matrix in laps * matrices:
        axes, stretched = _stretched(matrix, axes)
        logarithms.append(stretched)
    of_laps = np.array(logarithms).reshape(laps, len(matrices), -1).mean(axis=1)
    places = np.linspace(0.0, 1.0, laps - laps // 4 + 2)[1:-1]
    weights = np.exp(-1.0 / (places * (1.0 - places)))
    lasting = np.isfinite(of_laps).all(axis=0)
    exponents = np.full(len(lasting), -np.inf)
    exponents[lasting] = np.average(of_laps[laps // 4:, lasting], axis=0, weights=weights) / _mean(
        [end.duration for end in ends])
    return LyapunovSpectrum(np.sort(exponents)[::-1], np.zeros_like(exponents), len(matrices))


def _mean(durations: Sequence[float]) -> float:
    """Mean duration of a turn [s]; exact if all durations are equal."""
    return math.fsum(durations) / len(durations)


def _first_axes(count: int) -> np.ndarray:
    """Orthonormal axes in random directions, shape (count, count).

    An axis along a coordinate that does not affect the others would never turn to the growing direction.
    """
    return np.linalg.qr(np.random.default_rng(0).normal(size=(count, count)))[0]


def _stretched(matrix: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes after a turn, orthonormal again, shape (n, n), and the logarithms of their stretches, shape (n,)."""
    axes, triangle = np.linalg.qr(matrix @ axes)
    stretch = np.abs(np.diag(triangle))
    vanished = stretch <= RESOLVED * np.abs(matrix).max(initial=0.0)
    return axes, np.where(vanished, -np.inf, np.log(np.where(vanished, 1.0, stretch)))


_PAIR_SEPARATION = 1e-10  # relative difference of the commanded motor speeds, or voltages, that separates a pair
# The distance of a pair is the maximum over samples of a stretch, of so many turns, or seconds if the motor stands.
_TURNS, _STANDING, _SAMPLES = 2.0, 0.1, 64
_LARGEST_DISTANCE = 1e-4  # m, above which the size of the motion limits the distance
_ROUNDING = 1e-13  # m, below which a distance is rounding
_SEPARATED_GROWTH = 1e3  # growth factor of a separated pair; linear growth, from a drift of phases, stays below


def exponent_of_pairs(device: Simulator, begin: float, duration: float) -> tuple[float, float]:
    """Measure the largest Lyapunov exponent of the masses' motion over `duration` [s] from the instant `begin` [s] on.

    Returns
    -------
    (float, float)
        The exponent [1/s], and half the width of its 95 % confidence interval, from up to ten parts of the time. If no
        pair of runs has separated, 0 and the largest exponent that would have remained undetected. Both are NaN for a
        duration of less than three stretches of two turns; the interval is NaN if only one pair was measured.
    """
    try:
        stretch = _TURNS * TURN / crank_speed(device.scene)
    except ValueError:  # a crank that stands, or a dc motor that turns backwards
        stretch = _STANDING
    count = math.floor(duration / stretch)
    if count < 3:
        return math.nan, math.nan
    device.advance_to(begin)
    twin, ends = Simulator(device.scene), iter([begin + stretch * k for k in range(1, count + 1)])
    growth, watched, has_separated = list[float](), list[int](), False
    for begin_of_pair in ends:
        distances = _distances(device, twin, begin_of_pair, ends)
        if len(distances) > 1:
            growth.append(math.log(distances[-1] / distances[0]))
            watched.append(len(distances) - 1)
            has_separated = has_separated or distances[-1] > _SEPARATED_GROWTH * distances[0]
    if not has_separated:
        return 0.0, math.log(_SEPARATED_GROWTH) / (sum(watched) * stretch) if watched else math.nan
    rates = [grown.sum() / (lasted.sum() * stretch) for grown, lasted in zip(
        *(np.array_split(of_pairs, min(_PARTS, len(growth))) for of_pairs in (growth, watched)), strict=True)]
    return sum(growth) / (sum(watched) * stretch), float(half_interval(np.array(rates)))


def _distances(device: Simulator, twin: Simulator, begin: float, ends: Iterator[float]) -> list[float]:
    """Separate a pair slightly until the instant `begin`, and return its distances [m] in the stretches up to `ends`.

    The distances end when the pair is far apart; their ends are consumed from the iterator.
    """
    command = device.scene.motor_command
    value = device.scene[command.replace("_", ".")]
    twin.restore(device.checkpoint())
    twin.command(**{command: (1.0 - _PAIR_SEPARATION) * value})
    for simulator in (device, twin):
        simulator.advance_to(begin)
    twin.command(**{command: value})
    distances: list[float] = []
    for end in ends:
        first, second = (simulator.sample(np.linspace(simulator.time, end, _SAMPLES)) for simulator in (device, twin))
        distance = max(np.abs(first.upper_position - second.upper_position).max(),
                       np.abs(first.inclined_position - second.inclined_position).max())
        distances.append(max(_ROUNDING, float(distance)))
        if distances[-1] > _LARGEST_DISTANCE:
            break
    for simulator in (device, twin):
        simulator.take_events()  # so that they do not accumulate
    return distances
