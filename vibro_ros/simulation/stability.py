"""Whether steps of fixed length stay bounded in every mode of a scene, also where a short run never comes."""

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene

# By how much a spectral radius of 1 may be exceeded, by rounding.
_ROUNDING = 1e-9


def is_stable(scene: Scene, scheme: str, step: float) -> bool:
    """Whether no mode of `scene` lets steps of `step` [s] by `scheme` grow faster than its motion does.

    A step that a plate's stiffness makes unstable is accurate until the first contact, and overflows then.
    """
    if scheme == "moreau":  # springs, dampers and contacts are implicit
        return True
    return all(_amplification(matrix, scheme, step) <= _growth(matrix, step) * (1.0 + _ROUNDING)
               for matrix in _matrices(scene))


def _matrices(scene: Scene) -> list[np.ndarray]:
    """Matrix A of y' = A y for the dynamic coordinates and their velocities, by mode."""
    model = compile_scene(scene)
    channels, rows = model.forms.channels, model.system.acceleration
    dynamic, first = channels.dynamic, channels.coordinates
    matrices = np.zeros((len(rows), 2 * dynamic, 2 * dynamic))
    matrices[:, :dynamic, dynamic:] = np.eye(dynamic)
    matrices[:, dynamic:, :dynamic] = rows[:, :dynamic, :dynamic]
    matrices[:, dynamic:, dynamic:] = rows[:, :dynamic, first:first + dynamic]
    return list(matrices)


def _amplification(matrix: np.ndarray, scheme: str, step: float) -> float:
    """Spectral radius of a step."""
    size, part = len(matrix), step * matrix
    if scheme == "rk4":
        grown = np.eye(size) + part @ (np.eye(size) + part / 2.0 @ (np.eye(size) + part / 3.0 @ (
            np.eye(size) + part / 4.0)))
    else:
        half = size // 2
        grown = np.eye(size)
        grown[half:] += part[half:]
        grown[:half] += step * grown[half:]
    return float(np.abs(np.linalg.eigvals(grown)).max())


def _growth(matrix: np.ndarray, step: float) -> float:
    """By how much the motion itself may grow during a step, at least 1."""
    return float(np.exp(max(0.0, step * np.linalg.eigvals(matrix).real.max())))
