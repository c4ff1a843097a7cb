"""Contacts of a mass with its plate: compliant, eq. (4), or rigid with restitution.

A contact gives its states, which of them press on the plate, their guards, and the contact force.
"""

from vibro_ros.model.automaton import Guard, Target, to
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.shock import Blow
from vibro_ros.model.symbols import MASS, PLATE, Symbols

#: A mass that arrives more slowly [m/s] stays on its plate: the bounces left out last about 1e-11 s. One that arrives
#: faster strikes a blow even if its restitution is 0, for the blow moves the body, and rests at once after it.
REST_SPEED = 1e-9
#: With a restitution above `ALMOST_LOSSLESS`, neither does one go on bouncing whose spring would end its bounce sooner
#: than `SHORTEST_BOUNCE` [s]: it would rise by F/m T²/8, for 100 g and 20 N 3e-13 m. Bounces that only a damper of the
#: drive makes shorter would become too many ever to be done.
ALMOST_LOSSLESS = 0.999
SHORTEST_BOUNCE = 1e-7


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
        self._law = "" if self._may_pull else Symbols(forms).text(forms.plate_force(side))

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return ("open", "closed") if self._may_pull else ("open", "closed", "released")

    def guards(self, state: str, friction: str, resting: frozenset[str], body: tuple[Form, Form]) -> list[Guard]:
        """Guards of `state`; nothing else matters."""
        depth, _ = self._forms.penetration(self.side)
        force = self._forms.plate_force(self.side)
        mass, plate = MASS[self.side], PLATE[self.side]
        apart, within = f"{mass} <= {plate}", f"{mass} >= {plate}"
        if state == "open":
            return [Guard(-depth, to("closed"), apart)]
        if self._may_pull:
            return [Guard(depth, to("open"), within)]
        if state == "closed":
            return [Guard(force, to("released"), f"{self._law} >= 0")]
        return [Guard(depth, to("open"), within), Guard(-force, to("closed"), f"{self._law} <= 0")]


class RigidContact:
    """A rigid plate: Newton's restitution, q' - E' becomes -e (q' - E'), and rest on the plate.

    A blow (`shock.Blow`) moves the body, too, and by the rule `hop` throws it up. A mass whose bounces have died out
    (`REST_SPEED`) rests, and its last blow leaves the body on the ground: the mass moves with the plate until the force
    between them vanishes, or a shock of the body parts them.
    """

    initial = "open"
    pressing = "resting"
    states = ("open", "resting")

    def __init__(self, scene, forms: Forms, side: str):
        self.side = side
        self._forms = forms
        self._mass = scene[f"mass.{side}"]
        self._restitution = scene[f"{side}.plate.restitution"]
        self._blow = Blow(scene, forms, side)
        self._parts = scene["effects.reaction"]

    def guards(self, state: str, friction: str, resting: frozenset[str], body: tuple[Form, Form]) -> list[Guard]:
        """Guards of `state`, given the state of the friction, the guides whose masses rest, and the body's acceleration
        along x and upwards."""
        mass, plate = MASS[self.side], PLATE[self.side]
        if state == "resting":
            return [Guard(self._forms.resting_force(self.side, body), to("open"), f"force on {plate} >= 0")]
        depth, _ = self._forms.penetration(self.side)
        targets = *self._rest(friction, resting), *self._rebounds(friction)
        return [Guard(-depth, targets, f"{mass} <= {plate}", strike=True)]

    def _rest(self, friction: str, resting: frozenset[str]) -> list[Target]:
        if friction == "airborne":
            body = self._blow.throw(0.0, resting)
        else:
            body = () if friction == "stick" else self._blow.slide(0.0)
        return [Target("resting", self._blow.own(0.0) + body, entries=(slow,)) for slow in self._too_slow()]

    def _too_slow(self) -> list[Form]:
        """Approaches that no bounce follows: where one of these is not negative."""
        forms = self._forms
        _, approach = forms.penetration(self.side)
        slow = [REST_SPEED * forms.one - approach]
        if self._restitution > ALMOST_LOSSLESS:
            push = forms.resting_force(self.side, (forms.zero, forms.zero))
            slow.append(SHORTEST_BOUNCE / 2.0 / self._mass * push - approach)
        return slow

    def _rebounds(self, friction: str) -> list[Target]:
        own = self._blow.own(self._restitution)
        if self._forms.body_hops:
            jumps = own + self._blow.throw(self._restitution)
            return [Target("open", jumps, friction="airborne", parts=self._parts)]
        body = self._blow.slide(self._restitution)
        if not body or friction in ("grounded", "unloaded"):
            return [Target("open", own + body)]
        ((_, speed),) = body
        return [Target("open", own + body, entries=(speed,), friction="slip_forward"),
                Target("open", own + body, entries=(-speed,), friction="slip_backward")]
