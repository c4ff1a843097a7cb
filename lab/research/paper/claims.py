"""The paper's robots, the possible readings of its text, and its claims with the rules that judge them.

A *point* is one robot of a figure: the guide's angle in Fig. 2(b), the inclined mass in Fig. 3(a), the crank in
Fig. 3(b). A *reading* is one choice for everything that the paper does not specify.

A claim is a list of pairs of robots, of which the first is said to be faster. The *named* pairs have values from the
paper's text; other pairs have values between and beyond them, to which the text extends the claim.

*One run* compares runs from the first start only, as the paper does. The *mean* over the starts compares mean speeds
from the same starts: the mean of their differences, by Student's one-sided test. The level of a claim, 5 %, is shared
equally among its pairs (Bonferroni). A claim *holds* if the first robot of every pair is faster at this level, *does
not* hold if the second robot of any pair is faster at this level, and is within *noise* otherwise. It holds *at named
values* if it holds for the named pairs but not for all pairs.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy.stats import sem
from scipy.stats import t as student

from vibro_ros import Scene

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


class FigurePoint(NamedTuple):
    """One robot of a figure."""

    series: str  # a key of `SERIES`
    value: float  # one of its values [°, kg or m]

    def changes(self) -> dict[str, float]:
        """Parameters in which this robot differs from the paper's first robot."""
        if self.series == "angle":
            return {"guide.angle": math.radians(self.value)}
        best = {"guide.angle": math.radians(BEST_ANGLE)}
        if self.series == "mass":
            return best | {"mass.inclined": self.value}
        return best | {"mass.inclined": BEST_MASS, "crank.radius": self.value}


def points() -> Iterator[FigurePoint]:
    """Yield every robot of every figure."""
    return (FigurePoint(series, value) for series, values in SERIES.items() for value in values)


#: Kinds of starts of a robot.
STARTS = NEAR_ZERO, NEAR_REST, ANY_PHASE = "near zero", "near rest", "any phase"
#: As near rest, but with the masses on the sliders where the crank has moved them.
ON_SLIDERS = "on sliders"


class Reading(NamedTuple):
    """One choice for everything that the paper does not specify."""

    solver: str  # `exact`, `rkfixed` (Runge-Kutta of fixed step without event location) or `Rkadapt` (of adaptive step)
    step: float  # step of `rkfixed` [s]; else 0
    equations: str  # `corrected` or `misprint` (xi_2 for xi_3 in eqs. (1), (6) and (7), taken literally)
    normal_force: str  # rule of the normal force: `printed`, `unilateral`, `weight` or `hop`
    # `near zero` (every coordinate 0 but the crank's, which is a little ahead), `near rest` (each mass at rest on its
    # slider or its plate, and the crank a little ahead), or `any phase` (the same with the crank anywhere in the half
    # turn in which the upper slider moves). The first start near `zero` or `rest` is that state itself. Near `rest` the
    # masses are where the sliders were before the crank was ahead; `on sliders`, where the sliders are then.
    start: str
    # `eq5` (Coulomb's, eq. (5)), `smooth` (x' / (abs(x') + 1 mm/s) for sign(x')), or `reversed` (the other sign).
    friction: str

    def __str__(self):
        step = f" {self.step:g} s" if self.step else ""
        friction = "" if self.friction == "eq5" else f", {self.friction} friction"
        return f"{self.equations}, {self.normal_force}, {self.start}, {self.solver}{step}{friction}"

    def scene(self, point: FigurePoint) -> Scene:
        """Return the scene of the robot `point` under this reading, for event-driven simulation."""
        return Scene("paper", point.changes() | {
            "effects.misprint": self.equations == "misprint", "effects.normal_force": self.normal_force,
            "start.state": self.state, "motor.max_speed": 1e4})

    @property
    def state(self) -> str:
        """Value of the scene's `start.state`, from which the first start begins."""
        return "zero" if self.start == NEAR_ZERO else "rest"


#: Steps of `rkfixed` [s]: a thousand, ten thousand and a hundred thousand points per second.
STEPS = (1e-3, 1e-4, 1e-5)
EQUATIONS = ("corrected", "misprint")


def exact_readings() -> Iterator[Reading]:
    """Yield the readings that are integrated event by event."""
    for equations, rule, start in itertools.product(
            EQUATIONS, ("printed", "unilateral", "weight", "hop"), STARTS):
        yield Reading("exact", 0.0, equations, rule, start, "eq5")


def slider_readings() -> Iterator[Reading]:
    """Yield the readings whose masses rest on the sliders at the crank's own angle."""
    for reading in exact_readings():
        if reading.start == NEAR_REST:
            yield reading._replace(start=ON_SLIDERS)


