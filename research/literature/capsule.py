"""The vibro-impact capsule of Liu, Pavlovskaia, Wiercigroch and others, which this model contains.

The guide lies along x (φ = 90°), there is no upper mass, the masses feel the body, N is the weight. The crank is a
millionth of its rod, so that the slider moves harmonically and the drive spring's slider end is the published force.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from research.literature.capsule_equations import Capsule, harmonic, integrate
from vibro_ros.accuracy.starts import STARTING, started
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator

# One machine of the many that have the same numbers without units: internal mass [kg], its spring [N/m], the unit of
# length P_f / k1 [m], rod [m], gravity [m/s²]. A shorter unit of length would lose digits, a longer one the harmonic.
_MASS, _STIFFNESS, _LENGTH, _ROD, _GRAVITY = 0.1, 1e3, 1e-6, 10.0, 9.81
_RATE = math.sqrt(_STIFFNESS / _MASS)
#: Ranges from which machines are drawn.
BOX = {"alpha": (0.5, 4.0), "omega": (0.5, 2.0), "beta": (2.0, 50.0), "delta": (0.0, 1.0), "xi": (0.01, 0.1)}
#: Mass ratios that each machine is given.
RATIOS = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0)
#: The machine whose trajectories are compared with scipy's, over so many periods.
REFERENCE, PERIODS = Capsule(alpha=1.6, omega=0.95, beta=15.0, gamma=5.0, delta=0.02, xi=0.05), 10
#: Periods before a progression counts; periods of each of the two halves over which it counts; progression a period
#: [P_f / k1] that counts as one, and part of it by which the halves of a settled motion may differ.
SETTLING, HALF, LEAST, SETTLED = 400, 100, 0.01, 0.05
_SAMPLES = 200


def capsule_scene(capsule: Capsule, rod: float = _ROD) -> Scene:
    """The scene that is the published machine, with a `rod` [m]; it moves to -x where that one moves forwards."""
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
    """Phase [rad] of the published force in the scene: the crank starts across the guide, and the damper leads."""
    return math.atan(2.0 * capsule.xi * capsule.omega) - math.pi / 2.0


def rod_harmonics(capsule: Capsule) -> float:
    """Size r²/(4 L) of what the rod adds to the slider's harmonic motion, in P_f / k1."""
    return capsule_scene(capsule)["crank.radius"] ** 2 / (4.0 * _ROD) / _LENGTH


def difference(capsule: Capsule, periods: int, rod: float = _ROD) -> float:
    """Largest difference of the capsule's position, in P_f / k1, from scipy's within so many periods from rest.

    It falls in proportion to 1/`rod`, as the rod's harmonics r²/(4 L) do: nothing else differs.
    """
    times = np.linspace(0.0, periods * capsule.period, _SAMPLES + 1)
    own = -Simulator(capsule_scene(capsule, rod)).sample(times / _RATE).body_position / _LENGTH
    other = integrate(capsule, times, harmonic(capsule, drive_phase(capsule)))[:, 2]
    return float(np.max(np.abs(own - other)))


def outside_difference(capsule: Capsule, periods: int) -> float:
    """The same without the second spring, scipy's capsule being driven from outside by m1 r Ω²."""
    scene = capsule_scene(capsule).with_parameters({"effects.inclined_contact": "none"})
    times = np.linspace(0.0, periods * capsule.period, _SAMPLES + 1)
    own = Simulator(scene).sample(times / _RATE)
    reach = scene["crank.radius"] / _LENGTH
    free = Capsule(reach * capsule.omega**2, capsule.omega, 0.0, capsule.gamma, 0.0, capsule.xi)
    # Its internal mass is ours less the slider's stroke, which is r sin τ: at t = 0 it moves at -r ω.
    other = integrate(free, times, harmonic(free, -math.pi / 2.0, reaction=0.0), speed=-reach * capsule.omega)[:, 2]
    return float(np.max(np.abs(-own.body_position / _LENGTH - other)))


@dataclass(frozen=True)
class Progression:
    """Progression a period, in P_f / k1, over two halves of a long run."""

    first: float
    second: float

    @property
    def mean(self) -> float:
        """Mean of both halves."""
        return (self.first + self.second) / 2.0

    @property
    def settled(self) -> bool:
        """Whether it is one that counts, and the same in both halves."""
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
    """What becomes of one drawn machine with every mass ratio, each from several starts.

    Attributes
    ----------
    machine : Capsule
        The machine, with the first of the mass ratios.
    found : dict
        Mass ratio to the progressions from rest and from each drawn start.
    """

    machine: Capsule
    found: dict[float, tuple[Progression, ...]]

    def signs_from_rest(self) -> set[float]:
        """Directions, 1 and -1, in which it settles from rest with one mass ratio or another."""
        return {math.copysign(1.0, runs[0].mean) for runs in self.found.values() if runs[0].settled}

    def opposed_ratios(self) -> list[float]:
        """Mass ratios with which it settles in both directions, from different starts."""
        directions = {ratio: {math.copysign(1.0, run.mean) for run in runs if run.settled}
                      for ratio, runs in self.found.items()}
        return [ratio for ratio, both in directions.items() if len(both) == 2]


def surveyed(job: tuple[Capsule, int]) -> Survey:
    """Survey of a machine from rest and from so many drawn starts."""
    machine, starts = job
    found = {}
    for ratio in RATIOS:
        scene = capsule_scene(Capsule(**{**vars(machine), "gamma": ratio}))
        period = 2.0 * math.pi / scene["motor.speed"]
        runs = [progression(Simulator(scene), period)]
        for number in range(starts):
            device = started(scene, np.random.default_rng(number))
            device.advance_to(STARTING)
            runs.append(progression(device, period))
        found[ratio] = tuple(runs)
    return Survey(machine, found)


def machines(count: int) -> list[Capsule]:
    """Machines drawn from `BOX`, a power of two of them, by a scrambled Sobol sequence; the same every time."""
    draws = qmc.Sobol(len(BOX), seed=1).random_base2(round(math.log2(count)))
    low, high = zip(*BOX.values(), strict=True)
    return [Capsule(gamma=RATIOS[0], **dict(zip(BOX, map(float, row), strict=True)))
            for row in qmc.scale(draws, low, high)]
