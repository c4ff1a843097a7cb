"""How fast the masses move on their springs and dampers where the body yields to them.

With `effects.reaction` a mass feels the body's acceleration, so that the mass moves as if it were lighter: in the air,
on ground that does not hold the body, and most of all where friction nearly jams the body (Painlevé's paradox). Rows x
and y of the equations give the body's acceleration from the accelerations of the masses, x'' = sum X_j q_j'' and
y'' = sum Y_j q_j'', plus terms that do not depend on them. So the masses' own rows are I q'' = -C q' - K q with
I = m (1 + e_x X + e_y Y).
"""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

#: Fastest rate [1/s] of a mass on its springs and dampers that is simulated. A step lasts two of the mass's time
#: constants, so at this rate a simulated second takes 5e6 steps, some ten seconds. 1 g on 1e9 N/m reaches 1e6 1/s.
FASTEST_RATE = 1e7

#: Part of a mass's inertia that a yielding body must leave to the mass, so that rounding leaves ten digits of it.
LEAST_INERTIA = 1e-6


class YieldingMasses(NamedTuple):
    """The masses of a machine whose body yields to them, in numbers.

    Attributes
    ----------
    masses : ndarray, shape (n,)
        The masses [kg], one a guide.
    directions : ndarray, shape (n, 2)
        Directions of the guides: their parts along x and upwards.
    drives : ndarray, shape (n, 2)
        Stiffness [N/m] and damping [N·s/m] of each drive.
    plates : ndarray, shape (n, 2)
        The same of each compliant plate; zeros for a guide without one.
    total_mass : float
        Mass of the body and the masses together [kg].
    slip_friction : float
        Coefficient of the friction that the accelerations of the masses change while the body slips.
    leaves_ground : bool
        Whether the body can be in the air.
    """

    masses: np.ndarray
    directions: np.ndarray
    drives: np.ndarray
    plates: np.ndarray
    total_mass: float
    slip_friction: float
    leaves_ground: bool


def fastest_rate(machine: YieldingMasses) -> float:
    """Largest eigenvalue [1/s] of the masses over all states of plates and body; infinite without inertia."""
    inertias, loads, n = np.array(list(_inertias(machine))), np.array(list(_loads(machine))), len(machine.masses)
    companions = np.zeros((len(inertias), len(loads), 2 * n, 2 * n))
    companions[..., :n, n:] = np.eye(n)
    try:
        companions[..., n:, :] = -np.linalg.solve(inertias[:, None], loads)
    except np.linalg.LinAlgError:
        return np.inf
    return float(abs(np.linalg.eigvals(companions)).max(initial=0.0))


def least_inertia(machine: YieldingMasses) -> float:
    """Least part of its own inertia that the body leaves to a mass, or to a combination of the masses.

    The part is 1 where the body does not yield, and 0 where the body yields without resistance.
    """
    shares = np.array(list(_inertias(machine))) / machine.masses[:, None]
    return float(np.linalg.svd(shares, compute_uv=False).min(initial=1.0))


def _inertias(machine: YieldingMasses) -> Iterator[np.ndarray]:
    """I [kg], shape (n, n), of a body that slides without friction, that slips either way, and that is in the air."""
    masses, slip = machine.masses, machine.slip_friction
    across, up = machine.directions.T
    for friction in (0.0, slip, -slip):
        yield np.diag(masses) - np.outer(masses * across, masses * (across + friction * up)) / machine.total_mass
    if machine.leaves_ground:
        yield np.diag(masses) - sum(np.outer(masses * part, masses * part) for part in (across, up)) / (
            machine.total_mass)


def _loads(machine: YieldingMasses) -> Iterator[np.ndarray]:
    """K and C side by side, shape (n, 2 n), for every set of compliant plates that press."""
    compliant = np.flatnonzero(machine.plates.any(axis=1))
    for closed in itertools.product((0.0, 1.0), repeat=len(compliant)):
        pressing = np.zeros((len(machine.masses), 1))
        pressing[compliant, 0] = closed
        stiffness, damping = (machine.drives + pressing * machine.plates).T
        yield np.hstack([np.diag(stiffness), np.diag(damping)])
