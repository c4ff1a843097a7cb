"""Whether a motion is one for which the model may leave out the body's pitch and the heat of a motor's winding."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene

FAIR_PITCH = 0.2
"""Pitch index up to which a model without pitch is fair."""
LEAST_HOP = 1e-4
"""Hop [m] below which no pitch index is given, because such flights end between two samples."""
TOUCHED = 0.05
"""Change of the centre of mass's vertical speed that counts as a touch of the ground, over the body's largest one."""
GAP = 2.5
"""Longest pause between samples, in median sample periods, across which a flight is followed."""


class Validity(NamedTuple):
    """Result of `validity_of` for a motion."""

    # lift of a wheel by the pitch that is left out, over the largest hop; None where the body does not hop
    pitch_index: float | None
    current_share: float | None  # rms current over `motor.continuous_current`; None for a motor without a winding

    def warnings(self) -> list[str]:
        """Return a sentence for each number that is above its limit."""
        sentences = []
        if self.pitch_index is not None and self.pitch_index > FAIR_PITCH:
            sentences.append(f"the pitch index {self.pitch_index:.2g} is above {FAIR_PITCH:g}: a body of this "
                             "body.inertia would pitch so much in its flights that the model, which leaves this out, "
                             "is not fair")
        if self.current_share is not None and self.current_share > 1.0:
            sentences.append(f"the motor's rms current is {self.current_share:.3g} of motor.continuous_current: a "
                             "winding that carries more than 1 for long overheats")
        return sentences


def validity_of(scene: Scene, samples: Mapping[str, np.ndarray]) -> Validity:
    """Judge a motion by its samples; with few samples in a flight, a small pitch index may more than double.

    `samples` are the fields of `Samples` that are needed: the time, heights, and motion of the scene's masses where the
    body can hop, and the current of a dc motor.
    """
    share, current = None, samples.get("motor_current", np.empty(0))
    if scene.has_rotor and len(current):
        share = math.sqrt(math.fsum(current * current) / len(current)) / scene["motor.continuous_current"]
    return Validity(_pitch_index(scene, samples) if scene.body_hops else None, share)


def _pitch_index(scene: Scene, samples: Mapping[str, np.ndarray]) -> float | None:
    """Return the pitch angle [rad] of the worst flight times half the wheelbase, over the largest hop.

    In free flight a_G + g = -P''/M, where P = sum of m_i p_i. So the moment T = -sum of m_i p_i × (a_i + g) about the
    body's centre is the rate of (P × P')/M - sum of m_i p_i × p_i', which needs no forces, and misses no blow that
    lies between two samples. Masses of the linkage, and forces of air and pushes, are left out.
    """
    time, height, rising = (samples[name] for name in ("time", "body_height", "body_vertical_velocity"))
    if len(time) < 3 or (highest := float(height.max())) < LEAST_HOP:
        return None
    centre, momentum, spin = np.zeros((2, len(time))), np.zeros((2, len(time))), np.zeros(len(time))
    for side in scene.guides:
        mass, direction = scene[f"mass.{side}"], np.array(scene.direction(side))[:, None]
        place = direction * samples[f"{side}_position"] + [[0.0], [scene["body.crank_offset"]]]
        rate = direction * samples[f"{side}_velocity"]
        centre, momentum, spin = centre + mass * place, momentum + mass * rate, spin + mass * _cross(place, rate)
    turning = (_cross(centre, momentum) / scene.total_mass - spin) / scene["body.inertia"]

    step = np.diff(time)
    pushed = np.diff(rising + momentum[1] / scene.total_mass) + scene.gravity[1] * step
    lost = (step <= 0.0) | (step > GAP * np.median(step))
    touched = (height[:-1] <= 0.0) | (pushed > TOUCHED * np.abs(rising).max()) | lost
    begin = np.maximum.accumulate(np.where(touched, np.arange(len(step)), -1))  # last touch before each step
    flying = (height[1:] > 0.0) & (begin >= 0) & ~lost[begin]
    gained = np.where(flying, step * ((turning[:-1] + turning[1:]) / 2.0 - turning[begin]), 0.0)
    angle = np.cumsum(gained)
    worst = np.abs(angle - (angle - gained)[begin])[flying].max(initial=0.0)
    return float(worst) * scene["body.wheelbase"] / 2.0 / highest


def _cross(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the cross product of vectors in the plane of the guides, with components along x and upwards."""
    return left[0] * right[1] - left[1] * right[0]
