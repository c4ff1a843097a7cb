"""Vibrational transport by two phases: a block that is shaken along the ground and pressed on it, both harmonically.

The mean speed has a closed form when friction changes the speed little within a turn; this model contains it, and its
own layout, two guides at 90° on one crank, is the best phase that there is.
"""

import cmath
import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from research.literature.guard import Guard
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator

_BODY, _INCLINED, _GRAVITY, _ROD, _SPEED, _STROKE = 1.0, 0.1, 9.81, 100.0, 100.0, 5e-3
#: Friction's change of speed a radian over the amplitude of the speed, μ g/(v ω): the closed form is its limit 0.
WEAKNESS = 1e-3
#: The upper mass follows its slider: its frequency over the motor's, with a damping ratio of 0.3.
STIFF = 10.0
# Times that the approach to the mean speed takes, v/(μ g); turns over which it is then measured; half of the stretch
# of motor speeds about the switch, in parts of it.
_APPROACHES, _TURNS, _REACH = 12.0, 100, 0.1
# Weakness of the scene that scipy integrates, which need not be small.
_CHECKED = 0.02
# A press that takes the block beyond half of the amplitude.
_HALF_SPEED_PRESS = 0.99


@dataclass(frozen=True)
class Shaking:
    """How the body is shaken.

    Attributes
    ----------
    press : float
        Amplitude of the normal force over the weight, dimensionless.
    lead : float
        Phase [rad] by which the normal force leads the speed along the ground.
    speed : float
        Amplitude [m/s] of the speed along the ground.
    """

    press: float
    lead: float
    speed: float


def closed_form(press_in_phase: float) -> float:
    """Mean speed over the amplitude of the speed: sin β, β = -p cos β, p the part of N in phase with the speed.

    The force -μ N sign(V + v cos τ) with N = M g (1 + p cos τ + r sin τ) has the mean -μ M g (2/π) (β + p cos β) for
    V = v sin β, whatever r is; a steady mean speed is where that vanishes. For p = 0 the same formula is dry friction's
    (2/π) arcsin(V/v) under vibration.
    """
    return math.sin(brentq(lambda angle: angle + press_in_phase * math.cos(angle), -math.pi / 2.0, math.pi / 2.0))


def block_scene(press: float, tuning: float = STIFF, damping: float = 0.3, weakness: float = WEAKNESS) -> Scene:
    """A block shaken by the inclined mass along x and pressed by the upper one.

    Parameters
    ----------
    press : float
        Amplitude of the normal force over the weight, dimensionless.
    tuning, damping : float
        Frequency of the upper mass on its spring over the motor's, and its damping ratio; dimensionless.
    weakness : float
        Friction's change of speed a radian over the amplitude of the speed, dimensionless.
    """
    own = tuning * _SPEED
    reach = abs(_response(own, damping, _SPEED))
    upper = press * (_BODY + _INCLINED) * _GRAVITY / (reach * _STROKE * _SPEED**2 - press * _GRAVITY)
    total = _BODY + upper + _INCLINED
    stiffness = _INCLINED * (10.0 * _SPEED) ** 2
    swing = _INCLINED / total * _STROKE * _SPEED
    return Scene("two_phase", {
        "mass.body": _BODY, "mass.upper": upper, "mass.inclined": _INCLINED, "guide.angle": math.pi / 2.0,
        "crank.radius": _STROKE, "crank.upper_rod": _ROD, "crank.inclined_rod": _ROD,
        "upper.spring.stiffness": upper * own**2, "upper.spring.damping": 2.0 * damping * upper * own,
        "inclined.spring.stiffness": stiffness, "inclined.spring.damping": 0.6 * math.sqrt(stiffness * _INCLINED),
        "ground.friction": weakness * swing * _SPEED / _GRAVITY, "gravity": _GRAVITY, "motor.speed": _SPEED,
        "effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.normal_force": "unilateral"})


def _response(own: float, damping: float, motor: float) -> complex:
    """Amplitude of a mass over the slider's: own frequency [rad/s] and damping ratio, base excitation."""
    lag = 2j * damping * own * motor
    return (own**2 + lag) / (own**2 - motor**2 + lag)


