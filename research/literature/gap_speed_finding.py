"""What the study of impact gaps finds, in words and as a picture."""

import math
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from research.literature.gap_speed import (
    CHECKED_TURNS,
    DAMPING,
    GAPS,
    MOTORS,
    Tried,
    difference,
    tried,
    tried_one_way,
)
from research.literature.published import FAILS, HOLDS, NOISE, OUTSIDE, Check, Claim, Finding, Mapped, Studied
from vibro_ros.accuracy.starts import Average
from vibro_ros.study.progress import computed

NAME = "gap"
_BOUND = 1e-8  # m
_ONE_WAY = ", with wheels that turn one way only (not contained; scipy alone)"


def study(quick: bool) -> Studied:
    """Try gaps at every motor speed from 16 starts; `quick`: every fourth gap from 2, and no one-way wheels."""
    starts = 2 if quick else 16
    gaps = GAPS[::4] if quick else GAPS
    rows = computed(tried, [(gap, motor, starts) for motor in MOTORS for gap in gaps], "gap: gaps")
    curves = {motor: [row for row in rows if row.motor == motor] for motor in MOTORS}
    own_gaps = [gap for gap in GAPS if gap >= 0.0][::2]
    jobs = [] if quick else [(gap, motor, 2) for motor in MOTORS for gap in own_gaps]
    one_way = computed(tried_one_way, jobs, "gap: one-way wheels") if jobs else []
    finding = Finding(
        NAME, "Impact gap and speed", _SOURCES, _CONTAINED, _MAPPING,
        (Check(f"body's position over {CHECKED_TURNS} turns, exact against scipy's DOP853, in m; gap 10 mm, 100 rad/s",
               difference(0.010, 100.0), _BOUND),),
        (*(claim(curve) for curve in curves.values()),
         *(claim([row for row in one_way if row.motor == motor], _ONE_WAY) for motor in MOTORS if one_way), _UNREAD),
        _MISSING)
    return Studied(finding, lambda: _figure(curves))


def claim(curve: Sequence[Tried], where: str = "") -> Claim:
    """The rule that hardest blows make the robot fastest, at one motor speed; `curve` by ascending gaps."""
    fastest = max(curve, key=lambda row: row.speed.mean)
    hardest = max(curve, key=lambda row: row.approach.mean)
    gap, spread = fastest.speed.mean - hardest.speed.mean, math.hypot(fastest.speed.spread, hardest.speed.spread)
    same = abs(fastest.gap - hardest.gap) <= curve[1].gap - curve[0].gap + 1e-9
    verdict = HOLDS if same else NOISE if gap <= spread else FAILS
    blows = "" if fastest.approach.mean else ", without a blow"
    return Claim(
        "The robot is fastest with the gap at which the internal body hits its plate fastest (abstract, April 2022); "
        f"at {fastest.motor:g} rad/s{where}.",
        f"hardest blows, {hardest.approach.mean:.2f} m/s, at {1e3 * hardest.gap:g} mm, where it moves at "
        f"{_mm(hardest.speed)} mm/s; fastest at {1e3 * fastest.gap:g} mm, {_mm(fastest.speed)} mm/s{blows}",
        verdict, _RULE)


def _mm(value: Average) -> str:
    return f"{1e3 * value.mean:.1f} ± {1e3 * value.spread:.1f}"


def _figure(curves: Mapping[float, Sequence[Tried]]) -> Figure:
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for motor, curve in curves.items():
        gaps = [1e3 * row.gap for row in curve]
        for axes, values in ((upper, [row.speed for row in curve]), (lower, [row.approach for row in curve])):
            axes.errorbar(gaps, [value.mean for value in values], [value.spread for value in values], marker=".",
                          lw=1.0, capsize=2, label=f"{motor:g} rad/s")
    upper.set_ylabel("speed towards the\nplate in m/s")
    lower.set(xlabel="impact gap in mm", ylabel="speed at which the\nplate is hit in m/s")
    upper.legend(fontsize=8)
    return figure


_RULE = ("holds if both gaps are the same or neighbours; else within noise if the 95 % intervals of both speeds allow "
         "that they are equal, and does not hold if not")
_UNREAD = Claim(
    "The curve of mean speed over impact gap of the wheeled robot (September 2022).",
    "not compared: masses, stiffnesses, drive, friction and the curve itself are in the body of the paper", OUTSIDE,
    "a number is compared with the parameters it belongs to, or not at all")
_SOURCES = (
    "V. Korendiy, V. Gursky, O. Kachur, P. Dmyterko, O. Kotsiumbas, O. Havrylchenko, *Mathematical model and motion "
    "analysis of a wheeled vibro-impact locomotion system*, Vibroengineering Procedia, 21 April 2022, "
    "[article 22422](https://www.extrica.com/article/22422) (abstract read)",
    "*Studying the influence of the impact gap value on the average translational speed of the wheeled "
    "vibration-driven robot*, Eng. Proc. 24 (2022) 25, "
    "[10.3390/IECMA2022-12897](https://doi.org/10.3390/IECMA2022-12897) (first half of the abstract read)")
_CONTAINED = (
    "Contained: a platform, an internal body on a spring and a crank, a plate at a gap, all along one line, as the "
    "capsule above with the crank's own motion in place of a harmonic force. Not contained: the wheels' brakes, which "
    "let them turn one way only, as here Coulomb's friction is the same both ways. Since the rule is stated for such "
    "wheels, scipy alone tries it with them, too.")
_MAPPING = (
    Mapped("platform and internal body", "the two masses", "`mass.body`, `mass.inclined`, `guide.angle` = 90°"),
    Mapped("crank-slider exciter", "drive",
           "`crank.radius`, `crank.inclined_rod`, `inclined.spring.stiffness`, `motor.speed`"),
    Mapped("impact plate", "second spring", "`inclined.plate.stiffness`"),
    Mapped("impact gap", "clearance at mid-stroke", "`inclined.gap`"),
    Mapped("average translational velocity", "over 10 s, after 4 s", "−`body_position` / time"))
_MISSING = (
    "the body of both papers, and with it every parameter: the robot here has those of the seed paper of 2021, a drive "
    f"damper of {DAMPING:g} N·s/m and reaction on. What is tested is the rule by which the gap is chosen.")
