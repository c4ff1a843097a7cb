"""Coulomb friction of the body on the ground, eq. (5), for each rule of the normal force."""

from vibro_ros.model.automaton import Guard, Target, to
from vibro_ros.model.forms import Form, Forms

#: Friction force F_fr as a multiple of mu N, by state; in `stick` and `rest` it balances F_in.
SLIDING = {"slip_forward": 1.0, "slip_backward": -1.0, "unloaded": 0.0, "frictionless": 0.0}


class Friction:
    """Friction states of the body.

    `stick`: x' = 0 while \\|F_in\\| <= mu N. `slip_forward`, `slip_backward`: F_fr = mu N sign(x').
    `unloaded` (rule `unilateral`): N < 0, no friction, and x' = 0 is no event.
    `rest` (rule `printed`): N < 0 and x' = 0, where eq. (5) starts the body in the direction of F_in, and
    leaves it at rest while F_in is exactly zero.
    """

    name = "friction"

    def __init__(self, scene, forms: Forms):
        self._forms = forms
        self._coefficient = scene["ground.friction"]
        self._holding = scene["ground.static_friction" if scene["effects.friction"] == "static" else "ground.friction"]
        self._rule = scene["effects.normal_force"]
        self._absent = scene["effects.friction"] == "none" or self._coefficient == 0.0

    @property
    def initial(self) -> str:
        """State to start in; its guards correct it at once if need be."""
        return self.states[0]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        if self._absent:
            return ("frictionless",)
        extra = {"weight": (), "unilateral": ("unloaded",), "printed": ("rest",)}[self._rule]
        return ("stick", "slip_forward", "slip_backward", *extra)

    def force(self, state: str, normal: Form, inertial: Form) -> Form:
        """F_fr [N] in `state`: positive opposes forward motion."""
        if state in SLIDING:
            return SLIDING[state] * self._coefficient * normal
        return inertial

    def guards(self, state: str, normal: Form, inertial: Form) -> list[Guard]:
        """Guards of `state`, given the forms of N and F_in."""
        loaded = Guard(normal, to("unloaded"), "N >= 0")
        if state == "stick":
            return self._unloading(normal, "rest") + [
                Guard(self._holding * normal - inertial, to("slip_forward"), "F_in <= μ N"),
                Guard(self._holding * normal + inertial, to("slip_backward"), "-F_in <= μ N"),
            ]
        if state == "rest":
            return [Guard(-normal, to("stick"), "N <= 0"), Guard(-inertial, to("slip_forward"), "F_in <= 0"),
                    Guard(inertial, to("slip_backward"), "F_in >= 0")]
        if state == "unloaded":
            return [Guard(-normal, to("slip_forward", "slip_backward", "stick"), "N <= 0")]
        if state == "frictionless":
            return []
        body = self._forms.body
        velocity, stopped = self._forms.velocity(body), ((self._forms.channels.velocity(body), self._forms.zero),)
        sign, other, text = (1.0, "slip_backward", "x' >= 0") if state == "slip_forward" else (
            -1.0, "slip_forward", "x' <= 0")
        moving = Guard(sign * velocity, (Target("stick", stopped), Target(other, stopped)), text)
        return [moving, loaded] if self._rule == "unilateral" else [moving]

    def _unloading(self, normal: Form, rest: str) -> list[Guard]:
        """First guard of `stick`: where N may fall below 0 at a blow, it decides before the bounds of F_in do."""
        target = {"weight": None, "unilateral": "unloaded", "printed": rest}[self._rule]
        return [Guard(normal, to(target), "N >= 0")] if target else []
