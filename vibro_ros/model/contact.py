"""Contacts of a mass with its plate: compliant, eq. (4), or rigid with restitution.

A contact gives its states and the guards of each state.
"""

from vibro_ros.model.forms import MASS, PLATE, Form, Forms, Guard, Target, without_jump
from vibro_ros.model.scene import Scene
from vibro_ros.model.shock import REST_SPEED, Blow

#: With a restitution above `ALMOST_LOSSLESS`, a mass also rests if its next bounce would last less than
#: `SHORTEST_BOUNCE` [s]. The mass would rise by F/m T²/8, 3e-13 m for 100 g and 20 N. Without this rule, bounces that
#: only a damper of the drive makes shorter would become too many to simulate.
ALMOST_LOSSLESS = 0.999
SHORTEST_BOUNCE = 1e-7


class CompliantContact:
    """A one-sided spring and damper.

    With adhesion, as printed, the plate acts while the penetration is positive, and the plate's damper may pull.
    Without adhesion the plate lets go when its force vanishes. In the state `released` the penetration is still
    positive, and the plate follows the mass back without force.
    """

    def __init__(self, scene: Scene, forms: Forms, side: str):
        self.side = side
        self._forms = forms
        self._may_pull = scene["effects.adhesion"] or scene[f"{side}.plate.damping"] == 0.0
        self.states = ("open", "closed") if self._may_pull else ("open", "closed", "released")

    def guards(self, state: str, ground: str, resting: frozenset[str], body: tuple[Form, Form]) -> list[Guard]:
        """Guards of `state`."""
        depth, _ = self._forms.penetration(self.side)
        force = self._forms.plate_force(self.side)
        mass, plate = MASS[self.side], PLATE[self.side]
        apart, within = f"{mass} <= {plate}", f"{mass} >= {plate}"
        if state == "open":
            return [Guard(-depth, without_jump("closed"), apart)]
        if self._may_pull:
            return [Guard(depth, without_jump("open"), within)]
        if state == "closed":
            return [Guard(force, without_jump("released"), "{force} >= 0")]
        return [Guard(depth, without_jump("open"), within),
                Guard(-force, without_jump("closed"), "{force} <= 0")]


class RigidContact:
    """A rigid plate: Newton's restitution, q' - E' becomes -e (q' - E'), and rest on the plate.

    A blow (`shock.Blow`) also moves the body, and throws the body up by the rule `hop`. A mass rests when its bounces
    have died out (`REST_SPEED`): the mass moves with the plate until the force between them vanishes, or until a shock
    of the body parts them. The last blow, after which the mass rests, leaves the body on the ground.
    """

    states = ("open", "resting")

    def __init__(self, scene: Scene, forms: Forms, side: str):
        self.side = side
        self._forms = forms
        self._mass = scene[f"mass.{side}"]
        self._restitution = scene[f"{side}.plate.restitution"]
        self._blow = Blow(scene, forms, side)
        self._masses_feel_body = scene["effects.reaction"]

    @staticmethod
    def context(ground: str, resting: frozenset[str]) -> tuple:
        """Return the states of other effects on which the guards depend: the ground, and in the air masses at rest."""
        return ground, resting if ground == "airborne" else frozenset()

    def guards(self, state: str, ground: str, resting: frozenset[str], body: tuple[Form, Form]) -> list[Guard]:
        """Guards of `state`; `body` is the body's acceleration along x and upwards [m/s²]."""
        mass, plate = MASS[self.side], PLATE[self.side]
        if state == "resting":
            force = self._forms.resting_force(self.side, body)
            return [Guard(force, without_jump("open"), f"force on {plate} >= 0")]
        depth, _ = self._forms.penetration(self.side)
        targets = *self._rests(ground, resting), *self._rebounds(ground)
        return [Guard(-depth, targets, f"{mass} <= {plate}", is_blow=True)]

    def _rests(self, ground: str, resting: frozenset[str]) -> list[Target]:
        forms, thrown = self._forms, ground == "airborne"
        _, approach = forms.penetration(self.side)
        slow = [REST_SPEED * forms.one - approach]  # forms [m/s]; the mass rests if one of them is not negative
        if self._restitution > ALMOST_LOSSLESS:
            push = forms.resting_force(self.side, (forms.zero, forms.zero))
            slow.append(SHORTEST_BOUNCE / 2.0 / self._mass * push - approach)
        if forms.crank_is_struck and (thrown or (ground != "stick" and self._blow.moves_sliding_body())):
            shock = self._blow.of_struck_crank(0.0, thrown, 1, resting)
            return [target for form in slow for target in shock.targets(forms, ["resting"], entries=(form,))]
        if thrown:
            body = self._blow.thrown_body_jumps(0.0, resting)
        else:
            body = () if ground == "stick" else self._blow.sliding_body_jumps(0.0)
        return [Target("resting", self._blow.mass_jumps(0.0) + body, entries=(form,)) for form in slow]

    def _rebounds(self, ground: str) -> list[Target]:
        """Return the targets of a mass that bounces; the body is thrown up, slips on, or begins to slip."""
        forms, mass, any_way = self._forms, self._blow.mass_jumps(self._restitution), ground in ("grounded", "unloaded")
        if forms.body_hops:
            if forms.crank_is_struck:
                shock = self._blow.of_struck_crank(self._restitution, True, 1, frozenset())
                return shock.targets(forms, ["open"], ground="airborne", frees_resting_masses=True)
            jumps = mass + self._blow.thrown_body_jumps(self._restitution)
            return [Target("open", jumps, ground="airborne", frees_resting_masses=self._masses_feel_body)]
        if forms.crank_is_struck and self._blow.moves_sliding_body():
            grounds = (None,) if any_way else ("slip_forward", "slip_backward")
            shock = self._blow.of_struck_crank(self._restitution, False, len(grounds), frozenset())
            return [target for state in grounds for target in shock.targets(forms, ["open"], ground=state)]
        body = self._blow.sliding_body_jumps(self._restitution)
        if not body or any_way:
            return [Target("open", mass + body)]
        ((_, speed),) = body
        return [Target("open", mass + body, entries=(speed,), ground="slip_forward"),
                Target("open", mass + body, entries=(-speed,), ground="slip_backward")]


def make_contact(scene: Scene, forms: Forms, side: str) -> CompliantContact | RigidContact:
    """Return the contact that `scene` asks for on the guide `side`."""
    kind = RigidContact if scene[f"effects.{side}_contact"] == "restitution" else CompliantContact
    return kind(scene, forms, side)
