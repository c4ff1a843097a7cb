"""Shocks: impulses that take no time, in which springs, dampers, weights and other finite forces do nothing.

A mass that feels the body move (the reaction) and that nothing strikes keeps, in space, its speed along e, the
direction of its guide: along the guide it changes by -e . dV while the body's velocity changes by dV = (dx', dy').
What is left of the rows x and y is the body with the inertia

    A = M 1 - sum m e e^T        over these masses; M 1 without the reaction.

A blow on the rigid plate of guide i changes the mass's speed along it from the approach a to -eps a against the plate
(eps the restitution). Its impulse on the mass and its opposite on the body make

    A dV = m e (1 + eps) a        where nothing holds the body.

On the ground that is so along x alone where the blow is too slow to count, or by a rule that keeps the body there.
Otherwise dy' >= 0 while no guide points down: the ground, which cannot pull, gives no impulse, so none of its friction
either, and the body lifts off.
"""

from collections.abc import Iterable

import numpy as np

from vibro_ros.model.forms import Form, Forms

Jumps = tuple[tuple[int, Form], ...]


class Shock:
    """A change of the body's velocity, and what the masses do meanwhile.

    Parameters
    ----------
    scene : Scene
        Its masses, guides and reaction.
    forms : Forms
        Its channels.
    moved : iterable of str
        Guides whose masses move with the body or are struck themselves, and so do not keep their speeds in space.

    Attributes
    ----------
    inertia : ndarray, shape (2, 2)
        A [kg], for x and y.
    """

    def __init__(self, scene, forms: Forms, moved: Iterable[str] = ()):
        self._forms = forms
        self._keeping = [side for side in forms.guides if scene["effects.reaction"] and side not in moved]
        directions = np.array([forms.direction(side) for side in self._keeping]).reshape(-1, 2)
        masses = np.array([scene[f"mass.{side}"] for side in self._keeping])
        self.inertia = scene.total_mass * np.eye(2) - directions.T @ (masses[:, None] * directions)

    def masses(self, change: tuple[Form, Form]) -> Jumps:
        """What the body's `change` of velocity makes of the speeds of the masses that keep theirs in space."""
        forms = self._forms
        guides = ((side, forms.guides.index(side)) for side in self._keeping)
        return tuple((forms.channels.velocity(i), forms.velocity(i) - forms.along(side, change)) for side, i in guides)


class Blow:
    """A blow of a mass on its rigid plate, in the parts that change.

    Parameters
    ----------
    scene : Scene
        Its masses, guides and reaction.
    forms : Forms
        Its channels.
    side : str
        The guide.
    """

    def __init__(self, scene, forms: Forms, side: str):
        self._scene, self._forms, self._side = scene, forms, side

    def own(self, restitution: float) -> Jumps:
        """The mass itself, put exactly on its plate."""
        forms, i = self._forms, self._forms.guides.index(self._side)
        plate, _ = forms.plate(self._side)
        return ((forms.channels.position(i), plate),
                (forms.channels.velocity(i), forms.velocity(i) - self._change(restitution)))

    def slide(self, restitution: float) -> Jumps:
        """The body that stays on the ground: M x' - m3 w' sin(phi) is kept."""
        forms = self._forms
        along_x, _ = forms.direction(self._side)
        if not forms.body_moves or along_x == 0.0:
            return ()
        share = self._scene[f"mass.{self._side}"] * along_x / self._scene.total_mass
        return ((forms.channels.velocity(forms.body),
                 forms.velocity(forms.body) + share * self._change(restitution)),)

    def throw(self, restitution: float, resting: Iterable[str] = ()) -> Jumps:
        """The body that nothing holds, with the other masses; those of `resting` move with it."""
        forms, shock = self._forms, Shock(self._scene, self._forms, (self._side, *resting))
        impulse = self._scene[f"mass.{self._side}"] * np.array(forms.direction(self._side))
        along_x, upwards = (part * self._change(restitution) for part in np.linalg.solve(shock.inertia, impulse))
        speed, rise = forms.body_velocity()
        body = ((forms.channels.velocity(forms.height), rise + upwards),)
        if forms.body_moves:
            body += ((forms.channels.velocity(forms.body), speed + along_x),)
        return body + shock.masses((along_x, upwards))

    def _change(self, restitution: float) -> Form:
        """(1 + eps) a."""
        _, approach = self._forms.penetration(self._side)
        return (1.0 + restitution) * approach
