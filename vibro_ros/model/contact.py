"""Contacts of a mass with its plate: compliant, eq. (4), or rigid with restitution.

A contact gives its states, which of them press on the plate, their guards, and the contact force.
"""

import math

from vibro_ros.model.automaton import Guard, Target, to
from vibro_ros.model.forms import Form, Forms

_SYMBOL = {"upper": ("u", "E", "k4 (u - E) + c4 (u' - E')"), "inclined": ("w", "H", "k1 (w - H) + c1 (w' - H')")}

#: A mass that arrives more slowly [m/s] stays on its plate: the bounces left out last about 1e-11 s. One that arrives
#: faster strikes a blow even if its restitution is 0, for the blow moves the body, and rests at once after it.
REST_SPEED = 1e-9


def contact(scene, forms: Forms, side: str):
    """The contact that `scene` asks for on the guide `side`."""
    kind = RigidContact if scene[f"effects.{side}_contact"] == "restitution" else CompliantContact
    return kind(scene, forms, side)


class CompliantContact:
    """A spring and a damper, one-sided.

    With adhesion, as printed, the plate acts while the penetration is positive, and its damper may pull.
    Without, it lets go when its force vanishes: in state `released` the mass is still where
    the plate would be, and the plate follows it back without force.
    """

    initial = "open"
    pressing = "closed"

    def __init__(self, scene, forms: Forms, side: str):
        self.side = side
        self._forms = forms
        self._may_pull = scene["effects.adhesion"] or scene[f"{side}.plate.damping"] == 0.0

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return ("open", "closed") if self._may_pull else ("open", "closed", "released")

    def guards(self, state: str, friction: str, body: tuple[Form, Form]) -> list[Guard]:
        """Guards of `state`; the friction and the body's acceleration do not matter."""
        depth, _ = self._forms.penetration(self.side)
        force = self._forms.plate_force(self.side)
        mass, plate, law = _SYMBOL[self.side]
        apart, within = f"{mass} <= {plate}", f"{mass} >= {plate}"
        if state == "open":
            return [Guard(-depth, to("closed"), apart)]
        if self._may_pull:
            return [Guard(depth, to("open"), within)]
        if state == "closed":
            return [Guard(force, to("released"), f"{law} >= 0")]
        return [Guard(depth, to("open"), within), Guard(-force, to("closed"), f"{law} <= 0")]


class RigidContact:
    """A rigid plate: Newton's restitution, q' - E' becomes -e (q' - E'), and rest on the plate.

    A blow on the inclined plate moves the body by M x' - m3 w' sin(phi) = const, eq. (1), against which
    friction, a finite force or none, can do nothing in no time. A mass whose bounces have died out (`REST_SPEED`)
    rests: it moves with the plate until the force between them vanishes.
    """

    initial = "open"
    pressing = "resting"
    states = ("open", "resting")

    def __init__(self, scene, forms: Forms, side: str):
        self.side = side
        self._scene = scene
        self._forms = forms
        self._restitution = scene[f"{side}.plate.restitution"]

    def guards(self, state: str, friction: str, body: tuple[Form, Form]) -> list[Guard]:
        """Guards of `state`, given the state of the friction and the body's acceleration along x and upwards."""
        mass, plate, _ = _SYMBOL[self.side]
        if state == "resting":
            return [Guard(self._forms.resting_force(self.side, body), to("open"), f"force on {plate} >= 0")]
        depth, _ = self._forms.penetration(self.side)
        return [Guard(-depth, (self._rest(friction), *self._rebounds(friction)), f"{mass} <= {plate}", strike=True)]

    def _rest(self, friction: str) -> Target:
        _, approach = self._forms.penetration(self.side)
        slow = REST_SPEED * self._forms.one - approach
        own, body = self._blow(0.0)
        return Target("resting", own if friction == "stick" else own + body, entry=slow)

    def _rebounds(self, friction: str) -> list[Target]:
        own, body = self._blow(self._restitution)
        if not body or friction in ("grounded", "unloaded"):
            return [Target("open", own + body)]
        ((_, speed),) = body
        return [Target("open", own + body, entry=speed, friction="slip_forward"),
                Target("open", own + body, entry=-speed, friction="slip_backward")]

    def _blow(self, restitution: float) -> tuple[tuple[tuple[int, Form], ...], tuple[tuple[int, Form], ...]]:
        """What a blow changes: the mass, put exactly on its plate, and the body if it moves it."""
        forms, i = self._forms, self._forms.guides.index(self.side)
        plate, _ = forms.plate(self.side)
        _, approach = forms.penetration(self.side)
        change = -(1.0 + restitution) * approach
        own = (forms.channels.position(i), plate), (forms.channels.velocity(i), forms.velocity(i) + change)
        if self.side != "inclined" or not forms.body_moves:
            return own, ()
        share = self._scene["mass.inclined"] * math.sin(self._scene["guide.angle"]) / self._scene.total_mass
        return own, ((forms.channels.velocity(forms.body), forms.velocity(forms.body) + share * change),)
