"""The mass matrix B of B q'' = loads, as docs/robot.md has it, for q = (x, y, u, w) and the crank's angle."""

import math

import numpy as np


def mass_matrix(scene, angle=None):
    """B, shape (4, 4), or (5, 5) with a motor's crank at `angle` [rad], on which the masses of the linkage hang.

    Without the reaction rows u and w have no x'' and y''.
    """
    tilts = {"upper": 0.0, "inclined": scene["guide.angle"]}
    directions = {side: np.array([-math.sin(tilt), math.cos(tilt)]) for side, tilt in tilts.items()}
    matrix = np.zeros((4, 4) if angle is None else (5, 5))
    matrix[:2, :2] = scene.total_mass * np.eye(2)
    for i, (side, direction) in enumerate(directions.items(), start=2):
        matrix[:2, i] = matrix[i, :2] = matrix[i, i] = scene[f"mass.{side}"]
        matrix[:2, i] *= direction
        matrix[i, :2] *= direction * scene["effects.reaction"]
    if angle is None:
        return matrix
    radius = scene["crank.radius"]
    moved = [(scene["mass.crank_pin"], -radius * np.array([math.cos(angle), math.sin(angle)]))]
    for side, direction in directions.items():
        psi = angle - tilts[side]
        root = math.sqrt(scene[f"crank.{side}_rod"] ** 2 - (radius * math.sin(psi)) ** 2)
        slope = -radius * math.sin(psi) * (1.0 + radius * math.cos(psi) / root)
        moved.append((scene[f"mass.{side}_slider"], slope * direction))
    matrix[4, 4] = scene["motor.gear_ratio"] ** 2 * scene["motor.rotor_inertia"] + scene["motor.crank_inertia"]
    for mass, way in moved:
        matrix[:2, 4] += mass * way
        matrix[4, 4] += mass * (way @ way)
    matrix[4, :2] = matrix[:2, 4]
    return matrix
