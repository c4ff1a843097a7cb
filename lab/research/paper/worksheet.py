"""The paper's equations as a worksheet integrates them: eqs. (1) to (7) as one right-hand side, without event location.

`rkfixed` is the classical Runge-Kutta method of fixed step, as in MathCad; `rkadapt` is an embedded pair of orders 5
and 4 with MathCad's default tolerance of 1e-3. Both evaluate contacts, sign(x') and the rule of the normal force at
their stages. No code is shared with the model and the event loop.
"""

import math
from typing import NamedTuple

import numba
import numpy as np
from scipy.integrate import solve_ivp

from vibro_ros import Scene

#: Angular frequency of the crank in the worksheet [rad/s], and gravity [m/s²].
SPEED, GRAVITY = 100.0, 9.81
#: Speed over which smooth friction changes instead of the jump of sign(x') [m/s].
SMOOTHING = 1e-3
#: Relative and absolute tolerance of `rkadapt`: MathCad's TOL, and the absolute one of scipy.
TOLERANCE, ABSOLUTE = 1e-3, 1e-6
_RULES = {"printed": 0, "unilateral": 1, "weight": 2}
_FRICTIONS = {"eq5": 0, "smooth": 1, "reversed": 2}


class Worksheet(NamedTuple):
    """Parameters of one worksheet, in SI units, with the paper's names.

    `sine` and `cosine` are those of the guide's angle `phi` [rad]; `misprint` is 1 if xi_2 replaces xi_3, else 0;
    `rule` and `friction` are integer codes of the reading's choices; `advance` is the crank's angle at t = 0 [rad].
    """

    m1: float
    m2: float
    m3: float
    radius: float
    rod: float
    phi: float
    sine: float
    cosine: float
    drive: float
    plate: float
    mu: float
    misprint: int
    rule: int
    friction: int
    advance: float


def worksheet(scene: Scene, friction: str, advance: float) -> Worksheet:
    """Return the worksheet of a scene of the paper, with the crank at the angle `advance` [rad] at t = 0."""
    return Worksheet(
        scene["mass.body"], scene["mass.upper"], scene["mass.inclined"], scene["crank.radius"],
        scene["crank.upper_rod"], scene["guide.angle"], math.sin(scene["guide.angle"]), math.cos(scene["guide.angle"]),
        scene["upper.spring.stiffness"],
        scene["upper.plate.stiffness"], scene["ground.friction"], int(scene["effects.misprint"]),
        _RULES[scene["effects.normal_force"]], _FRICTIONS[friction], advance)


@numba.njit(error_model="numpy")
def _slider(radius, rod, angle):
    return radius * math.cos(angle) + math.sqrt(rod**2 - (radius * math.sin(angle))**2)


@numba.njit(error_model="numpy")
def _sign(friction, speed):
    if friction == 1:
        return speed / (abs(speed) + SMOOTHING)
    return 1.0 if speed > 0.0 else -1.0 if speed < 0.0 else 0.0


@numba.njit(error_model="numpy")
def _fill_rates(time, state, sheet, derivatives):
    """Set `derivatives` to the time derivatives of u, u', w, w', x, x' at `time` [s], shape (6,)."""
    u, w, speed = state[0], state[2], state[5]
    angle = SPEED * time + sheet.advance
    force2 = sheet.drive * (u - _slider(sheet.radius, sheet.rod, angle))
    drive3 = sheet.drive * (w - _slider(sheet.radius, sheet.rod, angle - sheet.phi))
    force3 = on_body = drive3
    if u >= sheet.rod:
        force2 += sheet.plate * (u - sheet.rod)
    if w >= sheet.rod:
        force3 += sheet.plate * (w - sheet.rod)
        on_body += sheet.plate * ((u if sheet.misprint else w) - sheet.rod)
    total = sheet.m1 + sheet.m2 + sheet.m3
    normal = total * GRAVITY
    if sheet.rule != 2:
        normal -= force2 + on_body * sheet.cosine
    if sheet.rule == 1:
        normal = max(normal, 0.0)
    kinetic, inertial = sheet.mu * normal, -on_body * sheet.sine
    if sheet.friction == 2:
        kinetic = -kinetic
    if sheet.friction == 1 or speed != 0.0:
        braking = kinetic * _sign(sheet.friction, speed)
    else:
        braking = inertial if abs(inertial) <= kinetic else kinetic * _sign(0, inertial)
    derivatives[0], derivatives[2], derivatives[4] = state[1], state[3], speed
    derivatives[1], derivatives[3] = -force2 / sheet.m2, -force3 / sheet.m3
    derivatives[5] = (inertial - braking) / total


@numba.njit(error_model="numpy")
def rates(time, state, sheet):
    """Return the time derivatives of u, u', w, w', x, x' at `time` [s], shape (6,)."""
    derivatives = np.empty(6)
    _fill_rates(time, state, sheet, derivatives)
    return derivatives


@numba.njit(error_model="numpy")
def _take_step(time, state, sheet, step, rate, stage, change):
    """Take a step of the classical Runge-Kutta method in place; `rate`, `stage`, `change` are workspace, shape (6,)."""
    change[:] = 0.0
    for k in range(4):
        part = 0.0 if k == 0 else step if k == 3 else 0.5 * step
        for i in range(6):
            stage[i] = state[i] + part * rate[i] if k else state[i]
        _fill_rates(time + part, stage, sheet, rate)
        for i in range(6):
            change[i] += rate[i] if k in (0, 3) else 2.0 * rate[i]
    for i in range(6):
        state[i] += step / 6.0 * change[i]


@numba.njit(error_model="numpy")
def _rkfixed(state, sheet, step, counts):
    """Displacement x [m] after each of the numbers of steps in `counts`."""
    displacements, done = np.empty(len(counts)), 0
    rate, stage, change = np.empty(6), np.empty(6), np.empty(6)
    for k in range(len(counts)):
        while done < counts[k]:
            _take_step(done * step, state, sheet, step, rate, stage, change)
            done += 1
        displacements[k] = state[4]
    return displacements


def start_state(scene: Scene) -> np.ndarray:
    """State u, u', w, w', x, x' at t = 0, shape (6,): zeros, or each mass at rest at its slider or its plate."""
    state = np.zeros(6)
    if scene["start.state"] == "rest":
        radius, rod = scene["crank.radius"], scene["crank.upper_rod"]
        state[0] = min(rod, _slider(radius, rod, 0.0))
        state[2] = min(rod, _slider(radius, rod, -scene["guide.angle"]))
    return state


def rkfixed(scene: Scene, friction: str, advance: float, step: float, instants: np.ndarray) -> np.ndarray:
    """Displacement of the body [m] at `instants` [s] by steps of `step` [s]; not finite where the method diverges."""
    counts = np.rint(np.asarray(instants) / step).astype(np.int64)
    return _rkfixed(start_state(scene), worksheet(scene, friction, advance), step, counts)


def rkadapt(scene: Scene, friction: str, advance: float, instants: np.ndarray) -> np.ndarray:
    """Displacement of the body [m] at `instants` [s] by adaptive steps (RuntimeError if they get too short)."""
    sheet = worksheet(scene, friction, advance)
    solved = solve_ivp(rates, (0.0, instants[-1]), start_state(scene), method="RK45", t_eval=instants, args=(sheet,),
                       rtol=TOLERANCE, atol=ABSOLUTE)
    if not solved.success:
        raise RuntimeError(f"Rkadapt: {solved.message}")
    return solved.y[4]
