"""Vibrational transport by two phases: a block that is shaken along the ground and pressed on it, both harmonically.

The mean speed has a closed form if friction changes the speed only little within a turn. The block is a special case of
this model, whose own layout, two guides at 90° on one crank, has the optimal phase.
"""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from research.literature.capsule_equations import TerminalEvent
from research.literature.findings import FAILS, HOLDS, OUTSIDE, Check, Claim, Finding, Mapped, Studied
from research.starts import computed
from vibro_ros import Scene, Simulator

_BODY, _INCLINED, _GRAVITY, _ROD, _SPEED, _STROKE = 1.0, 0.1, 9.81, 100.0, 100.0, 5e-3
#: Change of speed by friction per radian over the amplitude of the speed, μ g/(v ω); the closed form is the limit 0.
WEAKNESS = 1e-3
#: Natural frequency of the upper mass over the motor's, at which it follows its slider (with a damping ratio of 0.3).
STIFF = 10.0
# Time of the approach to the mean speed in units of v/(μ g); turns of the measurement; half width of the interval of
# motor speeds in which the switch is searched for, as a share.
_APPROACHES, _TURNS, _REACH = 12.0, 100, 0.1
# Weakness of the scene that scipy integrates, which need not be small.
_CHECKED = 0.02
# A press with which the block's mean speed exceeds half of the amplitude.
_HALF_SPEED_PRESS = 0.99


@dataclass(frozen=True)
class Shaking:
    """Shaking of the body."""

    press: float  # amplitude of the normal force over the weight, dimensionless
    lead: float  # phase [rad] by which the normal force leads the speed along the ground
    speed: float  # amplitude [m/s] of the speed along the ground


def closed_form(press_in_phase: float) -> float:
    """Mean speed over the amplitude of the speed: sin β, β = -p cos β, p the part of N in phase with the speed.

    The force -μ N sign(V + v cos τ) with N = M g (1 + p cos τ + r sin τ) has the mean -μ M g (2/π) (β + p cos β) for
    V = v sin β, independent of r; the mean speed is steady where it vanishes. For p = 0 the formula gives the effective
    dry friction under vibration, (2/π) arcsin(V/v).
    """
    return math.sin(brentq(lambda angle: angle + press_in_phase * math.cos(angle), -math.pi / 2.0, math.pi / 2.0))


def block_scene(press: float, tuning: float = STIFF, damping: float = 0.3, weakness: float = WEAKNESS) -> Scene:
    """Return the scene of a block that the inclined mass shakes along x and the upper mass presses.

    `press` is the amplitude of the normal force over the weight, `tuning` the frequency of the upper mass on its spring
    over the motor's, `damping` its damping ratio, and `weakness` the change of speed by friction per radian over the
    amplitude of the speed.
    """
    natural_frequency = tuning * _SPEED
    reach = abs(_response(natural_frequency, damping, _SPEED))
    upper = press * (_BODY + _INCLINED) * _GRAVITY / (reach * _STROKE * _SPEED**2 - press * _GRAVITY)
    total = _BODY + upper + _INCLINED
    stiffness = _INCLINED * (10.0 * _SPEED) ** 2
    swing = _INCLINED / total * _STROKE * _SPEED
    return Scene("two_phase", {
        "mass.body": _BODY, "mass.upper": upper, "mass.inclined": _INCLINED, "guide.angle": math.pi / 2.0,
        "crank.radius": _STROKE, "crank.upper_rod": _ROD, "crank.inclined_rod": _ROD,
        "upper.spring.stiffness": upper * natural_frequency**2,
        "upper.spring.damping": 2.0 * damping * upper * natural_frequency,
        "inclined.spring.stiffness": stiffness, "inclined.spring.damping": 0.6 * math.sqrt(stiffness * _INCLINED),
        "ground.friction": weakness * swing * _SPEED / _GRAVITY, "gravity": _GRAVITY, "motor.speed": _SPEED,
        "effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.normal_force": "unilateral"})


def _response(natural_frequency: float, damping: float, motor: float) -> complex:
    """Complex amplitude of a mass over the slider's (base excitation).

    `natural_frequency` and the speed `motor` are in [rad/s], `damping` is the damping ratio.
    """
    lag = 2j * damping * natural_frequency * motor
    return (natural_frequency**2 + lag) / (natural_frequency**2 - motor**2 + lag)


def _responses(scene: Scene) -> tuple[complex, complex]:
    """Complex amplitudes of the upper and the inclined mass over the sliders'."""
    def response(side: str) -> complex:
        stiffness, mass = scene[f"{side}.spring.stiffness"], scene[f"mass.{side}"]
        damping = scene[f"{side}.spring.damping"] / (2.0 * math.sqrt(stiffness * mass))
        return _response(math.sqrt(stiffness / mass), damping, scene["motor.speed"])
    return response("upper"), response("inclined")


