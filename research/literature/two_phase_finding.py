"""What the study of transport by vibration in two directions finds, in words and as a picture."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from research.literature.published import FAILS, HOLDS, OUTSIDE, Check, Claim, Finding, Mapped, Studied
from research.literature.two_phase import (
    STIFF,
    WEAKNESS,
    Share,
    block_scene,
    closed_form,
    difference,
    friction_at_half_speed,
    measured_share,
    measured_switch,
    speed_share,
    switch_speed,
)
from vibro_ros.study.progress import computed

NAME = "two_phase"
_MARGIN = 3.0 * WEAKNESS  # what the averaging leaves out is of the order of the weakness
_PRESSES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
_BEYOND = 1.3  # a press that makes the body hop
_TUNINGS = (0.5, 0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.4, 2.0, 4.0, STIFF)
# Press, tuning and damping of the scene whose way a change of the motor speed turns; what may differ from scipy: the
# rod's harmonics are l/(4 L) = 1.25e-5 of the stroke.
_SWITCHING, _BOUND = (0.5, 1.0, 0.1), 1e-4


def study(quick: bool) -> Studied:
    """Measure mean speeds over press and phase, and the switch of the way by the motor's speed."""
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
