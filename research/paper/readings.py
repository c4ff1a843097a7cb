"""The paper's figures as series of robots, and the readings that its text leaves open.

A *point* is one robot of a figure: the guide's angle in Fig. 2(b), the inclined mass in Fig. 3(a), the crank in
Fig. 3(b). A *reading* is one choice of all that the paper does not say.
"""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

from vibro_ros.model.scene import Scene

#: Angle of Figs. 3(a) and 3(b) [°], and inclined mass of Fig. 3(b) [kg].
BEST_ANGLE, BEST_MASS = 80.0, 0.02
#: Values of each series: angle [°] of Fig. 2(b) and beyond, inclined mass [kg] of Fig. 3(a), crank radius [m] of
#: Fig. 3(b), whose last is as long as the rods.
SERIES = {
    "angle": (40.0, 50.0, 60.0, 70.0, 80.0, 85.0, 90.0, 95.0, 100.0),
    "mass": (0.02, 0.05, 0.08, 0.12, 0.18, 0.25),
    "crank": (0.01, 0.02, 0.03, 0.04, 0.05, 0.06),
}
#: Unit of the values of each series.
UNITS = {"angle": "°", "mass": "kg", "crank": "m"}


class Point(NamedTuple):
    """One robot of a figure.

    Attributes
    ----------
    series : str
        A key of `SERIES`.
    value : float
        One of its values [°, kg or m].
    """

    series: str
    value: float

    def changes(self) -> dict[str, float]:
        """Parameters in which this robot differs from the paper's first one."""
        if self.series == "angle":
            return {"guide.angle": math.radians(self.value)}
        best = {"guide.angle": math.radians(BEST_ANGLE)}
        if self.series == "mass":
            return best | {"mass.inclined": self.value}
        return best | {"mass.inclined": BEST_MASS, "crank.radius": self.value}


def points() -> Iterator[Point]:
    """Every robot of every figure."""
    return (Point(series, value) for series, values in SERIES.items() for value in values)


class Reading(NamedTuple):
    """One choice of what the paper leaves open.

    Attributes
    ----------
    solver : str
        `exact`, `rkfixed` (Runge-Kutta of fixed step, blind to events) or `Rkadapt` (of adaptive step, equally blind).
    step : float
        Step of `rkfixed` [s]; else 0.
    equations : str
        `corrected` or `misprint` (xi_2 for xi_3 in eqs. (1), (6) and (7), taken literally).
    normal_force : str
        Rule of the normal force: `printed`, `unilateral`, `weight` or `hop`.
    start : str
        `zero` (every coordinate 0), `rest` (each mass at rest on its slider or its plate), or `phase` (as `rest`, but
        with the crank anywhere in the half turn in which the upper slider moves).
    friction : str
        `eq5` (Coulomb's, eq. (5)), `smooth` (x' / (abs(x') + 1 mm/s) for sign(x')), or `reversed` (the other sign).
    """

    solver: str
    step: float
    equations: str
    normal_force: str
    start: str
    friction: str

    def __str__(self):
        step = f" {self.step:g} s" if self.step else ""
        friction = "" if self.friction == "eq5" else f", {self.friction} friction"
        return f"{self.equations}, {self.normal_force}, {self.start}, {self.solver}{step}{friction}"

    def scene(self, point: Point) -> Scene:
        """The robot of `point` under this reading, simulated by events."""
        start = "zero" if self.start == "zero" else "rest"
        return Scene("paper", point.changes() | {
            "effects.misprint": self.equations == "misprint", "effects.normal_force": self.normal_force,
            "start.state": start, "motor.max_speed": 1e4})


#: Steps of `rkfixed` [s]: a thousand, ten thousand and a hundred thousand points a second.
STEPS = (1e-3, 1e-4, 1e-5)
EQUATIONS = ("corrected", "misprint")


def exact_readings() -> Iterator[Reading]:
    """Readings that are integrated event by event."""
    for equations, rule, start in itertools.product(
            EQUATIONS, ("printed", "unilateral", "weight", "hop"), ("zero", "rest", "phase")):
        yield Reading("exact", 0.0, equations, rule, start, "eq5")


def worksheet_readings() -> Iterator[Reading]:
    """Readings that are integrated as a worksheet would do it, with every condition in the right-hand side."""
    for equations, rule, start, step in itertools.product(
            EQUATIONS, ("printed", "unilateral"), ("zero", "rest"), STEPS):
        yield Reading("rkfixed", step, equations, rule, start, "eq5")
    for equations, start, friction in itertools.product(EQUATIONS, ("zero", "rest"), ("smooth", "reversed")):
        yield Reading("rkfixed", STEPS[-1], equations, "printed", start, friction)
    for equations in EQUATIONS:
        yield Reading("Rkadapt", 0.0, equations, "printed", "rest", "eq5")


class Span(NamedTuple):
    """A time over which the mean speed is taken, from `begin` to `end` [s]; both are `INSTANTS` or 0."""

    begin: float
    end: float

    def __str__(self):
        return f"first {self.end:g} s" if self.begin == 0.0 else f"{self.begin:g} to {self.end:g} s"


#: Instants at which the displacement is kept [s].
INSTANTS = (1.0, 2.0, 5.0, 10.0, 40.0)
SPANS = (Span(0.0, 1.0), Span(0.0, 2.0), Span(0.0, 5.0), Span(0.0, 10.0), Span(10.0, 40.0))
#: The last instant of `rkfixed` and of `Rkadapt` [s], which cost more than `exact`.
LAST = {"exact": 40.0, "rkfixed": 2.0, "Rkadapt": 1.0}


def instants(reading: Reading) -> tuple[float, ...]:
    """Instants that a reading is run to [s]."""
    return tuple(instant for instant in INSTANTS if instant <= LAST[reading.solver])


def spans(reading: Reading) -> tuple[Span, ...]:
    """Times over which a reading's mean speeds are taken."""
    return tuple(span for span in SPANS if span.end <= LAST[reading.solver])
