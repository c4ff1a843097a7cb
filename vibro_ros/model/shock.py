"""Shocks: impulses that take no time, in which springs, dampers, weights and other finite forces do nothing.

A mass is *free* in a shock if the mass feels the body move (the reaction) and nothing strikes the mass. In space a free
mass keeps its speed along e, the direction of its guide; along the guide its speed changes by -e . dV while the body's
velocity changes by dV = (dx', dy'). The rows x and y then leave the body with the inertia

    A = M 1 - sum m e e^T        over the free masses; M 1 without the reaction.

A blow on the rigid plate of guide i changes the mass's speed along the guide from the approach a to -eps a against the
plate (eps the restitution). The blow's impulse on the mass, and the opposite impulse on the body, make

    A dV = m e (1 + eps) a        where nothing holds the body.

A body on the ground gets this change along x alone if the blow is too slow to count, or by a rule that keeps the body
on the ground. Otherwise dy' >= 0 while no guide points down: the ground, which cannot pull, gives no impulse and no
friction, and the body lifts off.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from vibro_ros.model.forms import Form, Forms, cached
from vibro_ros.model.scene import Scene

#: Channels of positions and velocities, each with the form of the value after the shock, shape (channels,).
Jumps = tuple[tuple[int, Form], ...]


class Shock:
    """A change of the body's velocity, and what the free masses do meanwhile.

    Parameters
    ----------
    scene : Scene
        The scene whose masses, guides and reaction count.
    forms : Forms
        The forms of the scene.
    not_free : iterable of str
        Guides whose masses move with the body or are struck themselves.

    Attributes
    ----------
    inertia : ndarray, shape (2, 2)
        A [kg], for x and y.
    """

    def __init__(self, scene: Scene, forms: Forms, not_free: Iterable[str] = ()):
        self._forms = forms
        self._free = [side for side in forms.guides if scene["effects.reaction"] and side not in not_free]
        directions = np.array([scene.direction(side) for side in self._free]).reshape(-1, 2)
        masses = np.array([scene[f"mass.{side}"] for side in self._free])
        self.inertia = scene.total_mass * np.eye(2) - directions.T @ (masses[:, None] * directions)

    def free_mass_jumps(self, change: tuple[Form, Form]) -> Jumps:
        """Jumps of the free masses' speeds along their guides, for a `change` of the body's x' and y' [m/s]."""
        forms = self._forms
        guides = ((side, forms.guides.index(side)) for side in self._free)
        return tuple((forms.channels.velocity(i), forms.velocity(i) - forms.along(side, change)) for side, i in guides)


class Blow:
    """A blow of a mass on its rigid plate: the jumps of the mass, and those of the body on the ground or thrown up.

    Parameters
    ----------
    scene : Scene
        The scene whose masses, guides and reaction count.
    forms : Forms
        The forms of the scene.
    side : str
        The guide.
    """

    def __init__(self, scene: Scene, forms: Forms, side: str):
        self._cache: dict[tuple, Any] = {}
        self._scene, self._forms, self._side = scene, forms, side

    @cached
    def mass_jumps(self, restitution: float) -> Jumps:
        """Jumps of the mass that strikes, which is put exactly on its plate."""
        forms, i = self._forms, self._forms.guides.index(self._side)
        plate, _ = forms.plate(self._side)
        return ((forms.channels.position(i), plate),
                (forms.channels.velocity(i), forms.velocity(i) - self._speed_change(restitution)))

    @cached
    def sliding_body_jumps(self, restitution: float) -> Jumps:
        """Jump of x' of a body that stays on the ground: M x' - m3 w' sin(phi) does not change."""
        forms = self._forms
        along_x, _ = self._scene.direction(self._side)
        if not forms.body_moves or along_x == 0.0:
            return ()
        share = self._scene[f"mass.{self._side}"] * along_x / self._scene.total_mass
        return ((forms.channels.velocity(forms.body),
                 forms.velocity(forms.body) + share * self._speed_change(restitution)),)

    @cached
    def thrown_body_jumps(self, restitution: float, resting: frozenset[str] = frozenset()) -> Jumps:
        """Jumps of a body that nothing holds and of the free masses; the masses of `resting` move with the body."""
        forms, shock = self._forms, Shock(self._scene, self._forms, (self._side, *resting))
        impulse = self._scene[f"mass.{self._side}"] * np.array(self._scene.direction(self._side))
        along_x, upwards = (part * self._speed_change(restitution) for part in np.linalg.solve(shock.inertia, impulse))
        speed, rise = forms.body_velocity()
        body: Jumps = ((forms.channels.velocity(forms.height), rise + upwards),)
        if forms.body_moves:
            body += ((forms.channels.velocity(forms.body), speed + along_x),)
        return body + shock.free_mass_jumps((along_x, upwards))

    def _speed_change(self, restitution: float) -> Form:
        """(1 + eps) a [m/s]."""
        _, approach = self._forms.penetration(self._side)
        return (1.0 + restitution) * approach
