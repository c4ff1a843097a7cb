"""The baseline that timings are ratios to: fixed-step Runge-Kutta 4 of the same scene, compiled by numba.

It shares no code with the event loop. Contacts and friction are evaluated where the steps happen to fall, which is
what makes fixed steps inexact here: that is the comparison's point, not an oversight.
"""

import math

import numba
import numpy as np

from vibro_ros.model.scene import Scene

_RULES = {"weight": 0, "unilateral": 1, "printed": 2}


@numba.njit(cache=True, error_model="numpy", inline="always")
def _slider(sine, cosine, radius, rod):
    """Position and slope of a slider, eqs. (2) and (3)."""
    root = math.sqrt(rod * rod - radius * radius * sine * sine)
    return radius * cosine + root, -radius * sine * (1.0 + radius * cosine / root)


@numba.njit(cache=True, error_model="numpy", inline="always")
def _guide_force(position, velocity, slider, slider_velocity, spring, damper, plate, plate_spring, plate_damper):
    """F2 or F3, eqs. (1) and (4)."""
    force = spring * (position - slider) + damper * (velocity - slider_velocity)
    if position >= plate:
        force += plate_spring * (position - plate) + plate_damper * velocity
    return force


@numba.njit(cache=True, error_model="numpy", inline="always")
def _accelerations(time, u, du, w, dw, dx, p, rule):
    """u'', w'', x'' of eqs. (1) to (7), and F_in and mu N."""
    theta = p[0] * time
    sine, cosine = math.sin(theta), math.cos(theta)
    b, slope_b = _slider(sine, cosine, p[1], p[2])
    c, slope_c = _slider(sine * p[21] - cosine * p[20], cosine * p[21] + sine * p[20], p[1], p[3])
    f2 = _guide_force(u, du, b, slope_b * p[0], p[5], p[6], p[7], p[8], p[9])
    f3 = _guide_force(w, dw, c, slope_c * p[0], p[10], p[11], p[12], p[13], p[14])
    total = p[15] + p[16] + p[17]
    normal = total * p[18]
    if rule != 0:
        normal -= f2 + f3 * p[21]
    if rule == 1:
        normal = max(normal, 0.0)
    inertial = -f3 * p[20]
    bound = p[19] * normal
    if dx > 0.0 or (dx == 0.0 and inertial > bound):
        friction = bound
    elif dx < 0.0 or -inertial > bound:
        friction = -bound
    else:
        friction = inertial
    return -f2 / p[16], -f3 / p[17], (inertial - friction) / total, inertial, bound


@numba.njit(cache=True, error_model="numpy")
def _integrate(start, p, rule, h, per_sample, samples):
    """Fixed steps from t = 0; the body stops where x' changes sign while |F_in| <= mu N."""
    u, du, w, dw = start
    x = dx = 0.0
    half = 0.5 * h
    done = 0
    samples[0] = u, du, w, dw, x, dx
    for n in range(1, len(samples)):
        for _ in range(per_sample):
            t = done * h
            au1, aw1, ax1, _, _ = _accelerations(t, u, du, w, dw, dx, p, rule)
            du2, dw2, dx2 = du + half * au1, dw + half * aw1, dx + half * ax1
            au2, aw2, ax2, _, _ = _accelerations(t + half, u + half * du, du2, w + half * dw, dw2, dx2, p, rule)
            du3, dw3, dx3 = du + half * au2, dw + half * aw2, dx + half * ax2
            au3, aw3, ax3, _, _ = _accelerations(t + half, u + half * du2, du3, w + half * dw2, dw3, dx3, p, rule)
            du4, dw4, dx4 = du + h * au3, dw + h * aw3, dx + h * ax3
            au4, aw4, ax4, inertial, bound = _accelerations(t + h, u + h * du3, du4, w + h * dw3, dw4, dx4, p, rule)
            u += h / 6.0 * (du + 2.0 * (du2 + du3) + du4)
            w += h / 6.0 * (dw + 2.0 * (dw2 + dw3) + dw4)
            x += h / 6.0 * (dx + 2.0 * (dx2 + dx3) + dx4)
            du += h / 6.0 * (au1 + 2.0 * (au2 + au3) + au4)
            dw += h / 6.0 * (aw1 + 2.0 * (aw2 + aw3) + aw4)
            before = dx
            dx += h / 6.0 * (ax1 + 2.0 * (ax2 + ax3) + ax4)
            if before * dx < 0.0 and abs(inertial) <= bound:
                dx = 0.0
            done += 1
        samples[n] = u, du, w, dw, x, dx


def integrate_rk4(scene: Scene, start: np.ndarray, duration: float, rate: float, step: float = 1e-5) -> np.ndarray:
    """Integrate a scene with both masses, an ideal motor and gaps at rest.

    Parameters
    ----------
    scene : Scene
        The scene; `effects.adhesion` false is not supported.
    start : ndarray, shape (4,)
        u, u', w, w' at t = 0 [m, m/s]; the body starts at rest at 0.
    duration, rate : float
        Length [s] and samples per second.
    step : float
        Fixed step [s]; the nearest that divides the sampling period is used.

    Returns
    -------
    ndarray, shape (samples, 6)
        u, u', w, w', x, x', the first sample at t = 0.
    """
    per_sample = max(1, round(1.0 / (rate * step)))
    samples = np.empty((round(duration * rate) + 1, 6))
    _integrate(tuple(start), _vector(scene), _RULES[scene["effects.normal_force"]], 1.0 / (rate * per_sample),
               per_sample, samples)
    return samples


def _vector(scene: Scene) -> np.ndarray:
    def guide(side):
        contact = scene[f"effects.{side}_contact"] != "none"
        return [scene[f"{side}.spring.stiffness"], scene[f"{side}.spring.damping"],
                scene[f"crank.{side}_rod"] + scene[f"{side}.gap"] if contact else math.inf,
                scene[f"{side}.plate.stiffness"], scene[f"{side}.plate.damping"]]

    friction = scene["ground.friction"] if scene["effects.friction"] != "none" else 0.0
    return np.array([scene["motor.speed"], scene["crank.radius"], scene["crank.upper_rod"],
                     scene["crank.inclined_rod"], scene["guide.angle"], *guide("upper"), *guide("inclined"),
                     scene["mass.body"], scene["mass.upper"], scene["mass.inclined"], scene["gravity"], friction,
                     math.sin(scene["guide.angle"]), math.cos(scene["guide.angle"])])
