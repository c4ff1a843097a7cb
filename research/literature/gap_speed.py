"""Impact gap and mean speed of the crank-driven robots of Korendiy and others, 2022, on a horizontal guide.

They tune the gap so that the internal body hits its plate as fast as possible. This study measures whether the robot is
fastest then.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from research.literature.capsule_equations import Capsule, Drive, integrate
from research.literature.findings import FAILS, HOLDS, NOISE, OUTSIDE, Check, Claim, Finding, Mapped, Studied
from research.starts import computed, started
from vibro_ros import Scene, Simulator, attractors

#: Gaps [m] and motor speeds [rad/s] of the study.
GAPS = tuple(round(float(gap), 4) for gap in np.arange(-0.016, 0.0581, 0.002))
MOTORS = (60.0, 80.0, 100.0, 120.0)
#: Damping of the drive [N·s/m], so that the effect of the start decays.
DAMPING = 2.0
#: Friction coefficients of rolling wheels, and of locked wheels, which no force of the robot can move.
FRICTION, LOCKED = 0.2, 1e3
#: Number of turns of the comparison with scipy.
CHECKED_TURNS = 3
_SETTLED, _DURATION, _SAMPLES = 4.0, 10.0, 200


def robot_scene(gap: float, motor: float) -> Scene:
    """Return the seed paper's robot on one-way wheels, without its upper mass, its guide along x.

    It moves towards -x, where its plate is.
    """
    return Scene("gap", {"guide.angle": math.pi / 2.0, "inclined.gap": gap, "motor.speed": motor,
                         "inclined.spring.damping": DAMPING, "effects.upper_mass": False,
                         "ground.friction": LOCKED, "ground.friction_backward": FRICTION,
                         "effects.normal_force": "weight", "effects.reaction": True})


@dataclass(frozen=True)
class Tried:
    """Results for a gap and a motor speed, of the motion that most starts lead to.

    Attributes
    ----------
    gap, motor : float
        Gap [m] and motor speed [rad/s].
    speed, spread : float
        Mean speed towards the plate [m/s], and half its 95 % interval, 0 for a periodic motion.
    share : float
        Share of the starts that lead to this motion, dimensionless.
    approach : float
        Mean impact speed of the mass on the plate [m/s]; 0 without an impact.
    """

    gap: float
    motor: float
    speed: float
    spread: float
    share: float
    approach: float


def tried(job: tuple[float, float, int]) -> Tried:
    """Find the motion that most starts lead to; `job` is gap [m], motor speed [rad/s] and number of starts.

    Its impact speeds are those of the start whose mean speed is nearest to the motion's.
    """
    gap, motor, starts = job
    most, runs = attractors(robot_scene(gap, motor), starts=starts)[0], []
    for number in range(starts):
        device = started(robot_scene(gap, motor), np.random.default_rng(number))
        device.advance_to(_SETTLED)
        device.take_events()
        begin = device.state.body_position
        device.advance_to(_SETTLED + _DURATION)
        events = device.take_events()
        blows = events["speed"][events["kind"] == "inclined_contact"]
        runs.append(((device.state.body_position - begin) / _DURATION, float(np.mean(blows)) if len(blows) else 0.0))
    _, approach = min(runs, key=lambda run: abs(run[0] - most.mean_speed))
    spread = 0.0 if math.isnan(most.spread) else most.spread
    return Tried(gap, motor, -most.mean_speed, spread, most.share, approach)


@dataclass(frozen=True)
class InUnits:
    """The robot in dimensionless variables of the capsule's literature, and the units of length [m] and time [s]."""

    capsule: Capsule
    drive: Drive
    length: float
    time: float


def in_units(gap: float, motor: float) -> InUnits:
    """Return the robot in these units, at rest with its mass at its slider; the gap must allow this position."""
    scene = robot_scene(gap, motor)
    mass, stiffness, damping = (scene[name] for name in ("mass.inclined", "inclined.spring.stiffness",
                                                         "inclined.spring.damping"))
    friction, rate = FRICTION * scene.total_mass * scene["gravity"], math.sqrt(stiffness / mass)
    radius, rod, length = scene["crank.radius"], scene["crank.inclined_rod"], friction / stiffness
    start = math.sqrt(rod**2 - radius**2)  # initial position of slider and mass

    def push(time: float) -> float:
        sine, cosine = math.sin(motor * time / rate), math.cos(motor * time / rate)
        root = math.sqrt(rod**2 - (radius * cosine) ** 2)
        place, speed = radius * sine + root, motor * radius * cosine * (1.0 + radius * sine / root)
        return (stiffness * (place - start) + damping * speed) / friction

    capsule = Capsule(math.nan, motor / rate, scene["inclined.plate.stiffness"] / stiffness, scene["mass.body"] / mass,
                      (rod + gap - start) / length, damping / (2.0 * mass * rate), math.inf)
    return InUnits(capsule, Drive(push), length, 1.0 / rate)


