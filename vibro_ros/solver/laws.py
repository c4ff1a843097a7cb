"""Contact and friction as laws between velocities and impulses, for time stepping.

The coordinates obey M q'' + C q' + K q = f + contact forces, with known loads f. A *contact* has a gap g, a linear form
that grows with q, and pushes with an impulse P >= 0 along W: M dq' = W P. It is

- rigid: where the gap would close, its rate after the step is at least -e times that before, e the restitution
  (Newton's law), and P is no more than that takes; or
- compliant: P = h (k d + c d') at the step's end while the depth d = -g is positive there, where P < 0 is a plate's
  pull, if it may.

One coordinate may *slip*, with a friction impulse of at most mu times the normal impulse, which is a multiple of the
step and a linear form of the changes of velocity, or the impulse of one of the contacts, the *support*.
"""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.system import NOTHING

#: Outcomes of the friction law.
STICK, FORWARD, BACKWARD, WITHOUT_LOAD = range(4)


class Laws(NamedTuple):
    """The laws of n coordinates with m contacts; `response` and `compliance` belong to one length of step.

    Attributes
    ----------
    inertia, stiffness : ndarray, shape (n, n)
        M and K.
    load : ndarray, shape (n, channels)
        Rows of f.
    inverse : ndarray, shape (n, n)
        (M + h C + h² K)^-1.
    gap : ndarray, shape (m, channels)
        Rows of the gaps.
    spring, damper : ndarray, shape (m,)
        k and c of compliant contacts.
    restitution : ndarray, shape (m,)
        e of rigid contacts.
    rigid, pulls : ndarray of bool, shape (m,)
        Which contacts are rigid, and which may pull.
    response : ndarray, shape (m, n)
        Change of the velocities by a unit of each contact's impulse.
    compliance : ndarray, shape (m,)
        Change of the gap's rate by it.
    slipping : int
        The coordinate with friction, or `NOTHING`.
    sliding, rise, fading : float
        The friction coefficient of a coordinate that slips with speed v is sliding + rise exp(-fading |v|), fading in
        [s/m] ...
    holding : float
        ... and the coefficient while it is at rest.
    slip_response : ndarray, shape (n,)
        Change of the velocities by a unit of its impulse.
    weight : float
        Normal force without acceleration [N].
    swing : ndarray, shape (n,)
        What a change of the velocities adds to the normal impulse.
    support : int
        Contact whose impulse is the normal impulse instead, or `NOTHING`.
    negative : bool
        Whether friction follows a normal impulse below zero, along the motion; else there is none then.
    mode : ndarray of int, shape (2^(m without support) 4,)
        Mode of the system by the outcomes: pressing or not for each contact but the support, and the friction's.
    """

    inertia: np.ndarray
    stiffness: np.ndarray
    load: np.ndarray
    inverse: np.ndarray
    gap: np.ndarray
    spring: np.ndarray
    damper: np.ndarray
    restitution: np.ndarray
    rigid: np.ndarray
    pulls: np.ndarray
    response: np.ndarray
    compliance: np.ndarray
    slipping: int
    sliding: float
    rise: float
    fading: float
    holding: float
    slip_response: np.ndarray
    weight: float
    swing: np.ndarray
    support: int
    negative: bool
    mode: np.ndarray


def no_laws(coordinates: int, channels: int) -> Laws:
    """Laws of nothing, for the methods that know of guards instead."""
    square, none = np.zeros((coordinates, coordinates)), np.zeros(0)
    return Laws(square, square, np.zeros((coordinates, channels)), square, np.zeros((0, channels)), none, none, none,
                np.zeros(0, dtype=bool), np.zeros(0, dtype=bool), np.zeros((0, coordinates)), none, NOTHING,
                0.0, 0.0, 0.0, 0.0, np.zeros(coordinates), 0.0, np.zeros(coordinates), NOTHING, False,
                np.zeros(4, dtype=np.int64))