def shaking(scene: Scene) -> Shaking:
    """The shaking of a scene of `block_scene`, from the responses of its two masses."""
    upper, inclined = _responses(scene)
    # u = r Re U e^(iθ), so N - M g = m2 u'' = -m2 r ω² Re U e^(iθ); w = r Re W e^(iθ - i π/2), so that
    # x' = m3/M w' = m3/M r ω Re W e^(iθ).
    stroke, motor = scene["crank.radius"], scene["motor.speed"]
    push = scene["mass.upper"] * stroke * motor**2 * -upper / (scene.total_mass * scene["gravity"])
    swing = scene["mass.inclined"] / scene.total_mass * stroke * motor * inclined
    return Shaking(abs(push), cmath.phase(push / swing), abs(swing))


def speed_share(scene: Scene) -> float:
    """Simulated mean speed over the amplitude of the speed, after the approach to it."""
    device, motion = Simulator(scene), shaking(scene)
    turn = 2.0 * math.pi / scene["motor.speed"]
    wait = _APPROACHES * motion.speed / (scene["ground.friction"] * scene["gravity"])
    device.advance_to(math.ceil(wait / turn) * turn)
    begin, place = device.time, device.state.body_position
    device.advance_to(begin + _TURNS * turn)
    return (device.state.body_position - place) / (_TURNS * turn) / motion.speed


def difference(press: float) -> float:
    """Difference between `speed_share` and scipy's mean speed of a block on a plate that shakes in two directions."""
    scene = block_scene(press, weakness=_CHECKED)
    motion = shaking(scene)
    grip = scene["ground.friction"] * scene["gravity"] / (motion.speed * scene["motor.speed"])
    return abs(_on_plate(motion, grip, math.ceil(_APPROACHES / grip / (2.0 * math.pi)), 10) - speed_share(scene))


def _on_plate(motion: Shaking, grip: float, turns: int, counted: int) -> float:
    """Mean speed, over the amplitude, of a block on a shaken plate in the last `counted` of `turns` turns, by scipy."""
    state, time, end = np.zeros(2), 0.0, 2.0 * math.pi * turns
    begin = 2.0 * math.pi * (turns - counted)
    place = math.nan

    state[1], direction = 1.0, 1.0  # the plate's speed at the start
    for stop in (begin, end):
        while time < stop:
            piece = solve_ivp(lambda at, values, way=direction: [
                values[1], -math.sin(at) - way * grip * (1.0 + motion.press * math.cos(at + motion.lead))],
                (time, stop), state, method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.5,
                events=TerminalEvent(_speed, -direction))
            time, state = piece.t[-1], piece.y[:, -1].copy()
            if piece.status == 1:
                state[1], direction = 0.0, -direction
        if stop == begin:
            place = state[0]
    return (state[0] - place) / (2.0 * math.pi * counted)


def _speed(_time: float, values: np.ndarray) -> float:
    return values[1]


def switch_speed(scene: Scene) -> float:
    """Motor speed [rad/s] at which normal force and body speed are in quadrature, so that the direction reverses."""
    def in_phase(motor: float) -> float:
        return math.cos(shaking(scene.with_parameters({"motor.speed": motor})).lead)
    return brentq(in_phase, 0.5 * _SPEED, 1.5 * _SPEED)


def measured_switch(scene: Scene) -> float:
    """Motor speed [rad/s] at which the simulated mean speed changes its sign."""
    expected = switch_speed(scene)
    return brentq(lambda motor: speed_share(scene.with_parameters({"motor.speed": motor})),
                  (1.0 - _REACH) * expected, (1.0 + _REACH) * expected, xtol=1e-3 * WEAKNESS * expected)


def friction_at_half_speed() -> float:
    """Mean friction over μ N of a block that drifts at half the amplitude of its shaking; (2/π) arcsin 1/2 = 1/3.

    Measured while the block accelerates, after subtraction of the contribution of the varying normal force.
    """
    scene = block_scene(_HALF_SPEED_PRESS)
    motion, turn = shaking(scene), 2.0 * math.pi / scene["motor.speed"]
    grip = scene["ground.friction"] * scene["gravity"]
    turns = math.ceil(3.0 * motion.speed / (grip * turn))
    speeds = Simulator(scene).sample(np.arange(turns) * turn).body_velocity / motion.speed
    drift = speeds - math.cos(cmath.phase(_responses(scene)[1]))  # speed at the ends of turns, without the shaking
    middle = (drift[1:] + drift[:-1]) / 2.0
    pulls = -np.diff(drift) * motion.speed / (grip * turn)
    friction = pulls - 2.0 / math.pi * motion.press * math.cos(motion.lead) * np.sqrt(1.0 - middle**2)
    return float(np.interp(0.5, middle, friction))


