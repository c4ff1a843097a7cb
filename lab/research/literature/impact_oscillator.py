"""The impact oscillator of Budd and Dux: x'' + x = cos ωt below a rigid stop at σ, from which x' rebounds as -r x'.

A mass on its guide is this oscillator: lengths in units of the crank radius, times of sqrt(m/k). Its (1, n) orbits, one
impact in n turns, have closed forms, and so have their folds and period doublings.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.stats import binomtest

from research.literature.capsule_equations import TerminalEvent
from research.literature.findings import FAILS, HOLDS, MISSIGNED, Check, Claim, Finding, Mapped, Studied
from research.starts import computed
from vibro_ros import Scene, Simulator

_MASS, _STIFFNESS, _RADIUS, _ROD = 0.1, 1e3, 1e-5, 100.0
_RATE = math.sqrt(_STIFFNESS / _MASS)
# Turns of settling, turns of observation, relative difference of equal impacts, and speed of the plate in crank radii
# per turn.
_SETTLING, _SEEN, _EQUAL, _PLATE = 1500, 60, 1e-6, 0.002
_SAMPLES = 400


@dataclass(frozen=True)
class Oscillator:
    """An impact oscillator; all numbers are dimensionless."""

    omega: float  # frequency of the force over the oscillator's own
    sigma: float  # position of the stop in units of the force over the stiffness
    restitution: float  # speed after an impact over the speed before it

    @property
    def reach(self) -> float:
        """Amplitude of the motion without a stop, dimensionless."""
        return 1.0 / abs(1.0 - self.omega**2)

    def shape(self, turns: int) -> tuple[float, float]:
        """a and b of the ellipse (σ + a V)² + (b V)² = reach² of the speeds V of impact of the (1, `turns`) orbits."""
        half = math.pi * turns / self.omega
        return (1.0 + self.restitution) / (2.0 * math.tan(half)), (1.0 - self.restitution) / (2.0 * self.omega)

    def speeds(self, turns: int) -> tuple[float, float]:
        """Impact speeds on the upper and the lower branch, dimensionless; NaN if a branch does not exist."""
        a, b = self.shape(turns)
        square = a**2 + b**2
        root = (a * self.sigma) ** 2 - square * (self.sigma**2 - self.reach**2)
        if root < 0.0:
            return math.nan, math.nan
        upper, lower = ((-a * self.sigma + sign * math.sqrt(root)) / square for sign in (1.0, -1.0))
        return (upper if upper > 0.0 else math.nan), (lower if lower > 0.0 else math.nan)

    def fold(self, turns: int) -> float:
        """Position of the stop at which both branches meet, dimensionless."""
        a, b = self.shape(turns)
        return -math.copysign(self.reach * math.hypot(a, b) / b, a)

    def multipliers(self, turns: int, speed: float) -> np.ndarray:
        """Multipliers of the (1, `turns`) orbit with impact speed `speed`, shape (2,), complex."""
        a, _ = self.shape(turns)
        restitution = self.restitution
        sine, cosine = math.sin(2.0 * math.pi * turns / self.omega), math.cos(2.0 * math.pi * turns / self.omega)
        push = (1.0 - self.omega**2) * (self.sigma + a * speed) - self.sigma  # acceleration at the impact
        impact = np.array([[-restitution, 0.0], [(1.0 + restitution) * push / speed, -restitution]])
        return np.linalg.eigvals(np.array([[cosine, sine], [-sine, cosine]]) @ impact)

    def doubling_defect(self, turns: int) -> float:
        """1 + trace + determinant of the upper branch's orbit: 0 where a multiplier is -1."""
        product = self.multipliers(turns, self.speeds(turns)[0])
        return float(np.real(1.0 + product.sum() + product.prod()))


def oscillator_scene(oscillator: Oscillator) -> Scene:
    """Return the scene of the oscillator: the upper mass only, its plate rigid, no damper."""
    return Scene("impact_oscillator", {
        "mass.upper": _MASS, "upper.spring.stiffness": _STIFFNESS, "upper.plate.restitution": oscillator.restitution,
        "upper.gap": oscillator.sigma * _RADIUS, "crank.radius": _RADIUS, "crank.upper_rod": _ROD,
        "crank.inclined_rod": _ROD, "motor.speed": oscillator.omega * _RATE, "motor.max_speed": 1e4,
        "gap_actuator.speed": _PLATE * _RADIUS * oscillator.omega * _RATE / (2.0 * math.pi),
        "effects.inclined_mass": False, "effects.upper_contact": "restitution", "effects.normal_force": "weight"})


