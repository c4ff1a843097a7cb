"""The body on the ground: friction for each rule of the normal force; lift-off and landing.

Coulomb's law is eq. (5). The law `static` holds a body at rest with the coefficient mu_s instead of mu. By Stribeck's
law the coefficient falls from mu_s to mu as the speed rises,

    mu(v) = mu + (mu_s - mu) exp(-|v| / v_s).

This form is A. Tustin's, J. IEE 94 (1947), and the general form with exponent 1 (B. Armstrong-Hélouvry, P. Dupont and
C. Canudas de Wit, Automatica 30 (1994), 1083-1138).
"""

from collections.abc import Iterator

from vibro_ros.model.automaton import Guard, Target, without_jump
from vibro_ros.model.contact import REST_SPEED
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.landing import Landing
from vibro_ros.model.scene import Scene

#: Friction force F_fr as a multiple of mu(v) N, by state. In the states that are not listed, `stick` and `rest`, F_fr
#: balances F_in.
FRICTION_SIGN = {"slip_forward": 1.0, "slip_backward": -1.0, "unloaded": 0.0, "grounded": 0.0, "airborne": 0.0}


class Friction:
    """States of the body on the ground and above it.

    `stick`: x' = 0 while abs(F_in) <= mu_s N.
    `slip_forward`, `slip_backward`: F_fr = mu(v) N sign(x').
    `unloaded` (rule `unilateral`): N < 0, so that there is no friction and x' = 0 is no event.
    `rest` (rule `printed`): N < 0 and x' = 0. There eq. (5) starts the body in the direction of F_in, and leaves the
    body at rest while F_in is exactly zero.
    `airborne` (rule `hop`): N = 0 and y > 0, from lift-off to landing.
    `grounded`: the body is on the ground, without friction or without a force along the ground.

    Parameters
    ----------
    scene : Scene
        The scene whose friction law, coefficients and rule of the normal force count.
    forms : Forms
        The forms of the scene.
    """

    name = "friction"

    def __init__(self, scene: Scene, forms: Forms):
        self._scene = scene
        self._forms = forms
        self._kinetic = scene["ground.friction"]
        self._static = scene.resting_friction
        self._rule = scene["effects.normal_force"]
        self._is_absent = not (scene.has_friction and forms.body_moves)

    @property
    def initial(self) -> str:
        """State to start in; if its guards do not hold, another state follows at once."""
        return self.states[0]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        airborne = ("airborne",) if self._forms.body_hops else ()
        if self._is_absent:
            return ("grounded", *airborne)
        extra = {"weight": (), "unilateral": ("unloaded",), "printed": ("rest",), "hop": airborne}[self._rule]
        return ("stick", "slip_forward", "slip_backward", *extra)

    def force(self, state: str, normal: Form, inertial: Form) -> Form:
        """Form of F_fr [N] in `state`, positive when F_fr opposes forward motion, from the forms of N and F_in."""
        if state in FRICTION_SIGN:
            decayed = (self._static - self._kinetic) * self._forms.decayed_normal_force()
            return FRICTION_SIGN[state] * (self._kinetic * normal + decayed)
        return inertial

    def decay_rate(self, state: str) -> float:
        """Rate [s/m] at which ln(exp(-abs(x') / v_s)) changes with x' in `state`; 0 where no friction decays."""
        if not self._forms.friction_decays:
            return 0.0
        return -FRICTION_SIGN.get(state, 0.0) / self._scene["ground.stribeck_speed"]

    @staticmethod
    def context(state: str, resting: frozenset[str], closed: frozenset[str]) -> tuple:
        """What the guards of `state` depend on besides the state.

        Masses at rest matter to a landing alone. The plates in contact that change the forms of N and F_in, `closed`,
        matter to all else.
        """
        return (resting,) if state == "airborne" else (closed,)

    def guards(self, state: str, normal: Form, inertial: Form, resting: frozenset[str] = frozenset()) -> list[Guard]:
        """Guards of `state`, from the forms of N and F_in and the guides whose masses rest on rigid plates."""
        if state == "airborne":
            height = self._forms.position(self._forms.height)
            return [Guard(height, tuple(self._landings(resting)), "y >= 0", entries_decide=True)]
        if state == "stick":
            bound = f"F_in <= {self._static:g} N"
            return self._normal_force_guards(state, normal) + [
                Guard(self._static * normal - inertial, without_jump("slip_forward"), bound),
                Guard(self._static * normal + inertial, without_jump("slip_backward"), f"-{bound}"),
            ]
        if state == "rest":
            return [Guard(-normal, without_jump("stick"), "N <= 0"),
                    Guard(-inertial, without_jump("slip_forward"), "F_in <= 0"),
                    Guard(inertial, without_jump("slip_backward"), "F_in >= 0")]
        if state == "unloaded":
            return [Guard(-normal, without_jump("slip_forward", "slip_backward", "stick"), "N <= 0")]
        if state == "grounded":
            return self._normal_force_guards(state, normal)
        body = self._forms.body
        velocity, stopped = self._forms.velocity(body), ((self._forms.channels.velocity(body), self._forms.zero),)
        sign, other, text = (1.0, "slip_backward", "x' >= 0") if state == "slip_forward" else (
            -1.0, "slip_forward", "x' <= 0")
        moving = Guard(sign * velocity, (Target("stick", stopped), Target(other, stopped)), text)
        return [moving, *self._normal_force_guards(state, normal)]

    def _normal_force_guards(self, state: str, normal: Form) -> list[Guard]:
        """The guard N >= 0 if the rule of the normal force ends `state` where N turns negative, else none.

        In `stick` this guard stands before the bounds of F_in, because N may fall below 0 at a blow. A body that
        slips instead has another N and may still be pressed on the ground, so that slipping is tried first.
        """
        slipping = ("slip_forward", "slip_backward") if state == "stick" else ()
        targets = {"weight": (), "printed": ("rest",) if state == "stick" else (),
                   "unilateral": () if self._is_absent else ("unloaded",),
                   "hop": (*slipping, "airborne") if self._forms.body_hops else ()}[self._rule]
        return [Guard(normal, without_jump(*targets), "N >= 0")] if targets else []

    def _landings(self, resting: frozenset[str]) -> Iterator[Target]:
        """Targets of a landing. Masses at rest that feel the landing stay on their plates if the landing is slow."""
        if not (resting and self._scene["effects.reaction"]):
            yield from self._landing(frozenset())
            return
        _, rise = self._forms.body_velocity()
        slow = REST_SPEED * self._forms.one + rise
        for target in self._landing(resting):
            yield target._replace(entries=(slow, *target.entries))
        for target in self._landing(frozenset()):
            yield target._replace(frees_resting_masses=True)

    def _landing(self, resting: frozenset[str]) -> tuple[Target, ...]:
        """Targets of a landing in which the masses of `resting` stay on their plates."""
        if self._is_absent:
            return Landing(self._scene, self._forms, 0.0, 0.0, resting).targets_without_friction("grounded")
        return Landing(self._scene, self._forms, self._kinetic, self._static, resting).targets_with_friction()