def worksheet_readings() -> Iterator[Reading]:
    """Yield the readings that are integrated as in a worksheet, with all conditions in the right-hand side."""
    for equations, rule, start, step in itertools.product(
            EQUATIONS, ("printed", "unilateral"), (NEAR_ZERO, NEAR_REST), STEPS):
        yield Reading("rkfixed", step, equations, rule, start, "eq5")
    for equations, start, friction in itertools.product(EQUATIONS, (NEAR_ZERO, NEAR_REST), ("smooth", "reversed")):
        yield Reading("rkfixed", STEPS[-1], equations, "printed", start, friction)
    for equations in EQUATIONS:
        yield Reading("Rkadapt", 0.0, equations, "printed", NEAR_REST, "eq5")


class Span(NamedTuple):
    """A time over which the mean speed is taken, from `begin` to `end` [s]; both are `INSTANTS` or 0."""

    begin: float
    end: float

    def __str__(self):
        return f"first {self.end:g} s" if self.begin == 0.0 else f"{self.begin:g} to {self.end:g} s"


#: Instants at which the displacement is recorded [s].
INSTANTS = (1.0, 2.0, 5.0, 10.0, 40.0)
SPANS = (Span(0.0, 1.0), Span(0.0, 2.0), Span(0.0, 5.0), Span(0.0, 10.0), Span(10.0, 40.0))
#: End of the runs with each solver [s]; `rkfixed` and `Rkadapt` cost more than `exact`.
LAST = {"exact": 40.0, "rkfixed": 2.0, "Rkadapt": 1.0}


def instants(reading: Reading) -> tuple[float, ...]:
    """Instants [s] at which a reading's displacement is recorded."""
    return tuple(instant for instant in INSTANTS if instant <= LAST[reading.solver])


def spans(reading: Reading) -> tuple[Span, ...]:
    """Time spans over which a reading's mean speeds are computed."""
    return tuple(span for span in SPANS if span.end <= LAST[reading.solver])


HOLDS, NAMED, DOES_NOT, NOISE, DIVERGES = "holds", "at named values", "does not", "noise", "diverges"
#: Level of the test of a claim.
LEVEL = 0.05
#: Difference of speeds [m/s], about the speed of light, above which the integration has diverged.
EXPLODED = 3e8
Pairs = tuple[tuple[float, float], ...]


class RankingClaim(NamedTuple):
    """One claim of the paper."""

    name: str  # name in the tables
    words: str  # statement of the paper
    series: str  # series of the robots that it compares
    # Pairs of values of that series that the text names: of the robot that is said to be faster, and the slower one.
    named: Pairs
    others: Pairs  # further pairs that follow from the statement


def _faster(value: float, *slower: float) -> Pairs:
    return tuple((value, other) for other in slower)


def _rising(*values: float) -> Pairs:
    """Pairs of the claim that the robot of each value is slower than that of the next."""
    return tuple(zip(values[1:], values[:-1], strict=True))


CLAIMS = (
    RankingClaim("80° is best", "of 40°, 50°, … 90°, the mean speed is greatest at φ = 80°", "angle",
                 _faster(80.0, 40.0, 50.0, 60.0, 70.0, 90.0), _faster(80.0, 85.0)),
    RankingClaim("falls beyond 85°", "a further increase of φ over 85…90° reduces the mean speed", "angle",
                 _rising(90.0, 85.0), _rising(100.0, 95.0, 90.0)),
    RankingClaim("heavier is slower", "from m3 = 0.08 to 0.25 kg the mean speed falls gradually", "mass",
                 _rising(0.25, 0.08), _rising(0.25, 0.18, 0.12, 0.08)),
    RankingClaim("0.02 kg is best", "a decrease of m3 to 0.02 kg gives the greatest mean speed", "mass",
                 _faster(0.02, 0.08, 0.25), _faster(0.02, 0.05, 0.12, 0.18)),
    RankingClaim("longer is faster", "the longer the crank, the greater the mean speed, up to l = 0.06 m", "crank",
                 _rising(0.02, 0.06), _rising(*SERIES["crank"])),
)
"""Every claim, in the paper's order. Of the crank's lengths the text names that of the first robot, 0.02 m, and 0.06 m.
"""

#: Displacements [m], shape (starts, instants), of each robot under one reading.
Displacements = Mapping[FigurePoint, np.ndarray]


class Mean(NamedTuple):
    """A mean over starts, and half the width of its 95 % confidence interval, in the same unit."""

    mean: float
    spread: float


