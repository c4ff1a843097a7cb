"""Verification of a robot: the motions that fresh starts lead to, also under other readings of the forces."""

import math
from contextlib import closing
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from vibro_lab.orbits.attractors import Attractor, group_starts
from vibro_lab.orbits.chaos import half_interval
from vibro_lab.study.command import Progress
from vibro_lab.study.execution import Execution
from vibro_lab.study.measures import drift_in, measure_with_motion
from vibro_ros import Scene, SimulationError, load_scene

MEASURED = ("mean_speed", "mean_power", "delivered_power", "air_share", "supply_power")
"""Measures of each start: the columns of a robot's values. The last one is NaN without a dc motor."""
AIR, SUPPLY = 3, 4
_LOADS = ("mean_load", "unloaded_share")  # measures of the verification alone
POWERS = {"net": 1, "delivered": 2, "supply": SUPPLY}
"""Column of `MEASURED` for each reading of P."""


class Trials(NamedTuple):
    """Runs of a robot: drawn starts from number `first` on, with times in s."""

    first: int
    starts: int
    settling: float
    duration: float

    @property
    def run_time(self) -> float:
        """Simulated time of all starts [s]."""
        return self.starts * (self.settling + self.duration)


def readings(scene: Scene) -> dict[str, Scene]:
    """Scenes for the verification by their descriptions: the scene itself, and variants with other effects or start."""
    other_start = "zero" if scene["start.state"] == "rest" else "rest"
    others: dict[str, dict[str, Any]] = {
        "the body is held on the ground by decree (`unilateral`)": {"effects.normal_force": "unilateral"},
        f"drawn starts that begin from `{other_start}`": {"start.state": other_start},
        "every effect of `device`": {name: value for name, value in load_scene("device").parameters.items()
                                     if name.startswith("effects.")}}
    scenes = {f"as sought (`{scene.name}`)": scene}
    for words, changes in others.items():
        if (other := scene.with_parameters(changes)) not in scenes.values():
            scenes[words] = other
    return scenes


def verified(scene: Scene, power: str, trials: Trials, execution: Execution) -> list[dict[str, Any]]:
    """Return a row for each attractor of a robot under each of `readings`, that of most starts first; SI units."""
    scenes, rows = readings(scene), list[dict[str, Any]]()
    runs = execution.rows(partial(_settled_at, tuple(scenes.values()), trials), range(len(scenes)),
                          trials.run_time)
    with closing(runs), Progress("verification", "reading", len(scenes)) as progress:
        for (words, reading), starts in zip(scenes.items(), runs, strict=True):
            values, motions, drifts = map(list, zip(*starts, strict=True))
            attractors, places = group_starts(motions, [row[0] for row in values])
            rows += [_row(words, reading, attractor, np.array(values)[places == place],
                          np.array(drifts)[places == place], power) for place, attractor in enumerate(attractors)]
            progress.add(1)
    return rows


def _settled_at(scenes: tuple[Scene, ...], trials: Trials, number: int) -> list[tuple[list[float], Any, float]]:
    """Measures, settled motion or None, and drift from each start; NaN if the run cannot go on."""
    names, starts = (*MEASURED, *_LOADS), list[tuple[list[float], Any, float]]()
    for start in range(trials.first, trials.first + trials.starts):
        try:
            values, motion, drift = measure_with_motion(scenes[number], names, trials.settling, trials.duration, start)
            starts.append(([values[name] for name in names], motion, drift))
        except SimulationError:
            starts.append(([math.nan] * len(names), None, math.nan))
    return starts


def _row(words: str, scene: Scene, attractor: Attractor, values: np.ndarray, drifts: np.ndarray, power: str
         ) -> dict[str, Any]:
    """Row of an attractor from the values of its starts; means with half the 95 % interval, if the starts settled."""
    def mean(column: np.ndarray) -> dict[str, float]:
        return {"mean": float(column.mean()),
                "spread": math.nan if attractor.turns is None else float(half_interval(column))}

    paid, weight = values[:, POWERS[power]], scene.total_mass * scene["gravity"]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, speed = mean(np.abs(values[:, 0]) / paid), mean(values[:, 0])
    pays = scene["effects.reaction"] and paid.mean() > 0.0 and speed["mean"] != 0.0 and weight > 0.0
    load, unloaded = values[:, len(MEASURED):].mean(axis=0).tolist()
    return {"reading": words, "turns": attractor.turns, "starts": attractor.starts, "share": attractor.share,
            "low": attractor.low, "high": attractor.high, "speed": speed, "least": attractor.least,
            "largest": attractor.largest, "power": mean(values[:, 1]), "delivered": mean(values[:, 2]),
            "supply": mean(values[:, SUPPLY]), "ratio": ratio,
            "cost": float(paid.mean() / (weight * abs(speed["mean"]))) if pays else math.nan,
            "drift": 0.0 if attractor.turns else drift_in(drifts, speed["mean"]),
            "load": load, "unloaded": unloaded, "air": float(values[:, AIR].mean())}