@dataclass(frozen=True)
class Share:
    """A measured mean speed over the amplitude, with the shaking that causes it, and its closed form."""

    shaking: Shaking
    measured: float

    @property
    def expected(self) -> float:
        """Mean speed over the amplitude by the closed form."""
        return closed_form(self.shaking.press * math.cos(self.shaking.lead))

    @property
    def error(self) -> float:
        """Absolute difference between measured and expected share."""
        return abs(self.measured - self.expected)


def measured_share(scene: Scene) -> Share:
    """Measure the mean speed of a scene of `block_scene`."""
    return Share(shaking(scene), speed_share(scene))


NAME = "two_phase"
_MARGIN = 3.0 * WEAKNESS  # because the error of averaging is of the order of the weakness
_PRESSES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
_BEYOND = 1.3  # a press that makes the body hop
_TUNINGS = (0.5, 0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.4, 2.0, 4.0, STIFF)
# Press, tuning and damping of the scene whose direction reverses with the motor speed; bound of the difference from
# scipy, because the rod's harmonics are l/(4 L) = 1.25e-5 of the stroke.
_SWITCHING, _BOUND = (0.5, 1.0, 0.1), 1e-4


def study(quick: bool) -> Studied:
    """Measure mean speeds over press and phase, and the motor speed at which the direction reverses."""
    presses, tunings = (_PRESSES[::5], _TUNINGS[::3]) if quick else (_PRESSES, _TUNINGS)
    scenes = [block_scene(press) for press in presses] + [block_scene(0.5, tuning) for tuning in tunings]
    shares = computed(measured_share, scenes, "two_phase: scenes")
    by_press, by_phase = shares[:len(presses)], shares[len(presses):]
    hopping = block_scene(_BEYOND).with_parameters({"effects.normal_force": "hop"})
    switch = (measured_switch(block_scene(*_SWITCHING)), switch_speed(block_scene(*_SWITCHING)))
    finding = Finding(
        NAME, "Transport by vibration in two directions", _SOURCES, _CONTAINED, _MAPPING,
        (Check("mean speed over its amplitude, exact against scipy's DOP853 for a block on a shaken plate, p = 0.5",
               difference(0.5), _BOUND),),
        _claims(by_press, by_phase, speed_share(hopping), switch), _MISSING)
    return Studied(finding, lambda: _figure(by_press, by_phase))


def _claims(by_press: Sequence[Share], by_phase: Sequence[Share], hopping: float,
            switch: tuple[float, float]) -> tuple[Claim, ...]:
    worst = max(share.error for share in (*by_press, *by_phase))
    best = max(by_phase, key=lambda share: share.measured)
    most = by_press[-1]
    third = friction_at_half_speed()
    rises = all(np.diff([share.measured for share in by_press]) > 0.0)
    in_quadrature = abs(math.cos(best.shaking.lead)) >= max(abs(math.cos(share.shaking.lead)) for share in by_phase)
    return (
        Claim("Mean speed V = v sin β, β = −p cos ε cos β, for N = M g (1 + p cos(τ + ε)) and a speed that swings by "
              "v cos τ (closed form, derived here).",
              f"{len(by_press) + len(by_phase)} scenes differ from it by at most {worst:.1g} v",
              HOLDS if worst <= _MARGIN else FAILS, f"within 3 μ g/(v ω) = {_MARGIN:g}, what averaging leaves out"),
        Claim(f"Its limit for p = 1, where N just stays positive: V/v = {closed_form(-1.0):.4f} (β = cos β = "
              f"{math.asin(closed_form(-1.0)):.4f}).",
              f"{most.measured:.4f} at p = {most.shaking.press:.2f}, where the closed form gives {most.expected:.4f}",
              HOLDS if most.error <= _MARGIN else FAILS, "as above"),
        Claim("Vibration along the ground smooths dry friction to (2/π) arcsin(V/v) μ N: 1/3 at V = v/2.",
              f"{third:.4f}, measured while the block speeds up", HOLDS if abs(third - 1.0 / 3.0) <= _MARGIN else FAILS,
              "as above"),
        Claim("There is an optimal phase difference (abstract of 2024).",
              f"of {len(by_phase)} phases the fastest, {best.measured:.3f} v, is the one nearest to N in phase with "
              f"the speed, {math.degrees(best.shaking.lead) % 360.0:.0f}°: two guides at 90° on one crank give it",
              HOLDS if in_quadrature else FAILS, "the fastest scene has the largest abs(cos ε)"),
        Claim("Without hopping the speed is highest where the normal acceleration reaches g (abstract, Lviv "
              "Polytechnic).",
              f"the speed rises with p up to {most.shaking.press:.2f}; at p = {_BEYOND:g} the body hops and moves at "
              f"{hopping:.3f} v", HOLDS if rises else FAILS, "the speed rises from each p to the next"),
        Claim("The way of motion can be switched by the frequency of the vibration (abstract of 2014).",
              f"the way turns at {switch[0]:.2f} rad/s; the closed form says {switch[1]:.2f}, where the press is in "
              "quadrature with the speed", HOLDS if abs(switch[0] / switch[1] - 1.0) <= _MARGIN else FAILS,
              f"the switch within {_MARGIN:g} of the closed form's"),
        Claim("Formulas for the speed and the switching frequency of a bristle-bot (abstract of 2014).",
              "elastic, inclined bristles push the bristle-bot along; this body is rigid and stands on its own",
              OUTSIDE, "the bristles' angle is no coordinate of this model"))


