"""Values of a scene's parameters, and what follows from them."""

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vibro_ros.model.parameters import BY_NAME, Value, parameter_named
from vibro_ros.model.promise import attainable_accuracy, broken_promise
from vibro_ros.model.rates import YieldingMasses

#: Parts of a direction that are rounding of its angle, which is at most π.
_ANGLE_ROUNDING = 2.0 * math.pi * np.finfo(float).eps


@dataclass(frozen=True)
class ParameterValues:
    """A value for each parameter, as it is given; `Scene` has checked them against each other.

    Attributes
    ----------
    name : str
        Name of the scene in logs and recordings.
    parameters : Mapping
        Name to value; SI units. `SCENE_PARAMETERS` describes each.
    """

    name: str = "paper"
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Value:
        if name not in self.parameters:
            parameter_named(name, BY_NAME)  # a ValueError if there is no such parameter
        return self.parameters[name]

    @functools.cached_property
    def total_mass(self) -> float:
        """M = m1 + m2 + m3 [kg], of the masses that the scene has."""
        return math.fsum(self[f"mass.{part}"] for part in ("body", *self.guides))

    @property
    def resting_friction(self) -> float:
        """Friction coefficient of a body at rest, which has its own parameter by the laws `static` and `stribeck`."""
        own = self["effects.friction"] in ("static", "stribeck")
        return self["ground.static_friction" if own else "ground.friction"]

    @property
    def has_friction(self) -> bool:
        """Whether there is friction: not with a coefficient of 0, nor with the rule `weight` without gravity."""
        weightless = self["effects.normal_force"] == "weight" and self["gravity"] == 0.0
        return self["effects.friction"] != "none" and self.resting_friction > 0.0 and not weightless

    @functools.cached_property
    def guides(self) -> tuple[str, ...]:
        """The guides whose masses the scene has: `upper`, `inclined`."""
        return tuple(side for side in ("upper", "inclined") if self[f"effects.{side}_mass"])

    def guide_angle(self, side: str) -> float:
        """Angle of a guide from the vertical [rad]: 0 for `upper`, φ for `inclined`."""
        return self["guide.angle"] if side == "inclined" else 0.0

    def direction(self, side: str) -> tuple[float, float]:
        """Direction of a guide, outwards: its parts along x and upwards, e = (-sin(φ), cos(φ)) for `inclined`.

        A part that is only rounding is 0, because an angle of π/2 means level and one of π upright.
        """
        return _direction(self.guide_angle(side))

    @property
    def body_moves(self) -> bool:
        """Whether anything drives the body along the ground: not an upper mass, nor a mass on an upright guide."""
        return "inclined" in self.guides and self.direction("inclined")[0] != 0.0

    @property
    def body_hops(self) -> bool:
        """Whether the body may leave the ground."""
        return self["effects.normal_force"] == "hop" and bool(self.guides)

    @functools.cached_property
    def plates(self) -> tuple[str, ...]:
        """The guides with a plate; a compliant plate without stiffness and damping is no plate."""
        return tuple(side for side in self.guides if self._has_plate(side))

    def _has_plate(self, side: str) -> bool:
        kind = self[f"effects.{side}_contact"]
        return kind == "restitution" or (
            kind == "compliant" and any(self[f"{side}.plate.{part}"] for part in ("stiffness", "damping")))

    def yielding_masses(self) -> YieldingMasses:
        """The numbers that decide how fast the masses move while the body yields to them."""
        rule, shape = self["effects.normal_force"], (len(self.guides), 2)
        compliant = [side for side in self.plates if self[f"effects.{side}_contact"] == "compliant"]
        drives, plates = ([[self[f"{side}.{part}.stiffness"], self[f"{side}.{part}.damping"]] for side in self.guides]
                          for part in ("spring", "plate"))
        plates = [plate if side in compliant else [0.0, 0.0] for side, plate in zip(self.guides, plates, strict=True)]
        return YieldingMasses(
            masses=np.array([self[f"mass.{side}"] for side in self.guides]),
            directions=np.reshape([self.direction(side) for side in self.guides], shape),
            drives=np.reshape(drives, shape), plates=np.reshape(plates, shape), total_mass=self.total_mass,
            slip_friction=self["ground.friction"] if self.has_friction and rule != "weight" else 0.0,
            leaves_ground=rule == "hop")

    @property
    def longest_rod(self) -> float:
        """The longest rod that moves a mass [m]; 0 without any."""
        return max((self[f"crank.{side}_rod"] for side in self.guides), default=0.0)

    @property
    def attainable_accuracy(self) -> float:
        """Error of a position [m] within 0.2 s that the rounding of numbers may leave."""
        rates = (math.sqrt(self[f"{side}.plate.stiffness"] / self[f"mass.{side}"])
                 for side in self.plates if self[f"effects.{side}_contact"] == "compliant")
        return attainable_accuracy(self.longest_rod, max(rates, default=0.0))

    @property
    def broken_promise(self) -> str:
        """Why rounding does not let the method `exact` keep `solver.tolerance`; empty if the promise holds."""
        return broken_promise(self["solver.tolerance"], self.attainable_accuracy)


@functools.lru_cache(maxsize=64)
def _direction(angle: float) -> tuple[float, float]:
    along_x, upwards = (0.0 if abs(part) < _ANGLE_ROUNDING else part for part in (-math.sin(angle), math.cos(angle)))
    return along_x, upwards
