"""The problems of the benchmark, as their data files in `problems/` state them, and the error of an answer.

Every problem is a case of one machine, whose symbols the pages in `problems/` explain; README.md has its equations.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).with_name("problems")
#: What is sampled: positions and speeds of upper mass, inclined mass and body, the body along and above the ground.
COLUMNS = ("u", "du", "w", "dw", "x", "dx", "y", "dy")
#: Names of the parameters in vibro_ros, whose scenes the runner `exact` and the reference are made from.
NAMES = {
    "m1": "mass.body", "m2": "mass.upper", "m3": "mass.inclined", "l": "crank.radius", "L2": "crank.upper_rod",
    "L3": "crank.inclined_rod", "phi": "guide.angle", "omega": "motor.speed", "g": "gravity", "mu": "ground.friction",
    "k2": "upper.spring.stiffness", "c2": "upper.spring.damping", "k4": "upper.plate.stiffness",
    "c4": "upper.plate.damping", "gap2": "upper.gap", "k3": "inclined.spring.stiffness",
    "c3": "inclined.spring.damping", "k1": "inclined.plate.stiffness", "c1": "inclined.plate.damping",
    "gap3": "inclined.gap", "normal": "effects.normal_force", "adhesion": "effects.adhesion",
    "reaction": "effects.reaction", "weight": "effects.mass_weight", "restitution": "ground.restitution",
}
STAND_IN = 0.25  # kg, of a mass that is absent: it hangs on nothing, and the body is lighter by it


@dataclass(frozen=True)
class Problem:
    """A problem with its reference values.

    Attributes
    ----------
    name, title : str
        The data file's name, and a few words.
    parameters : mapping
        Numbers in SI units and choices by their symbols. A mass that is 0 is absent, with its spring and plate; a
        plate of stiffness 0 is absent.
    start : mapping of str to float
        Values of `COLUMNS` at t = 0.
    times : tuple of float
        Sampled instants [s].
    values : mapping of str to tuple of str
        Reference values at these instants, in decimal.
    events : mapping of str to mapping
        `count`, and decimal times `first` and `last` [s], of each kind of event. Of infinitely many, `count` is
        "infinitely many" and `last` the instant at which they accumulate.
    judged : tuple of str
        Columns by which an answer is judged.
    digits : int
        Decimal digits to which a second run of other order and precision agrees.
    """

    name: str
    title: str
    parameters: Mapping[str, Any]
    start: Mapping[str, float]
    times: tuple[float, ...]
    values: Mapping[str, Sequence[str]]
    events: Mapping[str, Mapping[str, Any]]
    judged: tuple[str, ...]
    digits: int

    def scene(self) -> dict[str, float | str | bool]:
        """The parameters by their names in vibro_ros, where a body without masses does not hop: one stands in."""
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

    def falls_through(self, states: Sequence[Sequence[float]]) -> bool:
        """Whether a body that may leave the ground, y >= 0, is ever deeper below it than it truly rises above it."""
        height = max(map(float, self.values["y"]))
        return self.parameters["normal"] == "hop" and any(row[COLUMNS.index("y")] < -height for row in states)

    def error(self, states: Sequence[Sequence[float]]) -> float:
        """Largest error of the judged columns, each relative to the span of its reference values; NaN for no number.

        `states` has a row of `COLUMNS` for each of `times`.
        """
        worst = 0.0
        for column in self.judged:
            true = [float(text) for text in self.values[column]]
            span = max(true) - min(true)
            for row, value in zip(states, true, strict=True):
                off = abs(row[COLUMNS.index(column)] - value) / span
                worst = off if not off <= worst else worst
                if math.isnan(worst):
                    return worst
        return worst


def names() -> list[str]:
    """The problems, the easiest first."""
    return [path.stem for path in sorted(FOLDER.glob("*.json"))]


def load(name: str) -> Problem:
    """The problem of that name, or of the name without its number."""
    for path in sorted(FOLDER.glob("*.json")):
        if name in (path.stem, path.stem.split("_", 1)[1]):
            stored = json.loads(path.read_text(encoding="utf-8"))
            del stored["made_by"]
            return Problem(name=path.stem, **stored | {"times": tuple(map(float, stored["times"])),
                                                      "judged": tuple(stored["judged"])})
    raise ValueError(f"{name!r} is no problem of the benchmark; there are {', '.join(names())}")
