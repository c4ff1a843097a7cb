"""A scene: one choice of every parameter and effect, checked as a whole."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from vibro_ros.model.description import describe
from vibro_ros.model.parameters import SCENE_PARAMETERS, Value, checked_parameters, known
from vibro_ros.model.promise import LEAST_SHARE, broken_promise
from vibro_ros.model.rates import fastest_rate, least_inertia

#: Fastest rate [1/s] of a mass on its springs and dampers that is simulated: a step lasts two of its time constants,
#: so 5e6 steps, some ten seconds, a simulated second. 1 g on 1e9 N/m has a rate of 1e6 1/s.
FASTEST_RATE = 1e7

#: Part of a mass's inertia that a yielding body must leave to it, for rounding to leave ten digits of that.
LEAST_INERTIA = 1e-6

# How a machine is started, driven and solved: nothing of its equations, so that what is compiled for one serves a
# sweep over these as well.
_OPERATION = frozenset({
    "effects.motor", "motor.speed", "motor.max_speed", "motor.acceleration", "motor.time_constant", "start.state",
    "upper.gap", "inclined.gap", "gap_actuator.speed",
    "solver.method", "solver.step", "solver.tolerance", "solver.accuracy"})

_BY_NAME = {parameter.name: parameter for parameter in SCENE_PARAMETERS}
_DEFAULTS = {parameter.name: parameter.default for parameter in SCENE_PARAMETERS}


@dataclass(frozen=True)
class Scene:
    """Every parameter of a simulation; immutable.

    Attributes
    ----------
    name : str
        What to call it in logs and recordings.
    parameters : Mapping
        Name to value, complete; SI units. `SCENE_PARAMETERS` describes each.

    Raises
    ------
    ValueError
        If a parameter is unknown, of the wrong type or out of range, or if parameters
        contradict each other; the message names the value, the limit and the remedy.
    """

    name: str = "paper"
    parameters: Mapping[str, Value] = field(default_factory=dict)

    def __post_init__(self):
        complete = _DEFAULTS | checked_parameters(self.parameters, SCENE_PARAMETERS)
        object.__setattr__(self, "parameters", MappingProxyType(complete))
        self._check_mechanism()
        self._check_friction()
        self._check_blows()
        self._check_rates()
        self._check_reaction()
        self._check_tolerance()
        self.checked_motor_speed(self["motor.speed"])
        for side in ("upper", "inclined"):
            self.checked_gap(side, self[f"{side}.gap"])

    def __getitem__(self, name: str) -> Value:
        return self.parameters[known(name, _BY_NAME).name]

    def __reduce__(self):
        return _scene_once_checked, (self.name, dict(self.parameters))

    def __hash__(self):
        return hash((self.name, tuple(self.parameters.values())))

    def with_parameters(self, changes: Mapping[str, object]) -> "Scene":
        """A scene that differs by `changes`, name to value.

        Raises
        ------
        ValueError
            As for the constructor.
        """
        return Scene(self.name, {**self.parameters, **changes}) if changes else self

    def describe(self) -> str:
        """States, equations, guards and events that are really simulated, as text."""
        return describe(self)

    def checked_motor_speed(self, value: object) -> float:
        """`value` as a motor speed [rad/s] that the motor can reach; else a ValueError."""
        limited = replace(_BY_NAME["motor.speed"], maximum=self["motor.max_speed"])
        try:
            return limited.checked(value)
        except ValueError as error:
            raise ValueError(f"{error} (the limit is motor.max_speed)") from None

    def checked_gap(self, side: str, value: object) -> float:
        """`value` as a gap [m] of the `upper` or `inclined` plate within the mechanism; else a ValueError.

        The plate stands at rod + gap from the crank's centre; it must stay on its side of the
        centre and within twice the rod's length.
        """
        rod = self[f"crank.{side}_rod"]
        limited = replace(_BY_NAME[f"{side}.gap"], minimum=-rod, maximum=rod)
        try:
            return limited.checked(value)
        except ValueError as error:
            raise ValueError(f"{error} (the limit is the rod's length)") from None

    def _check_mechanism(self):
        radius = self["crank.radius"]
        for side in ("upper", "inclined"):
            rod = self[f"crank.{side}_rod"]
            if radius > rod:
                raise ValueError(f"crank.radius: {radius:g} m is longer than crank.{side}_rod, {rod:g} m, and would "
                                 f"jam the mechanism; give a radius of at most {rod:g} m or a longer rod")

    def _check_friction(self):
        kinetic = self["ground.friction"]
        if self.resting_friction < kinetic:
            raise ValueError(f"ground.static_friction: {self.resting_friction:g} is below ground.friction, "
                             f"{kinetic:g}; give at least {kinetic:g}")
        self._check_stribeck()
        highest = self._highest_friction()
        if self.has_friction and kinetic >= highest:
            raise ValueError(f"ground.friction: at {kinetic:g} the reaction on the masses has no unique solution while "
                             f"the body slips (Painlevé's paradox); give less than {highest:g}, or set "
                             "effects.reaction to false")

    def _check_stribeck(self):
        """A coefficient that changes with the speed must not make the masses' motion or a landing's shock nonlinear."""
        if self["effects.friction"] != "stribeck":
            return
        if self["effects.reaction"]:
            raise ValueError("effects.friction: 'stribeck' has no exact solution with effects.reaction true, by which "
                             "the friction moves the masses; choose static, or set effects.reaction to false")
        if self["effects.normal_force"] == "hop":
            raise ValueError("effects.friction: 'stribeck' has no exact law for a landing, in which the coefficient "
                             "would change during the shock; choose static, or unilateral for effects.normal_force")

    def _highest_friction(self) -> float:
        """Friction coefficient at which the inertia of the slipping body and its inclined mass becomes singular."""
        sine, cosine = math.sin(self["guide.angle"]), math.cos(self["guide.angle"])
        coupled = self["effects.reaction"] and self["effects.normal_force"] != "weight"
        mass = self["mass.inclined"]
        coupling = mass * sine * abs(cosine)
        if not coupled or "inclined" not in self.guides or coupling == 0.0:
            return math.inf
        return (self.total_mass - mass * sine**2) / coupling

    def _check_blows(self):
        """A rigid blow is an infinite force: not every rule of the normal force gives its friction a meaning."""
        rule, angle, friction = self["effects.normal_force"], self["guide.angle"], self.has_friction
        rigid = [side for side in self.guides if self[f"effects.{side}_contact"] == "restitution"]
        if rigid and friction and rule == "printed":
            raise ValueError("effects.normal_force: 'printed' makes friction drive the body infinitely hard in a blow "
                             "on a rigid plate; choose unilateral or weight, or a compliant contact")
        if "inclined" in rigid and angle > math.pi / 2 and (rule == "hop" or (friction and rule == "unilateral")):
            raise ValueError(f"guide.angle: {angle:g} rad points the inclined guide down, where a blow on its rigid "
                             "plate presses the body on the ground; give at most 1.5708 rad, or a compliant contact")

    def _check_rates(self):
        """A mass that is too light for its springs and dampers would take steps that no one can wait for."""
        for side in self.guides:
            parts = ("spring", "plate") if self[f"effects.{side}_contact"] == "compliant" else ("spring",)
            stiffness = {f"{side}.{part}.stiffness": self[f"{side}.{part}.stiffness"] for part in parts}
            damping = {f"{side}.{part}.damping": self[f"{side}.{part}.damping"] for part in parts}
            # Bounds of the mass from w = sqrt(k / m), and from w < c / m where the damping prevails.
            by_spring, by_damper = sum(stiffness.values()) / FASTEST_RATE**2, sum(damping.values()) / FASTEST_RATE
            lightest, mass = max(by_spring, by_damper), self[f"mass.{side}"]
            if mass < lightest:
                name, value = max((stiffness if by_spring >= by_damper else damping).items(), key=lambda item: item[1])
                raise ValueError(f"{name}: {value:g} {_BY_NAME[name].unit} moves mass.{side}, {mass:g} kg, faster than "
                                 f"{FASTEST_RATE:g} 1/s, which takes too long to simulate; give a mass of at least "
                                 f"{lightest:g} kg, or less stiffness and damping")

    def _check_reaction(self):
        """The same for masses that the reaction of a body lightens, which takes digits of their inertia, too."""
        if not (self["effects.reaction"] and self.guides):
            return
        share, rate = least_inertia(self), fastest_rate(self)
        if share < LEAST_INERTIA:
            found = (f"leaves the masses {share:.2g} of their inertia, less than the {LEAST_INERTIA:g} that rounding "
                     "allows")
        elif rate > FASTEST_RATE:
            found = (f"lets the masses move at {rate:.3g} 1/s, faster than {FASTEST_RATE:g} 1/s, which takes too "
                     "long to simulate")
        else:
            return
        raise ValueError(f"mass.body: {self['mass.body']:g} kg with effects.reaction {found}; give "
                         f"{self._heavier_body()}less ground.friction, stiffness and damping, or set effects.reaction "
                         "to false")

    def _heavier_body(self) -> str:
        """The least body, to a factor of two, that yields little enough, as part of a sentence; empty if none does."""
        mass = self["mass.body"]
        while (mass := 2.0 * mass) <= _BY_NAME["mass.body"].maximum:
            heavier = _unchecked("", {**self.parameters, "mass.body": mass})
            if least_inertia(heavier) >= LEAST_INERTIA and fastest_rate(heavier) <= FASTEST_RATE:
                return f"at least {mass:.2g} kg, "
        return ""

    def _check_tolerance(self):
        """A promise that rounding does not let `exact` keep is refused; of the default `Simulator` warns."""
        if self["solver.tolerance"] != _DEFAULTS["solver.tolerance"] and (fault := broken_promise(self)):
            raise ValueError(fault)
        length = max((self[f"crank.{side}_rod"] for side in self.guides), default=0.0)
        if self["solver.accuracy"] < LEAST_SHARE * length:
            raise ValueError(f"solver.accuracy: {self['solver.accuracy']:g} m is below what rounding allows with rods "
                             f"of {length:g} m; give at least {LEAST_SHARE * length:g} m")

    @property
    def machine(self) -> "Scene":
        """What is compiled: this scene without a name and without the parameters of its operation, so that to read one
        of these where it would be compiled is a KeyError."""
        return _unchecked("", {name: value for name, value in self.parameters.items() if name not in _OPERATION})

    @property
    def total_mass(self) -> float:
        """M = m1 + m2 + m3 [kg], of the masses that the scene has."""
        return math.fsum(self[f"mass.{part}"] for part in ("body", *self.guides))

    @property
    def resting_friction(self) -> float:
        """Friction coefficient of a body at rest: the laws `static` and `stribeck` have one of its own."""
        own = self["effects.friction"] in ("static", "stribeck")
        return self["ground.static_friction" if own else "ground.friction"]

    @property
    def has_friction(self) -> bool:
        """Whether the ground can rub: not without a coefficient, nor where the rule `weight` has nothing to weigh."""
        weightless = self["effects.normal_force"] == "weight" and self["gravity"] == 0.0
        return self["effects.friction"] != "none" and self.resting_friction > 0.0 and not weightless

    @property
    def guides(self) -> tuple[str, ...]:
        """The guides whose masses the scene has: `upper`, `inclined`."""
        return tuple(side for side in ("upper", "inclined") if self[f"effects.{side}_mass"])

    @property
    def plates(self) -> tuple[str, ...]:
        """The guides whose masses can meet a plate; a compliant one without stiffness and damping is none."""
        return tuple(side for side in self.guides if self._has_plate(side))

    def _has_plate(self, side: str) -> bool:
        kind = self[f"effects.{side}_contact"]
        return kind == "restitution" or (
            kind == "compliant" and any(self[f"{side}.plate.{part}"] for part in ("stiffness", "damping")))


def _scene_once_checked(name: str, parameters: dict[str, Value]) -> Scene:
    """A pickled scene as it was: handed to another process, it is not checked again."""
    return _unchecked(name, _DEFAULTS | parameters)


def _unchecked(name: str, parameters: dict[str, Value]) -> Scene:
    scene = object.__new__(Scene)
    object.__setattr__(scene, "name", name)
    object.__setattr__(scene, "parameters", MappingProxyType(parameters))
    return scene