class Verdict(NamedTuple):
    """Outcome of every claim under one reading, over one span; each tuple has the order of `CLAIMS`."""

    reading: Reading
    span: Span
    one_run: tuple[str, ...]  # outcomes by the speed along Ox of the first start alone
    along_ox: tuple[str, ...]  # outcomes by the means over the starts of the speed along Ox
    size: tuple[str, ...]  # the same of the magnitude of the speed
    means: dict[FigurePoint, Mean]  # mean speed along Ox of each robot [m/s]

    @property
    def forwards(self) -> tuple[int, int]:
        """Numbers of robots that go significantly forwards and backwards (0 lies outside the interval)."""
        ahead = sum(mean.mean > mean.spread for mean in self.means.values())
        return ahead, sum(mean.mean < -mean.spread for mean in self.means.values())

    def fastest(self, series: str) -> float:
        """Value of the robot of a series with the greatest mean speed along Ox."""
        mean_speeds = {point: mean.mean for point, mean in self.means.items() if point.series == series}
        return max(mean_speeds, key=lambda point: mean_speeds[point]).value


def score(outcomes: tuple[str, ...]) -> int:
    """Number of claims that hold, at least at the named values."""
    return sum(outcome in (HOLDS, NAMED) for outcome in outcomes)


def speeds(displacement: np.ndarray, span: Span) -> np.ndarray:
    """Mean speed [m/s] of each start over a span, shape (starts,), from displacements, shape (starts, instants)."""
    end = displacement[:, INSTANTS.index(span.end)]
    begin = displacement[:, INSTANTS.index(span.begin)] if span.begin else 0.0
    return (end - begin) / (span.end - span.begin)


def mean_of(values: np.ndarray) -> Mean:
    """Mean of independent values, and its interval by Student's distribution."""
    spread = student.ppf(0.975, len(values) - 1) * sem(values)
    return Mean(float(np.mean(values)), float(spread))


def judged_pairs(differences: np.ndarray) -> str:
    """Outcome for some pairs; `differences` of speeds [m/s], first minus second robot, has shape (pairs, starts)."""
    if not (np.abs(differences) < EXPLODED).all():  # also for NaN
        return DIVERGES
    pairs, starts = differences.shape
    bound = student.ppf(1.0 - LEVEL / pairs, starts - 1) * sem(differences, axis=1)
    means = differences.mean(axis=1)
    if (means > bound).all():
        return HOLDS
    return DOES_NOT if (means < -bound).any() else NOISE


def one_run_pairs(differences: np.ndarray) -> str:
    """As `judged_pairs`, but by the differences of the first start only, without a test."""
    if not (np.abs(differences[:, 0]) < EXPLODED).all():
        return DIVERGES
    return HOLDS if (differences[:, 0] > 0.0).all() else DOES_NOT


def settled(claim: RankingClaim, speed: Mapping[FigurePoint, np.ndarray], judge: Callable[[np.ndarray], str]) -> str:
    """Outcome of a claim, by the function `judge` of differences; `speed` [m/s], shape (starts,), by robot."""
    def of(pairs: Pairs) -> str:
        return judge(np.array([speed[FigurePoint(claim.series, fast)] - speed[FigurePoint(claim.series, slow)]
                               for fast, slow in pairs]))

    named = of(claim.named)
    return NAMED if named == HOLDS and of((*claim.named, *claim.others)) != HOLDS else named


def single_scores(displacements: Displacements, span: Span) -> np.ndarray:
    """Number of claims that hold in each start alone, over a span; shape (starts,)."""
    speed = {point: speeds(values, span) for point, values in displacements.items()}
    starts = len(next(iter(speed.values())))
    alone = [{point: values[[start]] for point, values in speed.items()} for start in range(starts)]
    return np.array([score(tuple(settled(claim, values, one_run_pairs) for claim in CLAIMS)) for values in alone])


def verdicts(reading: Reading, displacements: Displacements) -> list[Verdict]:
    """Judge every claim under a reading, over each of its spans."""
    judgements = []
    for span in spans(reading):
        with np.errstate(invalid="ignore", over="ignore"):
            speed = {point: speeds(values, span) for point, values in displacements.items()}
            size = {point: np.abs(values) for point, values in speed.items()}
            one_run, along_ox, by_size = (
                tuple(settled(claim, values, judge) for claim in CLAIMS)
                for values, judge in ((speed, one_run_pairs), (speed, judged_pairs), (size, judged_pairs)))
            means = {point: mean_of(values) for point, values in speed.items()}
            judgements.append(Verdict(reading, span, one_run, along_ox, by_size, means))
    return judgements
