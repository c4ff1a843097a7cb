"""Values of a scene's parameters, and what follows from them: the parts of the robot, and the accuracy that rounding
permits.

The position of a plate is rounded to eps L, where L is the longer rod. In a contact that lasts pi/w, w² = k/m, the
force k eps L changes a mass's speed by some w eps L. Stiffer plates are also struck more often: at the start, where a
mass bounces on the plate on which its spring presses it, the number of blows grows with w, and the error grows with a
power of w between two and three. Over 0.2 s of the shipped scenes, with plates of 1e5 to 1e11 N/m, one unit in the
last place of a parameter moves the positions by no more than

    eps L (w T)^2.5,    T = 7.5 ms

(test_promise.py). Dampers reduce the error; a motion that grazes a plate, or is chaotic, enlarges every rounding
error.
"""

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from vibro_ros.model.parameters import AS_FORWARD, BY_NAME, Value, parameter_named

LEAST_SHARE = 1e-12  # least error as a part of the rods' length: 4500 times the rounding of a number
_TIME = 7.5e-3  # s
#: A component of a direction below this is rounding of its angle, which is at most π.
_ANGLE_ROUNDING = 2.0 * math.pi * np.finfo(float).eps


@dataclass(frozen=True)
class ParameterValues:
    """A value for each parameter, unchecked; a `Scene`, which has the same attributes, is checked."""

    name: str = "paper"
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Value:
        try:
            return self.parameters[name]
        except KeyError:
            parameter_named(name, BY_NAME)  # a ValueError if there is no such parameter
            raise

    @functools.cached_property
    def total_mass(self) -> float:
        """M [kg]: m1 plus those of m2, m3 and the linkage's masses that the scene has."""
        return math.fsum([*(self[f"mass.{part}"] for part in ("body", *self.guides)),
                          *(self[f"mass.{part}"] for part in self.linkage)])

    @functools.cached_property
    def linkage(self) -> tuple[str, ...]:
        """The parts of the linkage that have a mass: sliders of the guides that the scene has, and the crank pin."""
        return tuple(part for part in (*(f"{side}_slider" for side in self.guides), "crank_pin")
                     if self[f"mass.{part}"] > 0.0)

    @property
    def has_rotor(self) -> bool:
        """Whether the crank's angle is a coordinate, not a given function of time: with a dc motor."""
        return self.parameters.get("effects.motor") == "dc"  # `Scene.machine` has this parameter only then

    @functools.cached_property
    def crank_is_struck(self) -> bool:
        """Whether a shock of the body changes the crank's speed: with a dc motor, masses of the linkage, and the
        reaction on the masses."""
        return bool(self.has_rotor and self.linkage and self["effects.reaction"])

    @property
    def motor_command(self) -> str:
        """Argument of `Simulator.command` that commands the motor: its speed, or a dc motor's voltage."""
        by_voltage = self.has_rotor and self["motor.control"] == "voltage"
        return "motor_voltage" if by_voltage else "motor_speed"

    @property
    def motor_constant(self) -> float:
        """K [N·m/A = V·s]: torque at the crank over current, and voltage over the crank's speed."""
        return self["motor.gear_ratio"] * self["motor.torque_constant"]

    @property
    def motor_inertia(self) -> float:
        """J [kg m²], inertia of the rotor and of `motor.crank_inertia`, at the crank."""
        ratio = self["motor.gear_ratio"]
        return ratio * ratio * self["motor.rotor_inertia"] + self["motor.crank_inertia"]

    @functools.cached_property
    def kinetic_frictions(self) -> tuple[float, float]:
        """Friction coefficients of a body that moves forwards and backwards."""
        forward, backward = self["ground.friction"], self["ground.friction_backward"]
        return forward, forward if backward == AS_FORWARD else backward

    @functools.cached_property
    def resting_frictions(self) -> tuple[float, float]:
        """Friction coefficients that hold a body at rest against a push forwards and backwards.

        By the laws `static` and `stribeck` both are `ground.static_friction`.
        """
        has_static_law = self["effects.friction"] in ("static", "stribeck")
        return (self["ground.static_friction"],) * 2 if has_static_law else self.kinetic_frictions

    @property
    def slipping_frictions(self) -> set[float]:
        """Limits of the friction coefficient of a slipping body; negative if the body moves backwards."""
        forward, backward = self.kinetic_frictions
        limits = {forward, -backward}
        if self["effects.friction"] == "stribeck":
            limits |= {self["ground.static_friction"], -self["ground.static_friction"]}
        return limits

    @functools.cached_property
    def has_dry_friction(self) -> bool:
        """Whether there is dry friction: not with a coefficient of 0, nor with the rule `weight` without gravity."""
        weightless = self["effects.normal_force"] == "weight" and self["gravity"] == 0.0
        return self["effects.friction"] != "none" and max(self.resting_frictions) > 0.0 and not weightless

    @functools.cached_property
    def gravity(self) -> tuple[float, float]:
        """Gravitational acceleration [m/s²], backwards along the ground and towards it: g sin(α) and g cos(α)."""
        from vibro_ros.solver.elementary import cos, sin  # imports compiled code, which readers of bags do not need

        slope = self["ground.slope"]
        return self["gravity"] * sin(slope), self["gravity"] * cos(slope)

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
        return self._directions[side]

    @functools.cached_property
    def _directions(self) -> dict[str, tuple[float, float]]:
        from vibro_ros.solver.elementary import cos, sin  # as in `gravity`

        directions = {}
        for side in ("upper", "inclined"):
            along_x, upwards = -sin(self.guide_angle(side)), cos(self.guide_angle(side))
            directions[side] = (0.0 if abs(along_x) < _ANGLE_ROUNDING else along_x,
                                0.0 if abs(upwards) < _ANGLE_ROUNDING else upwards)
        return directions

    @functools.cached_property
    def ground_laws(self) -> dict["GroundForce", tuple[float, float, float]]:
        """The forces of `GROUND_FORCES` that the scene has, each with its F0 [N], c [N s/m] and k [N/m]."""
        laws = {force: force.law(self) for force in GROUND_FORCES}
        return {force: law for force, law in laws.items() if any(law)}

    @functools.cached_property
    def body_moves(self) -> bool:
        """Whether a force other than dry friction acts along the ground; a mass on an upright guide exerts none."""
        leans = "inclined" in self.guides and self.direction("inclined")[0] != 0.0
        return bool(self.ground_laws) or leans or "crank_pin" in self.linkage

    @property
    def body_is_dynamic(self) -> bool:
        """Whether the body's own position or speed enters its equation, by a force of the ground."""
        return any(damping or stiffness for _, damping, stiffness in self.ground_laws.values())

    @property
    def body_hops(self) -> bool:
        """Whether the body may leave the ground."""
        return self["effects.normal_force"] == "hop" and bool(self.guides or self.linkage)

    @functools.cached_property
    def plates(self) -> tuple[str, ...]:
        """The guides with a plate; a compliant plate without stiffness and damping is no plate."""
        kinds = {side: self[f"effects.{side}_contact"] for side in self.guides}
        return tuple(side for side, kind in kinds.items() if kind == "restitution" or (
            kind == "compliant" and any(self[f"{side}.plate.{part}"] for part in ("stiffness", "damping"))))

    def deepest_penetration(self, side: str) -> float:
        """Deepest penetration of a plate [m] that a blow can cause; 0 for a rigid plate, infinite without stiffness.

        It stores the energy m v²/2 of the mass in the plate's spring. The speed v is more than the machine can give a
        mass: the sum of the slider's speed at `motor.max_speed` with a rod as short as the crank, the speed that the
        drive's spring gives when it is stretched by the guide's length, twice the rod, and that of a fall over it.
        """
        mass, length, stiffness = self[f"mass.{side}"], 2.0 * self[f"crank.{side}_rod"], self[f"{side}.plate.stiffness"]
        if self[f"effects.{side}_contact"] == "restitution":
            return 0.0
        speed = (2.0 * self["crank.radius"] * self["motor.max_speed"] + math.sqrt(2.0 * self["gravity"] * length)
                 + length * math.sqrt(self[f"{side}.spring.stiffness"] / mass))
        return speed * math.sqrt(mass / stiffness) if stiffness else math.inf

    @property
    def longest_rod(self) -> float:
        """The longest rod that moves a mass [m]; 0 without any."""
        return max((self[f"crank.{side}_rod"] for side in self.guides), default=0.0)

    @property
    def attainable_accuracy(self) -> float:
        """Error of a position [m] that rounding may cause within 0.2 s."""
        fastest = max((math.sqrt(self[f"{side}.plate.stiffness"] / self[f"mass.{side}"])
                       for side in self.plates if self[f"effects.{side}_contact"] == "compliant"), default=0.0)
        turns = fastest * _TIME
        by_plates = float(np.finfo(float).eps) * turns * turns * math.sqrt(turns)
        return self.longest_rod * max(LEAST_SHARE, by_plates)

    @property
    def broken_promise(self) -> str:
        """Message why rounding keeps the method `exact` from meeting `solver.tolerance`; empty if it can."""
        tolerance, attainable = self["solver.tolerance"], self.attainable_accuracy
        if tolerance >= attainable:
            return ""
        return (f"solver.tolerance: {tolerance:g} m is below what rounding allows with these rods and plates; give at "
                f"least {rounded_up(attainable):g} m, or softer plates")


