"""The body on the ground: friction for each rule of the normal force; lift-off and landing.

Coulomb's law is eq. (5). `static` holds a body at rest with another coefficient, mu_s instead of mu. By
Stribeck's law the coefficient falls from mu_s to mu as the speed rises,

    mu(v) = mu + (mu_s - mu) exp(-|v| / v_s),

in the form of A. Tustin, J. IEE 94 (1947), which is the general one with exponent 1 (B. Armstrong-Helouvry,
P. Dupont and C. Canudas de Wit, Automatica 30 (1994), 1083-1138).
"""

from collections.abc import Iterator

from vibro_ros.model.automaton import Guard, Target, to
from vibro_ros.model.contact import REST_SPEED
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.landing import Landing

#: Friction force F_fr as a multiple of mu(v) N, by state; in `stick` and `rest` it balances F_in.
SLIDING = {"slip_forward": 1.0, "slip_backward": -1.0, "unloaded": 0.0, "grounded": 0.0, "airborne": 0.0}


class Friction:
    """Friction states of the body.

    `stick`: x' = 0 while \\|F_in\\| <= mu_s N. `slip_forward`, `slip_backward`: F_fr = mu(v) N sign(x').
    `unloaded` (rule `unilateral`): N < 0, no friction, and x' = 0 is no event.
    `rest` (rule `printed`): N < 0 and x' = 0, where eq. (5) starts the body in the direction of F_in, and
    leaves it at rest while F_in is exactly zero.
    `airborne` (rule `hop`): N = 0 and y > 0, from lift-off to landing.
    `grounded`: on the ground without friction, or without a force along it.
    """

    name = "friction"

    def __init__(self, scene, forms: Forms):
        self._scene = scene
        self._forms = forms
        self._coefficient = scene["ground.friction"]
        self._holding = scene.resting_friction
        self._rule = scene["effects.normal_force"]
        self._absent = not (scene.has_friction and forms.body_moves)

    @property
    def initial(self) -> str:
        """State to start in; its guards correct it at once if need be."""
        return self.states[0]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        airborne = ("airborne",) if self._forms.body_hops else ()
        if self._absent:
            return ("grounded", *airborne)
        extra = {"weight": (), "unilateral": ("unloaded",), "printed": ("rest",), "hop": airborne}[self._rule]
        return ("stick", "slip_forward", "slip_backward", *extra)

    def force(self, state: str, normal: Form, inertial: Form) -> Form:
        """F_fr [N] in `state`: positive opposes forward motion."""
        if state in SLIDING:
            decayed = (self._holding - self._coefficient) * self._forms.decayed_normal_force()
            return SLIDING[state] * (self._coefficient * normal + decayed)
        return inertial

    def decay_rate(self, state: str) -> float:
        """Change of ln(N exp(-|x'| / v_s) / N) with x' [s/m]; 0 where no friction decays."""
        return -SLIDING.get(state, 0.0) / self._scene["ground.stribeck_speed"] if self._forms.friction_decays else 0.0

    def guards(self, state: str, normal: Form, inertial: Form, resting: frozenset[str] = frozenset()) -> list[Guard]:
        """Guards of `state`, given the forms of N and F_in, and the guides whose masses rest on rigid plates."""
        if state == "airborne":
            height = self._forms.position(self._forms.height)
            return [Guard(height, tuple(self._landings(resting)), "y >= 0", committed=True)]
        if state == "stick":
            bound = f"F_in <= {self._holding:g} N"
            return self._unloading(state, normal) + [
                Guard(self._holding * normal - inertial, to("slip_forward"), bound),
                Guard(self._holding * normal + inertial, to("slip_backward"), f"-{bound}"),
            ]
        if state == "rest":
            return [Guard(-normal, to("stick"), "N <= 0"), Guard(-inertial, to("slip_forward"), "F_in <= 0"),
                    Guard(inertial, to("slip_backward"), "F_in >= 0")]
        if state == "unloaded":
            return [Guard(-normal, to("slip_forward", "slip_backward", "stick"), "N <= 0")]
        if state == "grounded":
            return self._unloading(state, normal)
        body = self._forms.body
        velocity, stopped = self._forms.velocity(body), ((self._forms.channels.velocity(body), self._forms.zero),)
        sign, other, text = (1.0, "slip_backward", "x' >= 0") if state == "slip_forward" else (
            -1.0, "slip_forward", "x' <= 0")
        moving = Guard(sign * velocity, (Target("stick", stopped), Target(other, stopped)), text)
        return [moving, *self._unloading(state, normal)]

    def _unloading(self, state: str, normal: Form) -> list[Guard]:
        """N >= 0 by the rules that end `state` where it fails. In `stick`, where N may fall below 0 at a blow, it
        decides before the bounds of F_in do; it needs not be the N of a slipping body, which may still be pressed."""
        slipping = ("slip_forward", "slip_backward") if state == "stick" else ()
        targets = {"weight": (), "printed": ("rest",) if state == "stick" else (),
                   "unilateral": () if self._absent else ("unloaded",),
                   "hop": (*slipping, "airborne") if self._forms.body_hops else ()}[self._rule]
        return [Guard(normal, to(*targets), "N >= 0")] if targets else []

    def _landings(self, resting: frozenset[str]) -> Iterator[Target]:
        """With masses at rest that feel the landing, first those that are too slow to part them from their plates."""
        if not (resting and self._scene["effects.reaction"]):
            yield from self._landing(frozenset())
            return
        _, rise = self._forms.body_velocity()
        slow = REST_SPEED * self._forms.one + rise
        for target in self._landing(resting):
            yield target._replace(entries=(slow, *target.entries))
        for target in self._landing(frozenset()):
            yield target._replace(parts=True)

    def _landing(self, resting: frozenset[str]) -> tuple[Target, ...]:
        if self._absent:
            return Landing(self._scene, self._forms, 0.0, 0.0, resting).on_ice("grounded")
        return Landing(self._scene, self._forms, self._coefficient, self._holding, resting).with_friction()
