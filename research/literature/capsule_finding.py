"""What the study of the vibro-impact capsule finds, in words and as a picture."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from scipy.stats import binomtest

from research.literature.capsule import (
    BOX,
    HALF,
    LEAST,
    PERIODS,
    RATIOS,
    REFERENCE,
    SETTLED,
    Survey,
    difference,
    machines,
    outside_difference,
    rod_harmonics,
    surveyed,
)
from research.literature.published import FAILS, HOLDS, NOISE, OUTSIDE, Check, Claim, Finding, Mapped, Studied
from vibro_ros.study.progress import computed

NAME = "capsule"
# Spring and plate enlarge the rod's harmonics: some ten times; nothing else may differ.
_ENLARGED = 20.0


def study(quick: bool) -> Studied:
    """Check the mapping, and survey 16 machines (`quick`) or 128."""
    count, starts = (16, 2) if quick else (128, 6)
    surveys = computed(surveyed, [(machine, starts) for machine in machines(count)], "capsule: machines")
    bound = _ENLARGED * rod_harmonics(REFERENCE)
    finding = Finding(
        NAME, "The vibro-impact capsule", _SOURCES, _CONTAINED, _MAPPING,
        (Check(f"capsule's position over {PERIODS} periods, exact against scipy's DOP853 in the literature's own "
               "variables, in P_f/k1",
               difference(REFERENCE, PERIODS), bound),
         Check("the same without the second spring, the published force acting from outside, in P_f/k1",
               outside_difference(REFERENCE, PERIODS), bound)),
        _claims(surveys, starts), _MISSING)
    return Studied(finding, lambda: _figure(surveys))


def _claims(surveys: Sequence[Survey], starts: int) -> tuple[Claim, ...]:
    reversing = [survey for survey in surveys if len(survey.signs_from_rest()) == 2]
    opposed = [survey for survey in surveys if survey.opposed_ratios()]
    directions = set().union(*(survey.signs_from_rest() for survey in surveys))
    return (
        Claim("Driven harmonically, the capsule can move forwards and backwards (abstracts of 2013 and 2017).",
              f"settled motions in {'both directions' if len(directions) == 2 else 'one direction'} among "
              f"{len(surveys)} machines × {len(RATIOS)} mass ratios", HOLDS if len(directions) == 2 else FAILS, _RULE),
        Claim("The direction can be chosen by the mass ratio alone (abstract of 2013).",
              f"in {_share(len(reversing), len(surveys))} of the machines γ from {RATIOS[0]:g} to {RATIOS[-1]:g} "
              "reverses the motion from rest", HOLDS if reversing else NOISE, _RULE),
        Claim("It can be chosen by switching between coexisting attractors (abstract of 2013).",
              f"in {_share(len(opposed), len(surveys))} of the machines some mass ratio has settled motions in both "
              f"directions, among {starts + 1} starts", HOLDS if opposed else NOISE, _RULE),
        Claim("The capsule of 26 mm reaches 14.4 mm/s (abstract of 2020).",
              "not compared: its masses, stiffnesses, gap, drive and friction are not in the abstract", OUTSIDE,
              "a number is compared with the parameters it belongs to, or not at all"))


def _share(count: int, total: int) -> str:
    interval = binomtest(count, total).proportion_ci()
    low, high = 100.0 * interval.low, 100.0 * interval.high
    return f"{100.0 * count / total:.0f} % ({count} of {total}; 95 % interval {low:.0f}–{high:.0f} %)"


def _figure(surveys: Sequence[Survey]) -> Figure:
    figure = Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for ratio in RATIOS:
        runs = [run for survey in surveys for run in survey.found[ratio][:1] if run.settled]
        axes.plot(len(runs) * [ratio], [run.mean for run in runs], ".", color="tab:blue", alpha=0.3)
        opposed = [run.mean for survey in surveys if ratio in survey.opposed_ratios()
                   for run in survey.found[ratio] if run.settled]
        axes.plot(len(opposed) * [ratio * 1.06], opposed, "x", color="tab:red")
    axes.axhline(0.0, color="black", lw=0.6)
    axes.set(xscale="log", xticks=RATIOS, xticklabels=[f"{ratio:g}" for ratio in RATIOS], yscale="symlog",
             xlabel="mass ratio γ", ylabel="progression a period in P_f / k1")
    axes.set_title("Each drawn capsule from rest; red: attractors of one capsule in both directions", fontsize=9)
    axes.minorticks_off()
    return figure


_SOURCES = (
    "Y. Liu, E. Pavlovskaia, D. Hendry, M. Wiercigroch, *Vibro-impact responses of capsule system with various "
    "friction models*, Int. J. Mech. Sci., July 2013, pp. 39–54 (abstract read)",
    "Y. Liu, J. Páez Chávez, *Controlling multistability in a vibro-impact capsule system*, Nonlinear Dyn., 2017, "
    "[10.1007/s11071-016-3310-3](https://doi.org/10.1007/s11071-016-3310-3) (abstract and introduction read)",
    "Y. Liu, J. Páez Chávez, J. Zhang, J. Tian, B. Guo, S. Prasad, *The vibro-impact capsule system in millimetre "
    "scale*, Meccanica, 2020, [10.1007/s11012-020-01237-8](https://doi.org/10.1007/s11012-020-01237-8) (abstract read)")
_CONTAINED = (
    "Contained exactly, if the capsule itself pushes the internal mass: φ = 90°, no upper mass, reaction on, N = M g. "
    "The drive spring pulls with k (w − s), and s = r cos Ωt + L leaves −k r cos Ωt of it as the published force; the "
    "damper acts on w' − s' and adds c r Ω sin Ωt, so that r √(k² + (c Ω)²) is the force's amplitude and "
    "atan(c Ω/k) its lead. A rod of the length L adds harmonics of at most r²/(4L). If the force comes from outside, "
    "as from a coil beside the capsule, the substitution x1 = w − (s − L) turns it into an internal one of the "
    "amplitude r with P_d = m1 r Ω², but moves the second spring along with the slider: contained without "
    "impacts only. Which of both the papers mean could not be read.")
_MAPPING = (
    Mapped("m1, k1, c", "internal mass, its spring and damper",
           "`mass.inclined`, `inclined.spring.stiffness`, `inclined.spring.damping`"),
    Mapped("k2, G", "weightless second spring and its gap", "`inclined.plate.stiffness` (no damper), `inclined.gap`"),
    Mapped("m2", "capsule", "`mass.body`"),
    Mapped("P_f", "Coulomb friction", "`ground.friction` × (m1 + m2) × `gravity`"),
    Mapped("P_d cos Ωt", "drive", "`crank.radius` = P_d/√(k1² + (c Ω)²), `motor.speed` = Ω"),
    Mapped("ω = Ω/Ω0, Ω0 = √(k1/m1)", "frequency", "`motor.speed`/Ω0"),
    Mapped("α = P_d/P_f, δ = k1 G/P_f", "drive, gap", "in units of P_f and of P_f/k1"),
    Mapped("β = k2/k1, γ = m2/m1, ξ = c/(2 m1 Ω0)", "stiffness, mass and damping ratio", "as they stand"),
    Mapped("x2", "capsule's position, forwards", "−`body_position`: this model's guide points to −x"))
_RULE = ("what is said to be possible holds if it occurs in a machine drawn at random, in a settled motion: "
         f"progression at least {LEAST:g} P_f/k1 a period, the same to {100 * SETTLED:.0f} % in two stretches of "
         f"{HALF} periods")
_MISSING = (
    "the bodies of the papers could not be read here, so neither the parameters of their figures nor the frequencies "
    "of their bifurcations, progressions and optima are compared. The equations and the names of the numbers without "
    "units are the usual ones of this literature, from memory. The ranges of the machines are ours: "
    + ", ".join(f"{name} {low:g}–{high:g}" for name, (low, high) in BOX.items())
    + ". The position feedback of 2017 is not contained.")