@dataclass(frozen=True)
class ImpactMotion:
    """A settled motion: impacts and turns of its period, 0 if no period was found, and the impact speeds."""

    impacts: int
    turns: int
    speeds: tuple[float, ...]


def started(oscillator: Oscillator, spin: float) -> Simulator:
    """Return a device whose motor ran at `spin` times its speed for the time of 20 turns."""
    device, speed = Simulator(oscillator_scene(oscillator)), oscillator.omega * _RATE
    device.command(motor_speed=spin * speed)
    device.advance_to(20.0 * 2.0 * math.pi / speed)
    device.command(motor_speed=speed)
    return device


def settled(device: Simulator, oscillator: Oscillator, turns: int = _SETTLING) -> ImpactMotion:
    """Let a device settle for `turns` turns, and return its motion."""
    turn = 2.0 * math.pi / (oscillator.omega * _RATE)
    device.advance_to(device.time + turns * turn)
    device.take_events()
    begin = device.time
    device.advance_to(begin + _SEEN * turn)
    events = device.take_events()
    blows = events["speed"][events["kind"] == "upper_contact"] / (_RADIUS * _RATE)
    for count in range(1, len(blows) // 3 + 1):
        if np.allclose(blows[count:], blows[:-count], rtol=_EQUAL, atol=0.0):
            took = round(_SEEN * count / len(blows))
            return ImpactMotion(count, took, tuple(float(speed) for speed in blows[:count]))
    return ImpactMotion(0, 0, tuple(float(speed) for speed in blows))


def followed(oscillator: Oscillator, start: float) -> ImpactMotion:
    """Return the motion after the stop has been moved slowly from `start` to its position."""
    device = started(replace(oscillator, sigma=start), 1.0)
    settled(device, oscillator)
    device.command(upper_gap=oscillator.sigma * _RADIUS)
    return settled(device, oscillator, _SETTLING + math.ceil(abs(oscillator.sigma - start) / _PLATE))


def doubling(oscillator: Oscillator, turns: int, low: float, high: float) -> float:
    """Position of the stop between `low` and `high` at which the upper branch's orbit doubles its period."""
    return brentq(lambda sigma: replace(oscillator, sigma=sigma).doubling_defect(turns), low, high)


def difference(oscillator: Oscillator, turns: int) -> float:
    """Largest difference of the position from scipy's, in crank radii, within `turns` turns from rest at x = 1.

    The stop of `oscillator` must lie beyond 1, where the mass is at its slider initially.
    """
    times = np.linspace(0.0, turns * 2.0 * math.pi / oscillator.omega, _SAMPLES + 1)
    simulated = (Simulator(oscillator_scene(oscillator)).sample(times / _RATE).upper_position - _ROD) / _RADIUS
    return float(np.max(np.abs(simulated - _by_scipy(oscillator, times))))


def _by_scipy(oscillator: Oscillator, times: np.ndarray) -> np.ndarray:
    def right(time: float, state: np.ndarray) -> list[float]:
        return [state[1], math.cos(oscillator.omega * time) - state[0]]

    stop = TerminalEvent(lambda _time, state: state[0] - oscillator.sigma, 1.0)
    positions, done, time, state = np.empty(len(times)), 0, 0.0, np.array([1.0, 0.0])
    while done < len(times):
        piece = solve_ivp(right, (time, times[-1]), state, method="DOP853", rtol=1e-12, atol=1e-13, max_step=0.1,
                          events=stop, dense_output=True)
        upto = len(times) if piece.status == 0 else int(np.searchsorted(times, piece.t[-1]))
        if upto > done:
            positions[done:upto] = piece.sol(times[done:upto])[0]
        done, time = upto, piece.t[-1]
        state = np.array([oscillator.sigma, -oscillator.restitution * piece.y[1, -1]])
    return positions


NAME = "impact_oscillator"
_RESTITUTIONS = (0.8, 0.6)
#: Frequencies and n of their (1, n) orbits, on both sides of 2 n; positions of the stop as shares of the reach.
_ORBITS = ((1.9, 1), (2.0, 1), (2.1, 1), (3.9, 2), (4.0, 2), (4.2, 2), (6.0, 3))
_PLACES = (-0.5, -0.25, 0.0, 0.25, 0.5)
# Frequencies and n of the folds, and relative distance to which they are approached; the same for period doublings.
_FOLDS, _NEAR = ((1.9, 1), (2.1, 1)), 0.005
_DOUBLINGS, _BESIDE = ((2.5, 1), (2.8, 1), (4.6, 2)), 0.02
_MARGIN, _CHECKED_TURNS, _BOUND = 1e-5, 20, 1e-5


@dataclass(frozen=True)
class Compared:
    """An orbit's closed form and the settled motion of the simulation."""

    oscillator: Oscillator
    turns: int
    motion: ImpactMotion

    @property
    def error(self) -> float:
        """Relative error of the impact speed; infinite if the simulation settled to another motion."""
        if (self.motion.impacts, self.motion.turns) != (1, self.turns):
            return math.inf
        return abs(self.motion.speeds[0] / self.oscillator.speeds(self.turns)[0] - 1.0)


def compared(job: tuple[Oscillator, int]) -> Compared:
    """Simulate the settled motion from rest, for comparison with the closed form; `job` is oscillator and turns."""
    oscillator, turns = job
    return Compared(oscillator, turns, settled(started(oscillator, 1.0), oscillator))


def study(quick: bool) -> Studied:
    """Compare orbits, folds and period doublings; a tenth of the starts if `quick`."""
    jobs = [(Oscillator(omega, 0.0, restitution), turns) for restitution in _RESTITUTIONS for omega, turns in _ORBITS]
    jobs = [(replace(oscillator, sigma=place * oscillator.reach), turns)
            for oscillator, turns in jobs for place in _PLACES]
    rows = computed(compared, jobs, "impact_oscillator: orbits")
    finding = Finding(
        NAME, "The impact oscillator of Budd and Dux", _SOURCES, _CONTAINED, _MAPPING,
        (Check(f"position over {_CHECKED_TURNS} turns, exact against scipy's DOP853 in the literature's own variables, "
               "in crank radii", difference(Oscillator(1.9, 1.05, 0.8), _CHECKED_TURNS), _BOUND),),
        (*_ellipse(rows), *_tilt(), _folds(), _lower(), _doublings(), _attraction(10 if quick else 100)), _MISSING)
    return Studied(finding, lambda: _figure(rows))


def _ellipse(rows: Sequence[Compared]) -> tuple[Claim, Claim]:
    worst = max(row.error for row in rows)
    at_resonance = {(row.oscillator, row.turns): row.motion.speeds[0] for row in rows
                    if row.oscillator.omega == 2 * row.turns and row.motion.speeds}
    uneven = max(abs(speed / at_resonance[(replace(oscillator, sigma=-oscillator.sigma), turns)] - 1.0)
                 for (oscillator, turns), speed in at_resonance.items())
    rule = f"within {_MARGIN:g}; the rod's harmonics are 2.5e-8 of the stroke"
    return (
        Claim("The speed V of impact of the (1, n) orbits has a closed form; over σ it is half an ellipse about the "
              "origin.", f"{len(rows)} settled motions, n = 1, 2, 3, differ from (σ + a V)² + (b V)² = 1/(1 − ω²)² by "
              f"at most {worst:.1g} of V", HOLDS if worst <= _MARGIN else FAILS, rule),
        Claim("Its major axis is vertical for ω = 2n.",
              f"for ω = 2, 4, 6 V is the same at σ and −σ to {uneven:.1g}",
              HOLDS if uneven <= _MARGIN else FAILS, rule))


def _tilt() -> list[Claim]:
    claims = []
    for omega, side, words in ((1.9, -1.0, "negative"), (2.1, 1.0, "positive")):
        beyond = Oscillator(omega, 0.0, 0.8)
        motions = {sign: followed(replace(beyond, sigma=sign * 1.2 * beyond.reach), 0.0) for sign in (-1.0, 1.0)}
        exists = {sign: (motion.impacts, motion.turns) == (1, 1) for sign, motion in motions.items()}
        slope = beyond.shape(1)[0]
        speed = motions[-side].speeds[0] if exists[-side] else math.nan
        claims.append(Claim(
            f"The ellipse is tilted into the {words} σ for ω {'<' if omega < 2 else '>'} 2n.",
            f"at ω = {omega:g} the simulated (1, 1) orbit exists at σ = {-side * 1.2 * beyond.reach:.3f} (V = "
            f"{speed:.3f}) and not at {side * 1.2 * beyond.reach:.3f}. So does the closed form: σ = c − a V with a = "
            f"(1 + r)/(2 tan(π n/ω)) = {slope:.3f}. The summary has the signs exchanged: where T exceeds π, the mass "
            "is longer below the stop than half a free oscillation, which needs σ > 0", verdict_of_tilt(
                side, slope, exists), "the side on which the settled orbit exists beyond abs(σ) = 1/abs(1 − ω²), and "
            "the sign of −a: both as published holds, both reversed is a wrong sign"))
    return claims


def verdict_of_tilt(side: float, slope: float, exists: Mapping[float, bool]) -> str:
    """Verdict on a tilt to a published `side`, the sign of σ, from a of the closed form and the sides with an orbit."""
    if exists[side] == exists[-side]:
        return FAILS
    seen = side if exists[side] else -side
    return FAILS if -slope * seen <= 0.0 else HOLDS if seen == side else MISSIGNED


def _folds() -> Claim:
    kept = []
    for omega, turns in _FOLDS:
        fold = Oscillator(omega, 0.0, 0.8).fold(turns)
        motions = [followed(Oscillator(omega, fold * (1.0 + step), 0.8), 0.0) for step in (-_NEAR, _NEAR)]
        kept.append([(motion.impacts, motion.turns) == (1, turns) for motion in motions])
    places = ", ".join(f"{Oscillator(omega, 0.0, 0.8).fold(turns):.5f} for ω = {omega:g}" for omega, turns in _FOLDS)
    return Claim(
        "Upper and lower branch meet in a fold, where the orbit ends.",
        f"closed form: σ = {places}; the simulated orbit is there {100 * _NEAR:g} % before the fold and gone as much "
        "beyond it", HOLDS if kept == [[True, False]] * len(_FOLDS) else FAILS,
        f"the orbit exists {100 * _NEAR:g} % before and does not {100 * _NEAR:g} % beyond")


def _lower() -> Claim:
    least = math.inf
    for omega, turns in (orbit for orbit in _ORBITS if orbit[0] != 2 * orbit[1]):
        oscillator = Oscillator(omega, 0.0, 0.8)
        fold = oscillator.fold(turns)
        for sigma in np.linspace(math.copysign(oscillator.reach, fold), fold, 22)[1:-1]:
            at_sigma = replace(oscillator, sigma=float(sigma))
            least = min(least, float(np.max(np.abs(at_sigma.multipliers(turns, at_sigma.speeds(turns)[1])))))
    return Claim("The lower branch is unstable.", f"its largest multiplier is at least {least:.3f} in 80 orbits",
                 HOLDS if least > 1.0 else FAILS, "every orbit has a multiplier beyond 1")


def _doublings() -> Claim:
    places, agreed = [], True
    for omega, turns in _DOUBLINGS:
        oscillator = Oscillator(omega, 0.0, 0.8)
        sigma = doubling(oscillator, turns, -0.5 * oscillator.reach, 0.5 * oscillator.reach)
        stable = sigma - 0.1 * oscillator.reach
        motion_before, motion_beyond = (followed(replace(oscillator, sigma=sigma + step * oscillator.reach), stable)
                          for step in (-_BESIDE, _BESIDE))
        places.append(f"{sigma:.5f} for ω = {omega:g}: ({motion_before.impacts}, {motion_before.turns}) before, "
                      f"({motion_beyond.impacts}, {motion_beyond.turns}) beyond")
        agreed &= (motion_before.impacts, motion_before.turns, motion_beyond.impacts, motion_beyond.turns) == (
            1, turns, 2, 2 * turns)
    return Claim(
        "The upper branch can lose its stability in a supercritical period doubling to a (2, 2n) orbit.",
        f"a multiplier is −1 at σ = {'; '.join(places)}", HOLDS if agreed else FAILS,
        f"the stop moved slowly: (1, n) at {_BESIDE:g}/abs(1 − ω²) before the place, (2, 2n) as far beyond")


def _attraction(starts: int) -> Claim:
    draw = np.random.default_rng(1)
    oscillators = [Oscillator(2.0 * turns, 0.0, 0.8) for turns in (1, 2, 3)]
    jobs = [(oscillator, float(spin)) for oscillator in oscillators for spin in draw.uniform(0.3, 1.7, starts)]
    motions = computed(_from_spin, jobs, "impact_oscillator: starts")
    attracted = sum((motion.impacts, motion.turns) == (1, round(oscillator.omega / 2.0))
                for (oscillator, _), motion in zip(jobs, motions, strict=True))
    low = binomtest(attracted, len(jobs)).proportion_ci().low
    return Claim("Near ω = 2n and for small σ a (1, n) orbit attracts globally.",
                 f"{attracted} of {len(jobs)} drawn starts settle on it at ω = 2, 4, 6 and σ = 0 (95 % interval from "
                 f"{100.0 * low:.1f} %)", HOLDS if attracted == len(jobs) else FAILS, "every drawn start settles on it")


def _from_spin(job: tuple[Oscillator, float]) -> ImpactMotion:
    oscillator, spin = job
    return settled(started(oscillator, spin), oscillator)


def _figure(rows: Sequence[Compared]) -> Figure:
    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    axes = figure.subplots()
    for color, (omega, turns) in zip(("tab:blue", "tab:green", "tab:red"), _ORBITS, strict=False):
        oscillator = Oscillator(omega, 0.0, _RESTITUTIONS[0])
        places = np.linspace(-2.0, 2.0, 1601)
        for branch, style in ((0, "-"), (1, ":")):
            speeds = [replace(oscillator, sigma=float(place)).speeds(turns)[branch] for place in places]
            axes.plot(places, speeds, style, color=color, lw=1.0)
        seen = [row for row in rows if (row.oscillator.omega, row.oscillator.restitution) == (omega, _RESTITUTIONS[0])]
        axes.plot([row.oscillator.sigma for row in seen], [row.motion.speeds[0] for row in seen], "o", ms=4,
                  color=color, label=f"ω = {omega:g}")
    axes.set(xlim=(-0.8, 0.8), xlabel="place of the stop σ", ylabel="speed of impact V", ylim=(0.0, None))
    axes.set_title("(1, 1) orbits, r = 0.8: closed form (dotted: lower branch) and settled motions", fontsize=9)
    axes.legend()
    return figure


_SOURCES = (
    "F. Dux, [summary of the theory](https://github.com/FelixDux/imposcg) with the author's program (read in full)",
    "C. Budd, F. Dux, *Chattering and related behaviour in impact oscillators*, Phil. Trans. R. Soc. A 347 "
    "(1994) 365–389, [10.1098/rsta.1994.0049](https://doi.org/10.1098/rsta.1994.0049); C. Budd, F. Dux, A. Cliffe, "
    "*The effect of frequency and clearance variations on single-degree-of-freedom impact oscillators*, J. Sound Vib. "
    "184 (1995) 475–502; C. Budd, F. Dux, *Intermittency in impact oscillators close to resonance*, Nonlinearity 7 "
    "(1994) 1191–1224 (all three by that summary)")
_CONTAINED = (
    "Contained exactly: x'' + x = cos ωt for x < σ, and x' becomes −r x' at σ. It is one mass on its guide with a "
    "rigid plate, without damper and reaction. Between impacts x − cos ωt/(1 − ω²) is a free oscillation; that it "
    "repeats after n turns, T = 2π n/ω, gives a = (1 + r)/(2 tan(T/2)) and b = (1 − r)/(2ω) of the ellipse. Answer A13 "
    "of [known_answers.md](known_answers.md) is one of its points.")
_MAPPING = (
    Mapped("x, σ", "position, stop", "(`upper_position` − `crank.upper_rod`)/`crank.radius`, "
           "`upper.gap`/`crank.radius`"),
    Mapped("t, ω", "time, frequency", "in units of √(m/k): `mass.upper`, `upper.spring.stiffness`, `motor.speed`"),
    Mapped("r", "restitution", "`upper.plate.restitution`"),
    Mapped("V", "speed of impact", "speed of the event `upper_contact`, over `crank.radius` √(k/m)"),
    Mapped("(m, n)", "orbit of m impacts in n turns", "counted among the events of 60 turns after 1500"))
_MISSING = (
    "the bodies of the three papers; the summary gives no numbers besides ω = 2n, so the numbers compared are those of "
    "the closed forms, derived in `impact_oscillator.Oscillator`. Chatter, domains of attraction and the intermittency "
    "next to grazing are not compared.")
