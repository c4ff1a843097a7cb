"""The landing of a body that was in the air: an inelastic shock with friction.

The ground gives the body the impulse (P_x, P_y) that ends the fall, so that y' is 0 afterwards. With the inertia A of
`shock.Shock`, whose elements are M_xx, M_xy and M_yy,

    P_x = M_xx dx' + M_xy dy'        P_y = M_xy dx' + M_yy dy'

While the body slips, P_x = -sigma mu P_y with sigma = sign(x'), so that

    dx' = -c dy',    c(sigma) = (M_xy + sigma mu M_yy) / (M_xx + sigma mu M_xy)

(Routh's law: friction opposes the speed that the body has, at every instant of the shock.) A body whose speed along the
ground vanishes before the fall has ended sticks if abs(M_xy) <= mu_s M_yy; otherwise the body slips the other way for
the rest of the shock.

A mass that rests on a rigid plate and feels the body move parts from the plate: the mass goes on falling or, where
friction throws the body against the mass, strikes the plate at once. If the fall is slower than `contact.REST_SPEED`,
the mass stays at rest and lands with the body as one, because otherwise hops and bounces that belong together would
follow each other without end.
"""

from vibro_ros.model.automaton import Target
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.scene import Scene
from vibro_ros.model.shock import Jumps, Shock


class Landing:
    """The states to which a landing leads, with the jumps on the way.

    Parameters
    ----------
    scene : Scene
        The scene whose masses, guides and reaction count.
    forms : Forms
        The forms of the scene.
    kinetic, static : float
        Friction coefficients while the body slips and while it sticks.
    resting : frozenset of str
        Guides whose masses rest on rigid plates and stay there.
    """

    def __init__(self, scene: Scene, forms: Forms, kinetic: float, static: float,
                 resting: frozenset[str] = frozenset()):
        self._forms = forms
        self._shock = Shock(scene, forms, resting)
        (along, across), (_, up) = self._shock.inertia
        self._forwards, self._backwards = ((across + sign * kinetic * up) / (along + sign * kinetic * across)
                                           for sign in (1.0, -1.0))
        self._sticks = abs(across) <= static * up

    def targets_without_friction(self, state: str) -> tuple[Target, ...]:
        """The one target without friction: `state`."""
        speed, fall = self._forms.body_velocity()
        return (Target(state, self._jumps(speed + self._forwards * fall)),)

    def targets_with_friction(self) -> tuple[Target, ...]:
        """Targets in the order to try them: the body slips on as before, or has stopped during the shock."""
        forms = self._forms
        speed, fall = forms.body_velocity()
        forwards, backwards = speed + self._forwards * fall, speed + self._backwards * fall
        # A shock that drives the body on never stops it. Then the speed before the shock decides, else the speed after.
        entries = forwards if self._forwards >= 0.0 else speed, backwards if self._backwards <= 0.0 else speed
        return (Target("slip_forward", self._jumps(forwards), entries=(entries[0],)),
                Target("slip_backward", self._jumps(backwards), entries=(-entries[1],)),
                self._after_a_stop(speed, fall))

    def _after_a_stop(self, speed: Form, fall: Form) -> Target:
        """The body sticks or, if friction is too weak, slips back after speed / c of the fall has been ended."""
        if self._sticks:
            return Target("stick", self._jumps(self._forms.zero))
        if self._backwards > 0.0:
            return Target("slip_backward", self._jumps(self._backwards * (speed / self._forwards + fall)))
        return Target("slip_forward", self._jumps(self._forwards * (speed / self._backwards + fall)))

    def _jumps(self, speed_after: Form) -> Jumps:
        """Jumps of a landing that leaves the body with the speed `speed_after` [m/s] along the ground."""
        forms, at = self._forms, self._forms.channels
        speed, fall = forms.body_velocity()
        jumps = [(at.position(forms.height), forms.zero), (at.velocity(forms.height), forms.zero)]
        if forms.body_moves:
            jumps.append((at.velocity(forms.body), speed_after))
        return (*jumps, *self._shock.free_mass_jumps((speed_after - speed, -fall)))
