"""What a study measures of a scene and a start: every measure once, with its unit and its meaning.

A measure that has no value for a motion is NaN, never infinite: the meaning says when. `measure` runs the scene once
for all measures that are asked for, and gathers only what these need.
"""

import difflib
import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.study.lyapunov import lyapunov_exponent
from vibro_ros.study.observation import REST, STROBED_TURNS, TURNS, WORK, Observation, device_at_start, observe
from vibro_ros.study.window import checked_times

#: Longest period that is looked for [turns].
LONGEST_PERIOD = STROBED_TURNS // 2
# Largest difference of states of a periodic motion, in crank radii, and in crank radii times motor speed.
_SAME = 1e-6


class Measure(NamedTuple):
    """One measure.

    Attributes
    ----------
    unit : str
        SI unit; 1 for pure numbers.
    meaning : str
        One line for users.
    needs : tuple of str
        What `observe` must gather for it.
    value : callable
        Its value from an `Observation`.
    """

    unit: str
    meaning: str
    needs: tuple[str, ...]
    value: Callable[[Observation], float]


def _speed(seen: Observation) -> float:
    return seen.displacement / seen.window.duration


def _power(seen: Observation) -> float:
    return (seen.delivered - seen.taken_back) / seen.window.duration


def _delivered_power(seen: Observation) -> float:
    return seen.delivered / seen.window.duration


def _ratio(over: float, under: float) -> float:
    """`over` / `under`; NaN where the latter is not positive, or so small that the ratio is not finite."""
    ratio = over / under if under > 0.0 else math.nan
    return ratio if math.isfinite(ratio) else math.nan


def _cost(power: float, seen: Observation) -> float:
    weight = seen.scene.total_mass * seen.scene["gravity"]
    return _ratio(power, weight * abs(_speed(seen))) if power > 0.0 else math.nan


def _impacts(side: str) -> Callable[[Observation], float]:
    return lambda seen: _ratio(float(np.sum(seen.contacts["kind"] == f"{side}_contact")), seen.turns)


def _peak_force(side: str) -> Callable[[Observation], float]:
    def largest(seen: Observation) -> float:
        if seen.scene[f"effects.{side}_contact"] == "restitution":
            return math.nan
        return float(seen.contacts["peak_force"][seen.contacts["kind"] == f"{side}_contact"].max(initial=0.0))

    return largest


def _period(seen: Observation) -> float:
    """The smallest number of turns after which all states of the strobe repeat."""
    if seen.strobe is None or not seen.steady or len(seen.strobe) < 3:
        return math.nan
    for turns in range(1, min(LONGEST_PERIOD, (len(seen.strobe) - 1) // 2) + 1):
        if np.abs(seen.strobe[turns:] - seen.strobe[:-turns]).max() <= _SAME:
            return float(turns)
    return 0.0


_NO_POWER = "NaN if that power is not above 0"
_LYAPUNOV = "lyapunov_exponent"

MEASURES: dict[str, Measure] = {
    "mean_speed": Measure("m/s", "mean speed of the body, forward positive", (), _speed),
    "mean_power": Measure("W", "mean mechanical power of the motor, less what the springs return to it", (WORK,),
                          _power),
    "delivered_power": Measure("W", "mean of the motor's power where it is positive: what the springs return is lost",
                               (WORK,), _delivered_power),
    "speed_per_power": Measure("m/J", f"mean_speed / mean_power, V/P; {_NO_POWER}", (WORK,),
                               lambda seen: _ratio(_speed(seen), _power(seen))),
    "speed_per_delivered_power": Measure("m/J", f"mean_speed / delivered_power; {_NO_POWER}", (WORK,),
                                         lambda seen: _ratio(_speed(seen), _delivered_power(seen))),
    "cost_of_transport": Measure("1", f"mean_power / (M g abs(mean_speed)); {_NO_POWER}, or the body stays where it is,"
                                 " or without gravity", (WORK,), lambda seen: _cost(_power(seen), seen)),
    "delivered_cost_of_transport": Measure("1", "the same with delivered_power", (WORK,),
                                           lambda seen: _cost(_delivered_power(seen), seen)),
    "upper_impacts": Measure("1", "contacts of the upper mass with its plate that ended, a turn of the crank; NaN if "
                             "the crank stands", (), _impacts("upper")),
    "inclined_impacts": Measure("1", "the same of the inclined mass", (), _impacts("inclined")),
    "upper_peak_force": Measure("N", "largest force of these contacts on the upper plate; 0 without a contact, NaN for "
                                "a rigid plate", (), _peak_force("upper")),
    "inclined_peak_force": Measure("N", "the same on the inclined plate", (), _peak_force("inclined")),
    "stick_share": Measure("1", "share of the time in which the body stands still on the ground", (REST,),
                           lambda seen: seen.standing / seen.window.duration),
    "air_share": Measure("1", "share of the time in which the body is in the air (rule hop)", (REST,),
                         lambda seen: seen.airborne / seen.window.duration),
    "period": Measure("1", f"turns of the crank after which all positions and speeds repeat, over the last "
                      f"{STROBED_TURNS} turns, to {_SAME:g} crank radii (and times motor speed); 0 if no number up to "
                      f"{LONGEST_PERIOD}, nor up to half of the turns measured, does; NaN if the motor stands or "
                      "changes its speed, or for less than two turns", (TURNS,), _period),
    _LYAPUNOV: Measure("1/s", "largest Lyapunov exponent, from runs that begin 1e-10 apart and are watched until they "
                       "are 1e-4 m apart; 0 if none part, NaN for less than six turns", (), lambda seen: math.nan),
}
"""Every measure by its name."""


def checked_names(names: Sequence[str]) -> tuple[str, ...]:
    """`names` of measures without repetition.

    Raises
    ------
    ValueError
        For no name, and for a name that `MEASURES` lacks; the message suggests the nearest one.
    """
    for name in names:
        if name not in MEASURES:
            near = difflib.get_close_matches(name, MEASURES, n=1)
            remedy = f"did you mean {near[0]}?" if near else f"measures are {', '.join(MEASURES)}"
            raise ValueError(f"{name or repr(name)}: no such measure; {remedy}")
    if not names:
        raise ValueError(f"measure: none named; measures are {', '.join(MEASURES)}")
    return tuple(dict.fromkeys(names))


def measure(scene: Scene, names: Collection[str], settling: float, duration: float,
            start: int | None = None) -> dict[str, float]:
    """Measure a scene from one start.

    Parameters
    ----------
    scene : Scene
        What is simulated, by its own method.
    names : collection of str
        Of `MEASURES`.
    settling : float
        Time that does not count [s].
    duration : float
        Time that counts after that [s]: its whole turns of the crank (see `window`).
    start : int, optional
        Number of a drawn start (`vibro_ros.accuracy.starts`), which scenes share; without it the scene's own.

    Returns
    -------
    dict of str to float
        The measures by name, in the order of `names`.

    Raises
    ------
    ValueError
        For unknown names, and times that make no sense.
    SimulationError
        If a run cannot go on.
    """
    names = checked_names(tuple(names))
    checked_times(settling, duration, start is not None)
    seen = observe(scene, {need for name in names for need in MEASURES[name].needs}, settling, duration, start)
    values = {name: MEASURES[name].value(seen) for name in names}
    if _LYAPUNOV in names:
        values[_LYAPUNOV] = lyapunov_exponent(device_at_start(scene, start), seen.window)
    return values
