"""Compliant one-sided plates, eq. (4)."""

from vibro_ros.model.automaton import Guard
from vibro_ros.model.forms import Forms

_SYMBOL = {"upper": ("u", "E", "k4 (u - E) + c4 (u' - E')"), "inclined": ("w", "H", "k1 (w - H) + c1 (w' - H')")}


class Contact:
    """Contact of one mass with its plate.

    With adhesion, as printed, the plate acts while the penetration is positive, and its damper may pull.
    Without, it lets go when its force vanishes: in state `released` the mass is still where
    the plate would be, and the plate follows it back without force.
    """

    initial = "open"

    def __init__(self, scene, forms: Forms, side: str):
        self.name = f"{side}_contact"
        self.side = side
        self._forms = forms
        self._may_pull = scene["effects.adhesion"] or scene[f"{side}.plate.damping"] == 0.0

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return ("open", "closed") if self._may_pull else ("open", "closed", "released")

    def guards(self, state: str) -> list[Guard]:
        """Guards of `state`."""
        depth, _ = self._forms.penetration(self.side)
        force = self._forms.plate_force(self.side)
        mass, plate, law = _SYMBOL[self.side]
        apart, within = f"{mass} <= {plate}", f"{mass} >= {plate}"
        if state == "open":
            return [Guard(-depth, ("closed",), apart)]
        if self._may_pull:
            return [Guard(depth, ("open",), within)]
        if state == "closed":
            return [Guard(force, ("released",), f"{law} >= 0")]
        return [Guard(depth, ("open",), within), Guard(-force, ("closed",), f"{law} <= 0")]
