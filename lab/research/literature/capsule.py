"""The vibro-impact capsule of Liu, Pavlovskaia, Wiercigroch and others, as a special case of this model.

The guide lies along x (φ = 90°), there is no upper mass, the body's motion acts on the masses, N is the weight. The
crank is a millionth of its rod, so that the slider moves harmonically, and the drive spring transmits the published
force.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest, qmc

from research.literature.capsule_equations import Capsule, harmonic, integrate
from research.literature.findings import FAILS, HOLDS, NOISE, OUTSIDE, Check, Claim, Finding, Mapped, Studied
from research.starts import computed, started
from vibro_ros import Scene, Simulator

# Scales, which may be chosen freely: internal mass [kg], its spring [N/m], the unit of length P_f / k1 [m], rod [m],
# gravity [m/s²]. A shorter unit of length would lose digits; with a longer one the slider would not be harmonic.
_MASS, _STIFFNESS, _LENGTH, _ROD, _GRAVITY = 0.1, 1e3, 1e-6, 10.0, 9.81
_RATE = math.sqrt(_STIFFNESS / _MASS)
#: Ranges of the parameters of random machines.
BOX = {"alpha": (0.5, 4.0), "omega": (0.5, 2.0), "beta": (2.0, 50.0), "delta": (0.0, 1.0), "xi": (0.01, 0.1)}
#: Mass ratios that each machine is given.
RATIOS = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0)
#: The machine whose trajectory is compared with scipy's, and the number of periods of this comparison.
REFERENCE, PERIODS = Capsule(alpha=1.6, omega=0.95, beta=15.0, gamma=5.0, delta=0.02, xi=0.05), 10
#: Periods of settling; periods of each of the two halves of the measurement; least progression per period [P_f / k1]
#: that is distinguished from 0; and largest relative difference between the halves of a settled motion.
SETTLING, HALF, LEAST, SETTLED = 400, 100, 0.01, 0.05
_SAMPLES = 200


def capsule_scene(capsule: Capsule, rod: float = _ROD) -> Scene:
    """Return the scene of the published machine, with a `rod` [m]; -x is the published forward direction."""
    friction, damping = _STIFFNESS * _LENGTH, 2.0 * capsule.xi * _MASS * _RATE
    speed = capsule.omega * _RATE
    return Scene("capsule", {
        "mass.body": capsule.gamma * _MASS, "mass.inclined": _MASS, "guide.angle": math.pi / 2.0,
        "crank.radius": capsule.alpha * friction / math.hypot(_STIFFNESS, damping * speed),
        "crank.inclined_rod": rod, "crank.upper_rod": rod,
        "inclined.spring.stiffness": _STIFFNESS, "inclined.spring.damping": damping,
        "inclined.plate.stiffness": capsule.beta * _STIFFNESS, "inclined.gap": capsule.delta * _LENGTH,
        "ground.friction": friction / ((1.0 + capsule.gamma) * _MASS * _GRAVITY), "gravity": _GRAVITY,
        "motor.speed": speed, "motor.max_speed": max(500.0, speed), "effects.upper_mass": False,
        "effects.normal_force": "weight", "effects.reaction": True})


def drive_phase(capsule: Capsule) -> float:
    """Phase [rad] of the published force in the scene: the crank starts across the guide, the damper adds a lead."""
    return math.atan(2.0 * capsule.xi * capsule.omega) - math.pi / 2.0


def rod_harmonics(capsule: Capsule) -> float:
    """Amplitude r²/(4 L) of the slider's deviation from a harmonic motion, caused by the rod, in P_f / k1."""
    return capsule_scene(capsule)["crank.radius"] ** 2 / (4.0 * _ROD) / _LENGTH


def difference(capsule: Capsule, periods: int, rod: float = _ROD) -> float:
    """Largest difference of the capsule's position, in P_f / k1, from scipy's within `periods` periods from rest.

    It is proportional to 1/`rod`, like the rod's harmonics r²/(4 L), which are the only difference of the equations.
    """
    times = np.linspace(0.0, periods * capsule.period, _SAMPLES + 1)
    simulated = -Simulator(capsule_scene(capsule, rod)).sample(times / _RATE).body_position / _LENGTH
    by_scipy = integrate(capsule, times, harmonic(capsule, drive_phase(capsule)))[:, 2]
    return float(np.max(np.abs(simulated - by_scipy)))