def _responses(scene: Scene) -> tuple[complex, complex]:
    """Amplitudes of the upper and the inclined mass over the sliders'."""
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
    """Mean speed, over the amplitude of the speed, after the approach to it."""
    device, motion = Simulator(scene), shaking(scene)
    turn = 2.0 * math.pi / scene["motor.speed"]
    wait = _APPROACHES * motion.speed / (scene["ground.friction"] * scene["gravity"])
    device.advance_to(math.ceil(wait / turn) * turn)
    begin, place = device.time, device.state.body_position
    device.advance_to(begin + _TURNS * turn)
    return (device.state.body_position - place) / (_TURNS * turn) / motion.speed


def difference(press: float) -> float:
    """Difference of `speed_share` from scipy's for a block on a plate that shakes in two directions."""
    scene = block_scene(press, weakness=_CHECKED)
    motion = shaking(scene)
    grip = scene["ground.friction"] * scene["gravity"] / (motion.speed * scene["motor.speed"])
    return abs(_on_plate(motion, grip, math.ceil(_APPROACHES / grip / (2.0 * math.pi)), 10) - speed_share(scene))


def _on_plate(motion: Shaking, grip: float, turns: int, counted: int) -> float:
    """Mean speed over the amplitude of a block on a shaken plate, over the last `counted` of `turns` turns."""
    state, time, end = np.zeros(2), 0.0, 2.0 * math.pi * turns
    begin = 2.0 * math.pi * (turns - counted)
    place = math.nan

    state[1], direction = 1.0, 1.0  # the plate's speed at the start
    for stop in (begin, end):
        while time < stop:
            piece = solve_ivp(lambda at, values, way=direction: [
                values[1], -math.sin(at) - way * grip * (1.0 + motion.press * math.cos(at + motion.lead))],
                (time, stop), state, method="DOP853", rtol=1e-10, atol=1e-12, max_step=0.5,
                events=Guard(_speed, -direction))
            time, state = piece.t[-1], piece.y[:, -1].copy()
            if piece.status == 1:
                state[1], direction = 0.0, -direction
        if stop == begin:
            place = state[0]
    return (state[0] - place) / (2.0 * math.pi * counted)


def _speed(_time: float, values: np.ndarray) -> float:
    return values[1]


def switch_speed(scene: Scene) -> float:
    """Motor speed [rad/s] at which the normal force is in quadrature with the body's speed, where the way turns."""
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

    Measured while the block speeds up, the share of the varying normal force being taken off.
    """
    scene = block_scene(_HALF_SPEED_PRESS)
    motion, turn = shaking(scene), 2.0 * math.pi / scene["motor.speed"]
    grip = scene["ground.friction"] * scene["gravity"]
    turns = math.ceil(3.0 * motion.speed / (grip * turn))
    speeds = Simulator(scene).sample(np.arange(turns) * turn).body_velocity / motion.speed
    drift = speeds - math.cos(cmath.phase(_responses(scene)[1]))  # without the shaking, at the turns' ends
    middle = (drift[1:] + drift[:-1]) / 2.0
    pulls = -np.diff(drift) * motion.speed / (grip * turn)
    own = pulls - 2.0 / math.pi * motion.press * math.cos(motion.lead) * np.sqrt(1.0 - middle**2)
    return float(np.interp(0.5, middle, own))


@dataclass(frozen=True)
class Share:
    """A measured mean speed over the amplitude, the shaking that causes it, and what the closed form says."""

    shaking: Shaking
    measured: float

    @property
    def expected(self) -> float:
        """The closed form's share."""
        return closed_form(self.shaking.press * math.cos(self.shaking.lead))

    @property
    def error(self) -> float:
        """How far the measured share is from the closed form's."""
        return abs(self.measured - self.expected)


def measured_share(scene: Scene) -> Share:
    """The mean speed of a scene of `block_scene`."""
    return Share(shaking(scene), speed_share(scene))
