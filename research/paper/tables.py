"""Tables of the study `paper`, in Markdown, and what their marks mean."""

import math
from collections.abc import Iterable, Sequence

from research.paper.claims import (
    CLAIMS,
    DIVERGES,
    DOES_NOT,
    HOLDS,
    LEVEL,
    NAMED,
    NOISE,
    Claim,
    Verdict,
    score,
)
from research.paper.readings import BEST_ANGLE, SERIES, UNITS, Point, Reading

EQUATIONS_IN_WORDS = {"corrected": "Corrected equations", "misprint": "Equations as misprinted"}
MARKS = {HOLDS: "●", NAMED: "○", DOES_NOT: "–", NOISE: "~", DIVERGES: "∞"}


def claims_table() -> str:
    """Claims, with the pairs that are compared."""
    rows = [f"| {claim.name} | {claim.words} | {_pairs(claim, claim.named)} | {_pairs(claim, claim.others)} |"
            for claim in CLAIMS]
    return "\n".join(["| claim | what the paper says | pairs at named values, faster > slower | other pairs |",
                      "|---|---|---|---|", *rows])


def _pairs(claim: Claim, pairs: Iterable[tuple[float, float]]) -> str:
    return "; ".join(f"{fast:g} > {_valued(claim.series, slow)}" for fast, slow in pairs)


def rules(starts: tuple[int, int]) -> str:
    """How verdicts are made; `starts` are those of a robot under readings by `exact`, and under the others."""
    return (
        f"*Speed* is the mean speed along Ox, forwards positive. Each robot starts {starts[0]} times under a reading "
        f"by `exact`, and {starts[1]} times under the others. The first start is the named one: `zero`, every "
        "coordinate 0, or `rest`, each mass at rest on its slider or, where that is nearer, on its plate. In the "
        "others the crank is ahead by up to 0.1 rad, at random. The start `phase` is `rest` with the crank anywhere in "
        "the half turn in which the upper slider moves. In the other half the slider of a crank as long as its rods "
        "stands still, where masses that start at rest on it make copies of one another, only later.\n\n"
        "A claim is judged pair by pair, by the mean of the differences from the same starts, with Student's test on "
        f"one side; its level of {100 * LEVEL:g} % is shared among its pairs. {MARKS[HOLDS]} holds in all pairs; "
        f"{MARKS[NAMED]} holds at the named values and not in all pairs; {MARKS[DOES_NOT]} does not, because a pair is "
        f"the other way round; {MARKS[NOISE]} within noise; {MARKS[DIVERGES]} the method diverges.\n\n"
        "*score*: claims that hold, at the named values at least. *one run*: the same for the first start alone, "
        "without a test, as the paper may have it. *size*: the score by the size of the speed, whichever way the robot "
        "goes. *forwards / backwards*: robots of all figures that go so beyond their 95 % intervals. *fastest*: along "
        "Ox.")


def verdict_table(told: Sequence[Verdict]) -> str:
    """A line for each reading and span."""
    heads = ["reading", "span", *(claim.name for claim in CLAIMS), "score", "one run", "size", "forwards / backwards",
             "fastest", "speed at 80°"]
    return "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *map(_row, told)])


def _row(one: Verdict) -> str:
    scores = (str(score(outcomes)) for outcomes in (one.along_ox, one.one_run, one.size))
    cells = [_reading(one.reading), str(one.span), *(MARKS[outcome] for outcome in one.along_ox), *scores]
    if DIVERGES in one.along_ox:
        cells += ["", "", ""]
    else:
        fastest = ", ".join(_valued(series, one.fastest(series)) for series in SERIES)
        cells += [" / ".join(map(str, one.forwards)), fastest, _interval(*one.means[Point("angle", BEST_ANGLE)])]
    return f"| {' | '.join(cells)} |"


def speed_table(told: Sequence[Verdict], equations: str, rule: str, start: str) -> str:
    """Mean speeds by span and angle, under the readings by `exact` with these equations, rule and start."""
    own, values = [v for v in told if v.reading[2:5] == (equations, rule, start)], SERIES["angle"]
    lines = [f"{EQUATIONS_IN_WORDS[equations]}, normal force `{rule}`, start `{start}`:", "",
             f"| span | {' | '.join(f'{value:g}°' for value in values)} |", "|---" * (len(values) + 1) + "|"]
    lines += [f"| {one.span} | " + " | ".join(_interval(*one.means[Point("angle", value)]) for value in values) + " |"
              for one in own]
    return "\n".join(lines)


def _reading(reading: Reading) -> str:
    own = f"`{reading.normal_force}`, `{reading.start}`"
    if reading.solver == "exact":
        return own
    friction = "" if reading.friction == "eq5" else f", {reading.friction} friction"
    return f"{reading.equations}, {own}, {solver_in_words(reading)}{friction}"


def solver_in_words(reading: Reading) -> str:
    """The solver with its step, as code."""
    return f"`{reading.solver}`{f' of {reading.step:g} s' if reading.step else ''}"


def _valued(series: str, value: float) -> str:
    return f"{value:g}{'' if UNITS[series] == '°' else ' '}{UNITS[series]}"


def _interval(mean: float, spread: float) -> str:
    """A mean speed and half its interval, to the interval's second digit, 0.1 mm/s at most; the interval rounded up."""
    digits = min(4, max(0, 1 - math.floor(math.log10(spread)))) if spread > 0.0 else 4
    return f"{mean:.{digits}f} ± {math.ceil(spread * 10**digits) / 10**digits:.{digits}f} m/s"


def speed_in_words(speed: float) -> str:
    """A speed [m/s], whole from 10 m/s on, else to three digits."""
    return f"{speed:.0f} m/s" if abs(speed) >= 10.0 else f"{speed:.3g} m/s"