def difference(gap: float, motor: float) -> float:
    """Largest difference [m] of the body's position from scipy's within `CHECKED_TURNS`, from rest at the slider."""
    robot = in_units(gap, motor)
    times = np.linspace(0.0, CHECKED_TURNS * robot.capsule.period, _SAMPLES + 1)
    own = -Simulator(robot_scene(gap, motor)).sample(times * robot.time).body_position
    return float(np.max(np.abs(own - robot.length * integrate(robot.capsule, times, robot.drive)[:, 2])))


NAME = "gap"
_BOUND = 1e-8  # m


def study(quick: bool) -> Studied:
    """Measure all gaps at every motor speed from 16 starts; with `quick` every fourth gap from 2 starts."""
    starts = 2 if quick else 16
    gaps = GAPS[::4] if quick else GAPS
    rows = computed(tried, [(gap, motor, starts) for motor in MOTORS for gap in gaps], "gap: gaps")
    curves = {motor: [row for row in rows if row.motor == motor] for motor in MOTORS}
    finding = Finding(
        NAME, "Impact gap and speed", _SOURCES, _CONTAINED, _MAPPING,
        (Check(f"body's position over {CHECKED_TURNS} turns, exact against scipy's DOP853, in m; gap 10 mm, 100 rad/s",
               difference(0.010, 100.0), _BOUND),),
        (*(claim(curve) for curve in curves.values()), _UNREAD), _MISSING)
    return Studied(finding, lambda: _figure(curves))


def claim(curve: Sequence[Tried]) -> Claim:
    """Judge the rule that the fastest impacts make the robot fastest, at one motor speed; `curve` is ordered by gap."""
    fastest = max(curve, key=lambda row: row.speed)
    hardest = max(curve, key=lambda row: row.approach)
    same = abs(fastest.gap - hardest.gap) <= curve[1].gap - curve[0].gap + 1e-9
    equal = fastest.speed - hardest.speed <= math.hypot(fastest.spread, hardest.spread)
    blows = "" if fastest.approach else ", without a blow"
    end = ", an end of the scan, so that no best gap is known" if fastest in (curve[0], curve[-1]) else ""
    return Claim(
        "The robot is fastest with the gap at which the internal body hits its plate fastest (abstract, April 2022); "
        f"here with the seed paper's parameters, at {fastest.motor:g} rad/s.",
        f"hardest blows, {hardest.approach:.2f} m/s, at {1e3 * hardest.gap:g} mm, where it moves at "
        f"{_mm(hardest)}; fastest at {1e3 * fastest.gap:g} mm, {_mm(fastest)}{blows}{end}",
        HOLDS if same else NOISE if equal else FAILS, _RULE)


def _mm(row: Tried) -> str:
    """Text of the speed of the most frequent motion, and its share of the starts if it is not the only one."""
    interval = f" ± {1e3 * row.spread:.1f}" if row.spread else ""
    share = f" in {100.0 * row.share:.0f} % of the starts" if row.share < 1.0 else ""
    return f"{1e3 * row.speed:.1f}{interval} mm/s{share}"


def _figure(curves: Mapping[float, Sequence[Tried]]) -> Figure:
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for motor, curve in curves.items():
        gaps = [1e3 * row.gap for row in curve]
        upper.errorbar(gaps, [row.speed for row in curve], [row.spread for row in curve], marker=".", lw=1.0,
                       capsize=2, label=f"{motor:g} rad/s")
        lower.plot(gaps, [row.approach for row in curve], marker=".", lw=1.0)
    upper.set_ylabel("speed towards the\nplate in m/s")
    lower.set(xlabel="impact gap in mm", ylabel="speed at which the\nplate is hit in m/s")
    upper.legend(fontsize=8)
    return figure


_RULE = ("holds if both gaps are the same or neighbours; else within noise if the 95 % intervals of both speeds allow "
         "that they are equal, and does not hold if not; every speed is that of the motion of most starts")
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
    "capsule above with the crank's own motion in place of a harmonic force, on wheels that turn one way only: their "
    "friction is that of a locked wheel one way and small the other way.")
_MAPPING = (
    Mapped("platform and internal body", "the two masses", "`mass.body`, `mass.inclined`, `guide.angle` = 90°"),
    Mapped("crank-slider exciter", "drive",
           "`crank.radius`, `crank.inclined_rod`, `inclined.spring.stiffness`, `motor.speed`"),
    Mapped("impact plate", "second spring", "`inclined.plate.stiffness`"),
    Mapped("impact gap", "clearance at mid-stroke", "`inclined.gap`"),
    Mapped("wheels with overrunning clutches", "friction that differs with direction",
           "`ground.friction`, `ground.friction_backward`, N by `weight`"),
    Mapped("average translational velocity", "over 10 s, after 4 s", "−`body_position` / time"))
_MISSING = (
    "the body of both papers, and with it every parameter: the robot here has those of the seed paper of 2021, a drive "
    f"damper of {DAMPING:g} N·s/m and reaction on. What is tested is the rule by which the gap is chosen.")