class GroundForce(NamedTuple):
    """A force of the ground on the body, F = F0 + c x' + k x against forward motion, on the ground and above it.

    F0, c and k decide all else: whether x is a coordinate and dynamic, the equation of x, the guards of a body that
    sticks, the energy, and what `Scene.describe()` says. To add a force, add a row here and its parameter.
    """

    symbol: str  # symbol in `Scene.describe()`
    parameter: str  # the number that decides the force; without it the force is absent
    # returns F0 [N], c [N s/m] and k [N/m] for the values of a scene's parameters
    law: Callable[[ParameterValues], tuple[float, float, float]]
    # the energy account of the work of F0 and c x'. Empty for a constant force that stores energy, as a weight does.
    # The energy k x²/2 of a spring is always stored.
    account: str = ""


#: Every force of the ground along x except dry friction, which states and guards decide.
GROUND_FORCES = (
    # The weight of body and masses down a slope on which x points uphill.
    GroundForce("F_g", "ground.slope", lambda values: (values.total_mass * values.gravity[0], 0.0, 0.0)),
    GroundForce("F_v", "ground.viscous_friction", lambda values: (0.0, values["ground.viscous_friction"], 0.0),
                "friction"),
    GroundForce("F_0", "ground.drag", lambda values: (values["ground.drag"], 0.0, 0.0), "friction"),
)


def rounded_up(number: float) -> float:
    """Return the least number of two digits that is not below `number`, so that a message's number is accepted."""
    digit = float(f"1e{int(f'{number:e}'.partition('e')[2]) - 1}")
    return float(f"{math.ceil(number / digit * (1.0 - 1e-9)) * digit:.2g}")
