"""How fast the masses move on their springs and dampers where the body yields to them.

With `effects.reaction` a mass feels the body's acceleration, so that it moves as if it were lighter: in the air, on
ground that does not hold the body, and most of all where friction nearly jams the body (Painlevé's paradox). Rows x and
y of the equations give the body's acceleration by that of the masses, x'' = sum X_j q_j'' and y'' = sum Y_j q_j'', but
for what does not depend on it. So the masses' own rows are I q'' = -C q' - K q with I = m (1 + e_x X + e_y Y).
"""

import itertools
from collections.abc import Iterator

import numpy as np

from vibro_ros.model.forms import direction


def fastest_rate(scene) -> float:
    """Largest eigenvalue [1/s] of the masses of `scene`, a Scene with the reaction, over all states of its plates and
    its body; infinite where a mass has no inertia at all."""
    pairs = list(itertools.product(_inertias(scene), _loads(scene)))
    n = len(scene.guides)
    companions = np.zeros((len(pairs), 2 * n, 2 * n))
    companions[:, :n, n:] = np.eye(n)
    try:
        companions[:, n:] = [-np.linalg.solve(inertia, load) for inertia, load in pairs]
    except np.linalg.LinAlgError:
        return np.inf
    return float(abs(np.linalg.eigvals(companions)).max(initial=0.0))


def least_inertia(scene) -> float:
    """Least part of its own inertia that the body leaves to a mass, or a combination of the masses: 1 where it does not
    yield, 0 where it yields without resistance."""
    masses = _masses(scene)[:, None]
    return min((float(np.linalg.svd(inertia / masses, compute_uv=False).min()) for inertia in _inertias(scene)),
               default=1.0)


def _masses(scene) -> np.ndarray:
    return np.array([scene[f"mass.{side}"] for side in scene.guides])


def _inertias(scene) -> Iterator[np.ndarray]:
    """I of a body that slides without friction, that slips either way, and that is in the air."""
    masses, rule = _masses(scene), scene["effects.normal_force"]
    across, up = np.array([direction(scene, side) for side in scene.guides]).reshape(-1, 2).T
    slip = scene["ground.friction"] if scene.has_friction and rule != "weight" else 0.0
    for friction in (0.0, slip, -slip):
        yield np.diag(masses) - np.outer(masses * across, masses * (across + friction * up)) / scene.total_mass
    if rule == "hop":
        yield np.diag(masses) - sum(np.outer(masses * part, masses * part) for part in (across, up)) / scene.total_mass


def _loads(scene) -> Iterator[np.ndarray]:
    """K and C side by side, shape (n, 2 n), for every set of compliant plates that press."""
    compliant = [side for side in scene.plates if scene[f"effects.{side}_contact"] == "compliant"]
    for closed in itertools.product((0.0, 1.0), repeat=len(compliant)):
        on = dict(zip(compliant, closed, strict=True))
        yield np.hstack([np.diag([scene[f"{side}.spring.{part}"] + on.get(side, 0.0) * scene[f"{side}.plate.{part}"]
                                  for side in scene.guides]) for part in ("stiffness", "damping")])
