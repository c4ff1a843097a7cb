"""Impact gap and mean speed of the crank-driven robots of Korendiy and others, 2022, on a horizontal guide.

They tune the gap so that the internal body hits its plate as fast as possible. This study measures whether the robot is
fastest then. A gap may have several motions; each has its own speed and impacts, and the share of the starts that lead
to it.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from research.literature.capsule_equations import Capsule, Drive, integrate
from research.literature.findings import FAILS, HOLDS, NOISE, OUTSIDE, Check, Claim, Finding, Mapped, Studied
from research.starts import started
from vibro_lab import attractors
from vibro_ros import Scene, Simulator

#: Gaps [m] up to their limit, the rod's length, and infinity for a robot without the plate; motor speeds [rad/s].
GAPS = (*(round(float(gap), 4) for gap in np.arange(-0.016, 0.0601, 0.002)), math.inf)
MOTORS = (60.0, 80.0, 100.0, 120.0)
#: Number of starts of each gap.
STARTS = 16
#: Damping of the drive [N·s/m], so that the effect of the start decays.
DAMPING = 2.0
#: Friction coefficients of rolling wheels, and of locked wheels, which no force of the robot can move.
FRICTION, LOCKED = 0.2, 1e3
#: Number of turns of the comparison with scipy.
CHECKED_TURNS = 3
_SAMPLES = 200
#: Time before impact speeds are measured [s], and turns over which: whole periods of up to 6 turns, of 8, 10 and 12.
_SETTLED, _TURNS = 8.0, 120


def robot_scene(gap: float, motor: float) -> Scene:
    """Return the seed paper's robot on one-way wheels, without its upper mass, its guide along x.

    It moves towards -x, where its plate is. With an infinite `gap` it has no plate.
    """
    plate = {"inclined.gap": gap} if math.isfinite(gap) else {"effects.inclined_contact": "none"}
    return Scene("gap", {"guide.angle": math.pi / 2.0, "motor.speed": motor, **plate,
                         "inclined.spring.damping": DAMPING, "effects.upper_mass": False,
                         "ground.friction": LOCKED, "ground.friction_backward": FRICTION,
                         "effects.normal_force": "weight", "effects.reaction": True})


@dataclass(frozen=True)
class Moved:
    """A motion at a gap and a motor speed."""

    gap: float  # [m], infinite without a plate
    motor: float  # motor speed [rad/s]
    speed: float  # mean speed towards the plate [m/s]
    spread: float  # half its 95 % interval: 0 for a periodic motion, NaN for a single start
    share: float  # share of the starts that lead to this motion, dimensionless
    words: str  # for the reader: speed, period, and number of starts with the 95 % interval of their share
    approach: float  # mean impact speed of the mass on the plate [m/s]; 0 without an impact


def motions(gap: float, motor: float, starts: int) -> list[Moved]:
    """Return the motions that starts lead to at a gap [m] and motor speed [rad/s], that of most starts first.

    The impact speeds of a motion are those of the start whose mean speed is nearest to the motion's.
    """
    scene = robot_scene(gap, motor)
    drawn = attractors(scene, starts).drawn
    runs = [run(scene, number) for number in range(1 if drawn.single else starts)]
    moved = []
    for attractor in drawn:
        _, approach = min(runs, key=lambda run: abs(run[0] - attractor.mean_speed))
        words = (f"{attractor.in_words().removeprefix('-')} ({attractor.starts} of {starts} starts, "
                 f"{100.0 * attractor.low:.0f} to {100.0 * attractor.high:.0f} %)")
        moved.append(Moved(gap, motor, -attractor.mean_speed, attractor.spread, attractor.share, words, approach))
    return moved


def run(scene: Scene, number: int) -> tuple[float, float]:
    """Return the mean speed of the body [m/s] and the mean impact speed on its plate [m/s] from start `number`."""
    device = started(scene, np.random.default_rng((0, number)))  # the starts of `attractors`
    device.advance_to(_SETTLED)
    device.take_events()
    begin, duration = device.state.body_position, _TURNS * math.tau / scene["motor.speed"]
    device.advance_to(_SETTLED + duration)
    events = device.take_events()
    blows = events["speed"][events["kind"] == "inclined_contact"]
    return (device.state.body_position - begin) / duration, float(np.mean(blows)) if len(blows) else 0.0


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
    simulated = -Simulator(robot_scene(gap, motor)).sample(times * robot.time).body_position
    return float(np.max(np.abs(simulated - robot.length * integrate(robot.capsule, times, robot.drive)[:, 2])))


NAME = "gap"
_BOUND = 1e-8  # m


def study(quick: bool) -> Studied:
    """Find the motions of all gaps at every motor speed; with `quick` of every fourth gap, from 2 starts."""
    starts = 2 if quick else STARTS
    gaps = (*GAPS[:-1:4], GAPS[-1]) if quick else GAPS
    scenes = [(gap, motor) for motor in MOTORS for gap in gaps]
    all_motions = [motion for gap, motor in tqdm(scenes, "gap: gaps", disable=None)
                   for motion in motions(gap, motor, starts)]
    curves = {motor: [motion for motion in all_motions if motion.motor == motor] for motor in MOTORS}
    finding = Finding(
        NAME, "Impact gap and speed", _SOURCES, _CONTAINED, _MAPPING,
        (Check(f"body's position over {CHECKED_TURNS} turns, exact against scipy's DOP853, in m; gap 10 mm, 100 rad/s",
               difference(0.010, 100.0), _BOUND),),
        (*(claim(curve) for curve in curves.values()), _UNREAD), f"{_MISSING} {_several(all_motions, starts)}")
    return Studied(finding, lambda: _figure(curves))


def claim(curve: Sequence[Moved]) -> Claim:
    """Judge the rule that the fastest impacts make the robot fastest, at one motor speed; `curve` is ordered by gap."""
    frequent = _frequent(curve)
    with_plate = [motion for motion in frequent if math.isfinite(motion.gap)]
    fastest = max(with_plate, key=lambda motion: motion.speed)
    hardest = max(with_plate, key=lambda motion: motion.approach)
    same = abs(fastest.gap - hardest.gap) <= with_plate[1].gap - with_plate[0].gap + 1e-9
    equal = fastest.speed - hardest.speed <= math.hypot(fastest.spread, hardest.spread)
    blows = "" if fastest.approach else ", without a blow"
    without = "".join(f"; without any plate it moves at {motion.words}" for motion in frequent
                      if math.isinf(motion.gap))
    at_end = fastest in (with_plate[0], with_plate[-1])
    end = f", an end of the scan, so that no best gap is known{without}" if at_end else ""
    return Claim(
        "The robot is fastest with the gap at which the internal body hits its plate fastest (abstract, April 2022); "
        f"here with the seed paper's parameters, at {fastest.motor:g} rad/s.",
        f"hardest blows, {hardest.approach:.2f} m/s in the mean, at {1e3 * hardest.gap:g} mm, where it moves at "
        f"{hardest.words}; fastest at {1e3 * fastest.gap:g} mm, {fastest.words}{blows}{end}",
        HOLDS if same else NOISE if equal else FAILS, _RULE)


def _frequent(curve: Iterable[Moved]) -> list[Moved]:
    """The motion of most starts at each gap, in the order of the gaps."""
    most = dict[float, Moved]()
    for motion in curve:
        most.setdefault(motion.gap, motion)
    return list(most.values())


def _several(all_motions: Sequence[Moved], starts: int) -> str:
    """Sentences on the gaps that have several motions."""
    scenes = list(dict.fromkeys((motion.gap, motion.motor) for motion in all_motions))
    words_of = {scene: [motion.words for motion in all_motions if (motion.gap, motion.motor) == scene]
                for scene in scenes}
    named = [f"\n- {1e3 * gap:g} mm, {motor:g} rad/s: {'; '.join(words)}"
             for (gap, motor), words in words_of.items() if len(words) > 1]
    if not named:
        return f"All {starts} starts of each gap lead to one motion."
    return (f"Of {len(scenes)} pairs of gap and motor speed, these have several motions from {starts} starts; each of "
            f"the others has one, and more starts may find more:\n{''.join(named)}")


def _figure(curves: Mapping[float, Sequence[Moved]]) -> Figure:
    figure = Figure(figsize=(7.0, 4.8), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for motor, curve in curves.items():
        shown = [motion for motion in curve if math.isfinite(motion.gap)]
        areas = [4.0 + 30.0 * motion.share for motion in shown]
        gaps = [1e3 * motion.gap for motion in shown]
        points = upper.scatter(gaps, [motion.speed for motion in shown], areas, label=f"{motor:g} rad/s")
        lower.scatter(gaps, [motion.approach for motion in shown], areas)
        color = points.get_facecolor()[0]
        for axes, name in ((upper, "speed"), (lower, "approach")):
            axes.plot(*zip(*((1e3 * motion.gap, getattr(motion, name)) for motion in _frequent(shown)), strict=True),
                      lw=0.8, color=color)
        for motion in curve:
            if math.isinf(motion.gap):
                upper.axhline(motion.speed, lw=0.8, ls=":", color=color)
    upper.set_ylabel("speed towards the\nplate in m/s")
    lower.set(xlabel="impact gap in mm; area of a point: share of the starts; dotted: without the plate",
              ylabel="speed at which the\nplate is hit in m/s")
    upper.legend(fontsize=8)
    return figure


_RULE = ("holds if both gaps are the same or neighbours; else within noise if the 95 % intervals of both speeds allow "
         "that they are equal, and does not hold if not; a gap is judged by the motion of most of its starts, whose "
         "share is given with its 95 % interval")
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
    Mapped("average translational velocity", "of a settled motion", "−`mean_speed` of `vibro_lab.attractors`"))
_MISSING = (
    "the body of both papers, and with it every parameter: the robot here has those of the seed paper of 2021, a drive "
    f"damper of {DAMPING:g} N·s/m and reaction on. What is tested is the rule by which the gap is chosen.")
