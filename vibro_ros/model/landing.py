"""The landing of a body that was in the air: an inelastic shock with friction.

The ground gives the body the impulse (P_x, P_y) that ends its fall, y'+ = 0. Spring and damper forces are finite and
do nothing meanwhile. So a mass that feels the body move keeps, in space, its speed along e, the direction of its
guide: along the guide it changes by -(e_x dx' + e_y dy'). What is left is a body with the inertia

    P_x = M_xx dx' + M_xy dy'        M_xx = M - sum r m e_x²        M_xy = -sum r m e_x e_y
    P_y = M_xy dx' + M_yy dy'        M_yy = M - sum r m e_y²

over the masses, r = 1 with the reaction on them and 0 without. While it slips, P_x = -sigma mu P_y, sigma = sign(x'):

    dx' = -c dy',    c(sigma) = (M_xy + sigma mu M_yy) / (M_xx + sigma mu M_xy)

(Routh's law: friction opposes the speed that the body has, at every instant of the shock.) A body that comes to rest
before its fall has ended sticks if abs(M_xy) <= mu M_yy, and else slips the other way for the rest of the shock.
"""

import math

from vibro_ros.model.automaton import Target
from vibro_ros.model.forms import Form, Forms


class Landing:
    """The states to which a landing leads, with the jumps on the way.

    Parameters
    ----------
    scene : Scene
        Its masses, guides and reaction.
    forms : Forms
        Its channels.
    kinetic, static : float
        Friction coefficients while the body slips and while it sticks.
    """

    def __init__(self, scene, forms: Forms, kinetic: float, static: float):
        self._forms = forms
        self._felt = forms.guides if scene["effects.reaction"] else ()
        along, across, up = (scene.total_mass - self._sum(scene, 0, 0), -self._sum(scene, 0, 1),
                             scene.total_mass - self._sum(scene, 1, 1))
        self._forwards, self._backwards = ((across + sign * kinetic * up) / (along + sign * kinetic * across)
                                           for sign in (1.0, -1.0))
        self._sticks = abs(across) <= static * up

    def _sum(self, scene, i: int, j: int) -> float:
        return math.fsum(scene[f"mass.{side}"] * self._forms.direction(side)[i] * self._forms.direction(side)[j]
                         for side in self._felt)

    def on_ice(self, state: str) -> tuple[Target, ...]:
        """The one target without friction, `state`."""
        speed, fall = self._forms.body_velocity()
        return (Target(state, self._jumps(speed + self._forwards * fall)),)

    def with_friction(self) -> tuple[Target, ...]:
        """Targets in the order to try them: slip on as before, or the last one, after a stop during the shock."""
        forms = self._forms
        speed, fall = forms.body_velocity()
        forwards, backwards = speed + self._forwards * fall, speed + self._backwards * fall
        # A shock that drives the body on never stops it: then its speed before decides, else the one after.
        entries = forwards if self._forwards >= 0.0 else speed, backwards if self._backwards <= 0.0 else speed
        return (Target("slip_forward", self._jumps(forwards), entry=entries[0]),
                Target("slip_backward", self._jumps(backwards), entry=-entries[1]),
                self._after_a_stop(speed, fall))

    def _after_a_stop(self, speed: Form, fall: Form) -> Target:
        """Stick or, against friction that is too weak, a reversal after speed / c of the fall has been ended."""
        if self._sticks:
            return Target("stick", self._jumps(self._forms.zero))
        if self._backwards > 0.0:
            return Target("slip_backward", self._jumps(self._backwards * (speed / self._forwards + fall)))
        return Target("slip_forward", self._jumps(self._forwards * (speed / self._backwards + fall)))

    def _jumps(self, speed_after: Form) -> tuple[tuple[int, Form], ...]:
        """What a landing changes when it leaves the body with the speed `speed_after` along the ground."""
        forms, at = self._forms, self._forms.channels
        speed, fall = forms.body_velocity()
        jumps = [(at.position(forms.height), forms.zero), (at.velocity(forms.height), forms.zero)]
        if forms.body_moves:
            jumps.append((at.velocity(forms.body), speed_after))
        for side in self._felt:
            i = forms.guides.index(side)
            jumps.append((at.velocity(i), forms.velocity(i) - forms.along(side, (speed_after - speed, -fall))))
        return tuple(jumps)