def _figure(by_press: Sequence[Share], by_phase: Sequence[Share]) -> Figure:
    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    grid = np.linspace(0.0, 1.0, 101)
    left.plot(grid, [closed_form(-press) for press in grid], color="0.6", label="closed form")
    left.plot([share.shaking.press for share in by_press], [share.measured for share in by_press], "o", ms=4,
              label="this model")
    left.set(xlabel="press p, N in phase against the speed", ylabel="mean speed V/v")
    angles = np.linspace(0.0, math.pi, 181)
    right.plot(np.degrees(angles), [closed_form(0.5 * math.cos(angle)) for angle in angles], color="0.6")
    right.plot([math.degrees(abs(share.shaking.lead)) for share in by_phase], [share.measured for share in by_phase],
               "o", ms=4)
    right.set(xlabel="lead of N over the speed in degrees, p = 0.5")
    left.legend()
    return figure


_SOURCES = (
    "I. Vrublevskyi, *Vibratory conveying by normal oscillations with piecewise constant acceleration and longitudinal "
    "harmonic oscillations*, 2024, [10.31534/engmod.2024.1.ri.05v](https://doi.org/10.31534/engmod.2024.1.ri.05v) "
    "(abstract read)",
    "*Optimization of vibratory conveying upward by inclined track with polyharmonic normal vibration*, Lviv "
    "Polytechnic National University (abstract read)",
    "G. Cicconofri, A. DeSimone, *Motility of a model bristle-bot: a theoretical analysis*, 2014, "
    "[arXiv:1410.8153](https://arxiv.org/abs/1410.8153) (abstract read); G. Cicconofri, F. Becker, G. Noselli, "
    "A. DeSimone, K. Zimmermann, *The inversion of motion of bristle bots*, 2017, "
    "[arXiv:1702.00343](https://arxiv.org/abs/1702.00343) (abstract read)")
_CONTAINED = (
    "Contained exactly: a body with Coulomb friction that the inclined mass shakes along the ground (φ = 90°, no "
    "plates, no reaction) and the upper mass presses on it is a block on a plate that shakes in two directions. "
    "Averaged over a turn, −μ N sign(V + v cos τ) with N = M g (1 + p cos(τ + ε)) is −μ M g (2/π) (β + p cos ε cos β), "
    "V = v sin β: the part of N in quadrature with the speed drops out. The mean speed is where that vanishes; its "
    "first term alone is the classical (2/π) arcsin(V/v). These formulas are derived in "
    "`two_phase.closed_form`, not quoted.")
_MAPPING = (
    Mapped("v", "amplitude of the block's speed along the plate",
           "m3/M r ω abs(W), W = (Ω² + 2iζΩω)/(Ω² − ω² + 2iζΩω) of the inclined guide's drive"),
    Mapped("p, ε", "amplitude of N over the weight, its lead over the speed",
           "m2 r ω² abs(U)/(M g) and arg(−U/W), U as W, of the upper guide's drive"),
    Mapped("μ g", "friction", "`ground.friction` × `gravity`; N is `unilateral`"),
    Mapped("optimal phase", "plate's two motions", "`guide.angle` = 90°, drives that follow their sliders: ε = 180°"),
    Mapped("frequency", "of both motions", "`motor.speed`"))
_MISSING = (
    "numbers of the papers, whose bodies could not be read here: dimensionless speeds over several harmonics and track "
    "angles, and the bristle-bot's friction law and formulas. A track that slopes and a normal vibration of several "
    "harmonics are not contained.")
