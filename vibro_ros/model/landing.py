"""The landing of a body that was in the air: an inelastic shock with friction.

The ground gives the body the impulse (P_x, P_y) that ends its fall, y'+ = 0. With the inertia of `shock.Shock`

    P_x = M_xx dx' + M_xy dy'        P_y = M_xy dx' + M_yy dy'

While it slips, P_x = -sigma mu P_y, sigma = sign(x'):

    dx' = -c dy',    c(sigma) = (M_xy + sigma mu M_yy) / (M_xx + sigma mu M_xy)

(Routh's law: friction opposes the speed that the body has, at every instant of the shock.) A body that comes to rest
before its fall has ended sticks if abs(M_xy) <= mu M_yy, and else slips the other way for the rest of the shock.

A mass that rests on a rigid plate and feels the body move parts from it: it goes on falling, or where friction throws
the body against it, strikes the plate at once. A fall slower than `contact.REST_SPEED` leaves it at rest, and the body
with it is one: or hops and bounces that belong together would follow each other without end.
"""

from vibro_ros.model.automaton import Target
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.shock import Shock


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
    resting : frozenset of str
        Guides whose masses rest on rigid plates and stay there.
    """

    def __init__(self, scene, forms: Forms, kinetic: float, static: float, resting: frozenset[str] = frozenset()):
        self._forms = forms
        self._shock = Shock(scene, forms, resting)
        (along, across), (_, up) = self._shock.inertia
        self._forwards, self._backwards = ((across + sign * kinetic * up) / (along + sign * kinetic * across)
                                           for sign in (1.0, -1.0))
        self._sticks = abs(across) <= static * up

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
        return (Target("slip_forward", self._jumps(forwards), entries=(entries[0],)),
                Target("slip_backward", self._jumps(backwards), entries=(-entries[1],)),
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
        return (*jumps, *self._shock.masses((speed_after - speed, -fall)))