def outside_difference(capsule: Capsule, periods: int) -> float:
    """The same without the second spring; scipy's internal mass is driven from outside by the force m1 r Ω²."""
    scene = capsule_scene(capsule).with_parameters({"effects.inclined_contact": "none"})
    times = np.linspace(0.0, periods * capsule.period, _SAMPLES + 1)
    samples = Simulator(scene).sample(times / _RATE)
    reach = scene["crank.radius"] / _LENGTH
    free = Capsule(reach * capsule.omega**2, capsule.omega, 0.0, capsule.gamma, 0.0, capsule.xi)
    # Its internal mass has our position minus the slider's, r sin τ; so its speed at t = 0 is -r ω.
    by_scipy = integrate(free, times, harmonic(free, -math.pi / 2.0, reaction=0.0), speed=-reach * capsule.omega)[:, 2]
    return float(np.max(np.abs(-samples.body_position / _LENGTH - by_scipy)))


@dataclass(frozen=True)
class Progression:
    """Progression per period, in P_f / k1, in both halves of a long run."""

    first: float
    second: float

    @property
    def mean(self) -> float:
        """Mean of both halves."""
        return (self.first + self.second) / 2.0

    @property
    def settled(self) -> bool:
        """Whether it is distinguished from 0, and equal in both halves."""
        return abs(self.first - self.second) <= SETTLED * abs(self.mean) and abs(self.mean) >= LEAST


def progression(device: Simulator, period: float) -> Progression:
    """Progression of a `device` with a drive of `period` [s], after it has settled."""
    begin = device.time
    places = []
    for periods in (SETTLING, SETTLING + HALF, SETTLING + 2 * HALF):
        device.advance_to(begin + periods * period)
        places.append(-device.state.body_position / _LENGTH)
    return Progression(*(float(step) for step in np.diff(places) / HALF))


@dataclass(frozen=True)
class Survey:
    """Progressions of a random machine with every mass ratio, each from several starts."""

    machine: Capsule  # the machine, with the first of the mass ratios
    progressions: dict[float, tuple[Progression, ...]]  # from rest and from each random start, by mass ratio

    def signs_from_rest(self) -> set[float]:
        """Directions, 1 and -1, of the settled progressions from rest over all mass ratios."""
        return {math.copysign(1.0, runs[0].mean) for runs in self.progressions.values() if runs[0].settled}

    def opposed_ratios(self) -> list[float]:
        """Mass ratios at which different starts settle in opposite directions."""
        directions = {ratio: {math.copysign(1.0, run.mean) for run in runs if run.settled}
                      for ratio, runs in self.progressions.items()}
        return [ratio for ratio, both in directions.items() if len(both) == 2]


def surveyed(job: tuple[Capsule, int]) -> Survey:
    """Survey a machine; `job` is the machine and the number of random starts, which are used beside rest."""
    machine, starts = job
    progressions = {}
    for ratio in RATIOS:
        scene = capsule_scene(Capsule(**{**vars(machine), "gamma": ratio}))
        period = 2.0 * math.pi / scene["motor.speed"]
        runs = [progression(Simulator(scene), period)]
        for number in range(starts):
            device = started(scene, np.random.default_rng(number))
            runs.append(progression(device, period))
        progressions[ratio] = tuple(runs)
    return Survey(machine, progressions)


def machines(count: int) -> list[Capsule]:
    """Return random machines from `BOX`, a power of two of them, by a scrambled Sobol sequence with a fixed seed."""
    draws = qmc.Sobol(len(BOX), seed=1).random_base2(round(math.log2(count)))
    low, high = zip(*BOX.values(), strict=True)
    return [Capsule(gamma=RATIOS[0], **dict(zip(BOX, map(float, row), strict=True)))
            for row in qmc.scale(draws, low, high)]


NAME = "capsule"
# Factor on the rod's harmonics in the bound of the check: spring and plate amplify them about ten times.
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
        Claim("The capsule of 26 mm can reach 14.4 mm/s by the authors' own model (abstract of 2020).",
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
        runs = [run for survey in surveys for run in survey.progressions[ratio][:1] if run.settled]
        axes.plot(len(runs) * [ratio], [run.mean for run in runs], ".", color="tab:blue", alpha=0.3)
        opposed = [run.mean for survey in surveys if ratio in survey.opposed_ratios()
                   for run in survey.progressions[ratio] if run.settled]
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
