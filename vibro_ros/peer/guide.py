"""heyoka's run-time parameters by name, and the constants and expressions of a guide, for the equations."""

from dataclasses import dataclass

import heyoka as hy

#: The first run-time parameters: they decide how the body moves (`Equations.body_parameters`).
BODY_PARAMETERS = ("slide", "direction", "mobility", "stick", "slip", "air")


class RunTimeParameters:
    """heyoka's run-time parameters by name; heyoka itself numbers them.

    Attributes
    ----------
    number : dict of str to int
        Number of each parameter that has been asked for.
    """

    def __init__(self):
        self.number = {name: number for number, name in enumerate(BODY_PARAMETERS)}

    def __getitem__(self, name: str) -> hy.expression:
        return hy.par[self.number.setdefault(name, len(self.number))]


@dataclass(frozen=True)
class Guide:
    """One mass on its guide.

    Attributes
    ----------
    side : str
        `upper` or `inclined`.
    angle : float
        Angle of the guide from the vertical [rad].
    mass : float
        The mass [kg].
    kind : str
        Kind of the contact: `none`, `compliant` or `restitution`.
    rod : float
        Length of the rod [m].
    plate_stiffness, plate_damping : float
        Spring [N/m] and damper [N·s/m] of the plate.
    restitution : float
        Restitution of a rigid plate, dimensionless.
    watches_force : bool
        Whether the plate lets go where its force is zero, instead of where the depth is zero.
    has_kink : bool
        Whether the slider's speed jumps, because crank and rod are equally long.
    depth, rate : expression
        d [m] and d' [m/s].
    load : expression
        Force along the guide [N] without the body's acceleration, that of the plate included.
    push : expression
        k d + c d' of the plate [N].
    crank : expression
        Cosine of the crank angle from the guide, whose zeros are the slider's kinks.
    """

    side: str
    angle: float
    mass: float
    kind: str
    rod: float
    plate_stiffness: float
    plate_damping: float
    restitution: float
    watches_force: bool
    has_kink: bool
    depth: hy.expression
    rate: hy.expression
    load: hy.expression
    push: hy.expression
    crank: hy.expression
