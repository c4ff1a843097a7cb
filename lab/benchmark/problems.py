"""The problems of the benchmark, as their data files in `problems/` state them, and the error of an answer.

Every problem is a case of one machine, whose symbols the pages in `problems/` explain; README.md has its equations.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vibro_lab.accuracy.harness import DIVERGES, Row
from vibro_lab.accuracy.programs import Answer, Program, Setting

FOLDER = Path(__file__).with_name("problems")
#: What is sampled: positions and speeds of upper mass, inclined mass and body, the body along and above the ground.
COLUMNS = ("u", "du", "w", "dw", "x", "dx", "y", "dy")
#: Names of the parameters in vibro_ros; `exact` and the reference simulate scenes with these parameters.
NAMES = {
    "m1": "mass.body", "m2": "mass.upper", "m3": "mass.inclined", "l": "crank.radius", "L2": "crank.upper_rod",
    "L3": "crank.inclined_rod", "phi": "guide.angle", "omega": "motor.speed", "g": "gravity", "mu": "ground.friction",
    "k2": "upper.spring.stiffness", "c2": "upper.spring.damping", "k4": "upper.plate.stiffness",
    "c4": "upper.plate.damping", "gap2": "upper.gap", "k3": "inclined.spring.stiffness",
    "c3": "inclined.spring.damping", "k1": "inclined.plate.stiffness", "c1": "inclined.plate.damping",
    "gap3": "inclined.gap", "normal": "effects.normal_force", "adhesion": "effects.adhesion",
    "reaction": "effects.reaction", "weight": "effects.mass_weight", "restitution": "ground.restitution",
}
#: Outcomes of a run: the body sinks deeper below the ground than it rises above it in the reference; or it ends on the
#: wrong side of its start.
FALLS, WRONG_SIGN = "falls through the ground", "wrong sign"
#: Error of a run that diverges, in spans of the reference.
DIVERGED = 10.0
STAND_IN = 0.25  # kg, in place of an absent mass: no force acts on it, and the body is lighter by as much


@dataclass(frozen=True)
class ReferenceProblem:
    """A problem with its reference values, as `accuracy.harness.Problem` asks for."""

    name: str  # the data file's name
    title: str  # a few words
    # Numbers in SI units and choices by their symbols. A mass that is 0 is absent, with its spring and plate; a plate
    # of stiffness 0 is absent.
    parameters: Mapping[str, Any]
    start: Mapping[str, float]  # values of `COLUMNS` at t = 0
    times: np.ndarray  # shape (n,): sampled instants [s]
    values: Mapping[str, Sequence[str]]  # reference values at these instants, in decimal
    # `count`, and decimal times `first` and `last` [s], of each kind of event. If a kind has infinitely many events,
    # `count` is "infinitely many" and `last` is the instant at which they accumulate.
    events: Mapping[str, Mapping[str, Any]]
    judged: tuple[str, ...]  # columns by which an answer is judged
    digits: int  # decimal digits to which a second run of other order and precision agrees

    @property
    def scene(self) -> Any:
        """The same problem for vibro_ros."""
        from vibro_ros import load_scene  # compiled, which a program of another interpreter lacks

        return load_scene("paper").with_parameters(self.scene_parameters())

    def scene_parameters(self) -> dict[str, float | str | bool]:
        """Return the parameters by their names in vibro_ros; a body without masses gets one of `STAND_IN`, because
        vibro_ros lets only a body with a mass hop.
        """
        given = self.parameters
        contact = {side: "compliant" if given[m] and given[k] else "none"
                   for side, m, k in (("upper", "m2", "k4"), ("inclined", "m3", "k1"))}
        present = {name: given[symbol] for symbol, name in NAMES.items() if given[symbol] or symbol not in ("m2", "m3")}
        alone = given["m2"] == given["m3"] == 0.0
        if alone:
            present |= {"mass.upper": STAND_IN, "mass.body": given["m1"] - STAND_IN, "upper.spring.stiffness": 0.0}
        start = {"start.body_height": height} if (height := self.start["y"]) else {}
        return present | start | {
            "effects.upper_mass": given["m2"] > 0 or alone, "effects.inclined_mass": given["m3"] > 0,
            **{f"effects.{side}_contact": law for side, law in contact.items()},
            "effects.friction": "coulomb" if given["mu"] else "none", "ground.static_friction": given["mu"],
            "effects.motor": "ideal", "start.state": "given" if start else "rest"}

    def at(self, times: np.ndarray) -> "ReferenceProblem":
        """The same problem, sampled at other instants [s]."""
        return replace(self, times=times)

    def instants(self, program: Program, setting: Setting) -> np.ndarray:
        """The stored instants [s]."""
        return self.times

    def judge(self, row: Row, answer: Answer, times: np.ndarray) -> Row:
        """Return the row with the error of an answer at the stored instants, its outcome, and the missed events."""
        error, falls = self.error(answer.samples), self.falls_through(answer.samples)
        if math.isnan(error) or error > DIVERGED and not falls:
            return replace(row, outcome=DIVERGES)
        said = [self.missed(answer)]
        if answer.callbacks is not None:
            said.append(f"{answer.callbacks() / row.wall_time:.0%} of its time in Python that it calls back")
        row = replace(row, share_error=error, note="; ".join(filter(None, said)),
                      outcome=FALLS if falls else row.outcome)
        along = answer.samples[-1][COLUMNS.index("x")] * float(self.values["x"][-1])
        return replace(row, outcome=WRONG_SIGN) if self.judged == ("x",) and along < 0.0 else row

    def missed(self, answer: Answer) -> str:
        """Return, in words, the events whose number differs from the reference; empty for a program without events."""
        if answer.events is None:
            return ""
        kinds, counts = np.unique(answer.events["kind"], return_counts=True)
        counted = {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)}
        return "; ".join(
            f"{counted.get(kind, 0)} of {event['count']} {kind.replace('_', ' ')}{'' if event['count'] == 1 else 's'}"
            for kind, event in self.events.items()
            if (kind in counted or kind.endswith("contact")) and counted.get(kind, 0) != event["count"])

    def falls_through(self, states: np.ndarray) -> bool:
        """Whether a body that may leave the ground (y >= 0) is ever deeper below it than it rises above it in the
        reference.
        """
        height = max(map(float, self.values["y"]))
        return self.parameters["normal"] == "hop" and bool(np.any(states[:, COLUMNS.index("y")] < -height))

    def error(self, states: np.ndarray) -> float:
        """Return the largest error of the judged columns, each relative to the span of its reference values.

        `states` has a row of `COLUMNS` for each of `times`, shape (n, 8) (else ValueError). A NaN gives NaN.
        """
        if len(states) != len(self.times):
            raise ValueError(f"{len(states)} of {len(self.times)} samples")
        shares = []
        for column in self.judged:
            true = np.array(list(map(float, self.values[column])))
            shares.append(np.abs(states[:, COLUMNS.index(column)] - true).max() / np.ptp(true))
        return float(np.max(shares))


def names() -> list[str]:
    """The problems, the easiest first."""
    return [path.stem for path in sorted(FOLDER.glob("*.json"))]


def load(name: str) -> ReferenceProblem:
    """The problem of that name, or of the name without its number."""
    for path in sorted(FOLDER.glob("*.json")):
        if name in (path.stem, path.stem.split("_", 1)[1]):
            stored = json.loads(path.read_text(encoding="utf-8"))
            del stored["made_by"]
            return ReferenceProblem(name=path.stem, **stored | {"times": np.array(list(map(float, stored["times"]))),
                                                      "judged": tuple(stored["judged"])})
    raise ValueError(f"{name!r} is no problem of the benchmark; there are {', '.join(names())}")
