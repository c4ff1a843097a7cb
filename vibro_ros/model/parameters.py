"""Every parameter of a scene, once: name, default, unit, range, meaning.

YAML loading, ROS declarations, validation messages and the table in the documents are all made from `SCENE_PARAMETERS`.
Defaults are the paper's values.
"""

import difflib
import math
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

#: Value of a parameter, of the type of its default: bool, float, str, tuple of str, or tuple of as many floats. It is
#: `Any`, because only the parameter's name decides the type.
Value = Any

#: A number of a scene that is smaller in magnitude, in its unit, counts as zero, so that products and quotients of
#: the numbers stay far from 2e-308, where doubles lose their digits. At this speed a crank turns by 4e-13 rad in the
#: age of the Universe.
NEGLIGIBLE = 1e-30


AS_FORWARD = -1.0  # value of `ground.friction_backward` that stands for the coefficient of forward motion
AS_PRESET = -1.0  # value of a sensor's parameter that stands for the number in `sensors.preset`
LONGEST_QUOTE = 200  # most characters of a user's value that a message repeats


def quoted(value: object) -> str:
    """`value` as Python writes it, for a message: in one line, and without its middle if it is long."""
    text = repr(value)
    return text if len(text) <= LONGEST_QUOTE else f"{text[:LONGEST_QUOTE // 2]}…{text[-LONGEST_QUOTE // 2:]}"


@dataclass(frozen=True)
class Parameter:
    """One parameter."""

    name: str  # dotted, the same in YAML, in ROS and in Python
    default: Value  # of the parameter's type; a list of numbers always has as many as the default
    unit: str  # SI unit, empty for pure numbers and choices
    description: str  # one line for users
    minimum: float = -math.inf  # inclusive limit of a number, or of each of a list, in its unit
    maximum: float = math.inf
    positive: bool = False  # whether zero is excluded although `minimum` is 0
    choices: tuple[str, ...] = ()  # allowed values of a text; empty if any text will do
    while_running: bool = False  # whether the parameter may change while the device runs
    negligible: float = 0.0  # a number of smaller magnitude, in its unit, counts as zero
    smallest: float = 0.0  # least number other than 0, in its unit, where 0 is allowed and has a meaning of its own

    @property
    def type_name(self) -> str:
        """Name of the type as a user writes it."""
        if self.is_numbers:
            return f"a list of {len(self.default)} numbers"
        return {bool: "true or false", float: "a number", str: "a text", tuple: "a list of texts"}[type(self.default)]

    @property
    def is_numbers(self) -> bool:
        """Whether the parameter is a list of numbers."""
        return isinstance(self.default, tuple) and isinstance(self.default[0], float)

    def checked(self, value: object) -> Value:
        """Return `value` as this parameter's type.

        ValueError for a wrong type, a number that is not finite or out of range, or an unknown choice; the message
        names the value, the limit and the remedy.
        """
        if isinstance(self.default, float):
            return self._checked_number(value)
        if self.is_numbers:
            if not isinstance(value, Sequence | array) or isinstance(value, str) or len(value) != len(self.default):
                raise ValueError(f"{self.name}: {quoted(value)} is not {self.type_name}; give {self.type_name}")
            return tuple(map(self._checked_number, value))
        if isinstance(self.default, tuple):
            if not isinstance(value, (list, tuple)) or not all(isinstance(text, str) for text in value):
                raise ValueError(f"{self.name}: {quoted(value)} is not {self.type_name}; write [one, another]")
            if not value:
                raise ValueError(f"{self.name}: its list is empty, which has no type in ROS; write "
                                 f"[{', '.join(self.default)}], or leave it out")
            return tuple(value)
        if type(value) is not type(self.default):
            raise ValueError(f"{self.name}: {quoted(value)} is not {self.type_name}; "
                             f"give {self.type_name}{self._hint()}")
        if self.choices and value not in self.choices:
            raise ValueError(f"{self.name}: {quoted(value)} is unknown; choose one of {', '.join(self.choices)}")
        return value

    def _checked_number(self, value: Any) -> float:
        """`value` as a number within the limits, or as 0 if its magnitude is negligible."""
        if isinstance(value, (bool, str)) or not hasattr(value, "__float__"):
            raise ValueError(f"{self.name}: {quoted(value)} is not a number; give a number{self._hint()}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf if value > 0 else -math.inf
        except (TypeError, ValueError):  # an array of several numbers has __float__, too
            raise ValueError(f"{self.name}: {quoted(value)} is not a number; give a number{self._hint()}") from None
        if not math.isfinite(number):
            raise ValueError(f"{self.name}: {number} is not finite; give a number{self._hint()}")
        counted = 0.0 if abs(number) < self.negligible else number + 0.0  # no -0.0
        outside = counted < self.minimum or counted > self.maximum or 0.0 < counted < self.smallest
        if outside or (self.positive and counted == 0.0):
            zero = f" counts as 0, as all below {self.negligible:g}, which" if counted != number else ""
            raise ValueError(f"{self.name}: {number:g}{zero} is out of range; give a number{self._hint()}")
        return counted

    def _hint(self) -> str:
        """Return the allowed values, as the end of a sentence."""
        unit = f" {self.unit}" if self.unit else ""
        if self.choices:
            return f", one of {', '.join(self.choices)}"
        low, high = math.isfinite(self.minimum), math.isfinite(self.maximum)
        above = "above" if self.positive else "from"
        if self.smallest:
            return f", 0 or from {self.smallest:g} to {self.maximum:g}{unit}"
        if low and high:
            return f" {above} {self.minimum:g} to {self.maximum:g}{unit}"
        if low:
            return f" {'above' if self.positive else 'of at least'} {self.minimum:g}{unit}"
        return unit and f" in{unit}"


def _mass(name: str, default: float, what: str) -> Parameter:
    return Parameter(name, default, "kg", f"mass of {what}", minimum=0.0, maximum=1e6, positive=True)


def _length(name: str, default: float, what: str) -> Parameter:
    return Parameter(name, default, "m", what, minimum=0.0, maximum=1e3, positive=True)


def _guide(side: str, spring: str, plate: str, plate_at: str) -> tuple[Parameter, ...]:
    """Drive spring, plate and gap of one guide; `spring` and `plate` are the paper's indices."""
    return (
        Parameter(f"{side}.spring.stiffness", 1e3, "N/m", f"drive spring k{spring}, slider to mass",
                  minimum=0.0, maximum=1e9),
        Parameter(f"{side}.spring.damping", 0.0, "N·s/m", f"drive damper c{spring}", minimum=0.0, maximum=1e6),
        Parameter(f"{side}.plate.stiffness", 1e7, "N/m", f"plate spring k{plate}, one-sided",
                  minimum=0.0, maximum=1e12),
        Parameter(f"{side}.plate.damping", 0.0, "N·s/m", f"plate damper c{plate}", minimum=0.0, maximum=1e6),
        Parameter(f"{side}.plate.restitution", 0.8, "", "rebound speed over approach speed of a rigid plate",
                  minimum=0.0, maximum=1.0),
        Parameter(f"{side}.gap", 0.0, "m",
                  f"clearance at the slider's mid-stroke; the plate stands at {plate_at} = rod + gap",
                  minimum=-1e3, maximum=1e3),
    )


def _start(name: str, unit: str, what: str, minimum: float = -1e6, maximum: float = 1e6) -> Parameter:
    """Return a number of a given start, limited to 1e6, because the square of a larger one would swamp other terms."""
    return Parameter(f"start.{name}", 0.0, unit, f"at t = 0 with start.state given: {what}", minimum, maximum)


def _rate(sensor: str, what: str) -> Parameter:
    return Parameter(f"sensors.{sensor}.rate", 0.0, "Hz", f"measurements a second of {what}; 0: off, at no cost",
                     minimum=0.0, maximum=1e4)


def _chain(part: str, unit: str) -> tuple[Parameter, ...]:
    """Return the error parameters of one inertial sensor; each is taken from the preset unless it is given."""
    return tuple(
        Parameter(f"sensors.imu.{part}.{name}", AS_PRESET, f"{unit}{per}", f"{what}; -1: the preset's",
                  minimum=AS_PRESET, maximum=1e9) for name, per, what in (
            ("range", "", f"largest magnitude that the {part} measures; 0: any"),
            ("resolution", "", "step of its numbers; 0: none"),
            ("noise_density", "/√Hz", "white noise as in data sheets, by the one-sided spectrum: its standard "
             "deviation is this times √(rate/2)"),
            ("bias_random_walk", "/√s", "standard deviation of the bias's change in a second"),
            ("turn_on_bias", "", "standard deviation of the bias at t = 0")))


_SENSORS: tuple[Parameter, ...] = (
    Parameter("sensors.seed", 0.0, "", "whole number from which all noise of the sensors follows",
              minimum=0.0, maximum=2.0**53),
    Parameter("sensors.preset", "ideal", "", "the part whose data sheet gives each number of the IMU that is -1; ideal "
              "has no error but its bandwidth", choices=("ideal", "bmi270", "mpu6050")),
    _rate("imu", "acceleration and angular rate"),
    Parameter("sensors.imu.bandwidth", AS_PRESET, "Hz", "frequency at which the accelerometer's low-pass of second "
              "order loses 3 dB; -1: the preset's", minimum=AS_PRESET, maximum=1e5),
    Parameter("sensors.imu.delay", 0.0, "s", "time from a measurement to its message", minimum=0.0, maximum=1.0),
    *_chain("accelerometer", "m/s²"),
    *_chain("gyroscope", "rad/s"),
    _rate("encoder", "the crank's angle"),
    Parameter("sensors.encoder.ticks", 4096.0, "", "steps of the crank's turn that it tells apart",
              minimum=1.0, maximum=1e9),
    Parameter("sensors.encoder.velocity_window", 0.01, "s", "time over which the angle's difference is taken for the "
              "speed, in whole periods of the rate, at least one", minimum=0.0, maximum=1.0),
    _rate("current", "the current that a dc motor's supply gives"),
    Parameter("sensors.current.noise", 0.0, "A", "standard deviation of the current", minimum=0.0, maximum=1e3),
    Parameter("sensors.current.resolution", 0.0, "A", "step of its numbers; 0: none", minimum=0.0, maximum=1e3,
              smallest=1e-9),
    Parameter("sensors.current.range", 0.0, "A", "largest magnitude that it measures; 0: any", minimum=0.0,
              maximum=1e6),
    Parameter("sensors.current.supply_resistance", 0.0, "Ω", "the supply's own resistance, by which its voltage falls "
              "where it is measured; the motor does not feel it", minimum=0.0, maximum=1e3),
    _rate("tracking", "the body's place from outside"),
    Parameter("sensors.tracking.noise", 0.001, "m", "standard deviation of each coordinate", minimum=0.0, maximum=1e3),
    Parameter("sensors.tracking.latency", 0.0, "s", "time from a measurement to its message",
              minimum=0.0, maximum=1.0),
    Parameter("sensors.tracking.dropout_probability", 0.0, "", "probability at each measurement that a dropout begins "
              "with it", minimum=0.0, maximum=1.0),
    Parameter("sensors.tracking.dropout_duration", 0.1, "s", "how long no measurement comes then",
              minimum=0.0, maximum=1.0),
)

_TABLE: tuple[Parameter, ...] = (
    _mass("mass.body", 1.0, "the body, m1"),
    _mass("mass.upper", 0.1, "the upper impact mass, m2"),
    _mass("mass.inclined", 0.08, "the inclined impact mass, m3"),
    *(Parameter(f"mass.{name}", 0.0, "kg", f"mass of {what}, lumped, with its share of the rod{ends}", minimum=0.0,
                maximum=1e6) for name, what, ends in (
        ("upper_slider", "the upper slider", ""), ("inclined_slider", "the inclined slider", ""),
        ("crank_pin", "the crank pin", "s"))),
    Parameter("body.inertia", 4.2e-3, "kg·m²", "inertia of the body against pitch, about its centre; for the pitch "
              "index alone, enters no equation", minimum=1e-9, maximum=1e9),
    _length("body.wheelbase", 0.2, "distance between the body's front and rear wheels, for the pitch index alone"),
    Parameter("body.crank_offset", 0.0, "m", "height of the crank's centre above the body's, for the pitch index alone",
              minimum=-1e3, maximum=1e3),
    _length("crank.radius", 0.02, "crank radius DA, l; at most the rods' length"),
    _length("crank.upper_rod", 0.06, "connecting rod AB, L2"),
    _length("crank.inclined_rod", 0.06, "connecting rod AC, L3"),
    Parameter("guide.angle", math.radians(50.0), "rad", "angle of the inclined guide from the vertical, φ",
              minimum=0.0, maximum=math.pi),
    *_guide("upper", "2", "4", "E"),
    *_guide("inclined", "3", "1", "H"),
    Parameter("ground.friction", 0.2, "", "kinetic friction coefficient of body on ground, μ",
              minimum=0.0, maximum=1e3, while_running=True),
    Parameter("ground.static_friction", 0.25, "", "friction coefficient of a body at rest, μs, at least "
              "ground.friction", minimum=0.0, maximum=1e3),
    Parameter("ground.stribeck_speed", 0.01, "m/s", "speed v_s over which friction falls from static to kinetic: "
              "μ(v) = μ + (μs - μ) exp(-abs(v)/v_s)", minimum=1e-6, maximum=1e3),
    Parameter("ground.friction_backward", AS_FORWARD, "", "kinetic friction coefficient of backward motion, as over "
              "bristles or one-way wheels; -1: the same as ground.friction", minimum=AS_FORWARD, maximum=1e6,
              while_running=True),
    Parameter("ground.restitution", 0.0, "", "restitution of a landing, by the rule hop: the impulse while the ground "
              "rebounds over that while it is compressed (Poisson's law)", minimum=0.0, maximum=1.0),
    Parameter("ground.slope", 0.0, "rad", "angle of the ground, α; x points uphill", minimum=-1.5, maximum=1.5),
    Parameter("ground.viscous_friction", 0.0, "N·s/m", "viscous resistance c_v: a force -c_v x' on the body, on the "
              "ground and above it", minimum=0.0, maximum=1e6),
    Parameter("ground.drag", 0.0, "N", "constant force F_0 on the body against forward motion, such as a load that "
              "it pulls, on the ground and above it", minimum=-1e6, maximum=1e6),
    Parameter("gravity", 9.81, "m/s²", "gravitational acceleration, g", minimum=0.0, maximum=1e3),
    Parameter("motor.speed", 100.0, "rad/s", "motor speed at t = 0, and the command until another arrives; below 0, "
              "backwards", minimum=-1e4, maximum=1e4),
    Parameter("motor.max_speed", 500.0, "rad/s", "fastest that the motor may be asked to turn, either way",
              minimum=0.0, maximum=1e4, positive=True, while_running=True),
    Parameter("motor.acceleration", 200.0, "rad/s²", "largest rate of change of the ramp motor's speed, and of the "
              "speed that a dc motor's controller asks for; 0, with dc: no limit", minimum=0.0, maximum=1e9,
              while_running=True),
    Parameter("motor.time_constant", 0.1, "s", "time constant of the lag motor's change of speed",
              minimum=0.0, maximum=1e3, positive=True, while_running=True),
    Parameter("motor.control", "speed_by_current", "", "what a dc motor is commanded by: a voltage; or a speed, which "
              "a sampled PI controller keeps by the voltage, or by the current of a drive with a current loop",
              choices=("voltage", "speed_by_voltage", "speed_by_current")),
    Parameter("motor.voltage", 0.0, "V", "with motor.control voltage: voltage at t = 0, and the command until another "
              "arrives; within motor.supply_voltage", minimum=-1e4, maximum=1e4),
    Parameter("motor.supply_voltage", 36.0, "V", "largest voltage of the dc motor's supply, V_s", minimum=0.0,
              maximum=1e4, positive=True, while_running=True),
    Parameter("motor.winding_resistance", 1.43, "Ω", "resistance of the winding, R", minimum=1e-6, maximum=1e6),
    Parameter("motor.winding_inductance", 0.0, "H", "inductance of the winding, L; 0: the current follows at once",
              minimum=0.0, maximum=1e3),
    Parameter("motor.torque_constant", 0.0398, "N·m/A", "torque over current at the motor's shaft, and its voltage "
              "over speed, k_t", minimum=1e-9, maximum=1e3),
    Parameter("motor.gear_ratio", 3.7, "", "turns of the motor's shaft for one of the crank, n", minimum=1e-3,
              maximum=1e4),
    Parameter("motor.rotor_inertia", 3.31e-6, "kg·m²", "inertia of the rotor, at the motor's shaft", minimum=0.0,
              maximum=1e3),
    Parameter("motor.crank_inertia", 3.5e-5, "kg·m²", "inertia of crank, gear and flywheel, at the crank", minimum=0.0,
              maximum=1e3),
    Parameter("motor.damping", 5e-5, "N·m·s", "viscous friction of bearing and gear, at the crank, b", minimum=0.0,
              maximum=1e3),
    Parameter("motor.friction", 0.03, "N·m", "dry friction of bearing and gear that turn, at the crank, T_c",
              minimum=0.0, maximum=1e6),
    Parameter("motor.static_friction", 0.04, "N·m", "dry friction that holds a crank at rest, T_s, at least "
              "motor.friction", minimum=0.0, maximum=1e6),
    Parameter("motor.current_limit", 10.0, "A", "largest current that the controller asks for, I_max", minimum=0.0,
              maximum=1e6, positive=True, while_running=True),
    Parameter("motor.continuous_current", 2.2, "A", "rms current at which the winding stays cool enough for ever; "
              "enters no equation", minimum=0.0, maximum=1e6, positive=True),
    Parameter("motor.control_rate", 1000.0, "Hz", "samples of the controller, from t = 0 on", minimum=1e-3,
              maximum=1e5),
    Parameter("motor.proportional_gain", 0.05, "", "of the controller, k_p [A or V, over rad/s]", minimum=0.0,
              maximum=1e6, while_running=True),
    Parameter("motor.integral_gain", 1.0, "", "of the controller, k_i [A or V, over rad]", minimum=0.0, maximum=1e6,
              while_running=True),
    Parameter("motor.feed_forward", 0.0, "", "of the controller, a: voltage over the speed asked for [V·s], or current "
              "over the speed's rate of change [A·s²]", minimum=0.0, maximum=1e6, while_running=True),
    Parameter("motor.current_time_constant", 1e-3, "s", "time constant of the drive's current loop, τ", minimum=1e-6,
              maximum=1e3),
    Parameter("gap_actuator.speed", 0.005, "m/s", "speed at which a plate moves to a commanded gap",
              minimum=0.0, maximum=10.0, positive=True, while_running=True),
    Parameter("start.state", "rest", "", "rest: each mass at rest on its slider or, if that would penetrate, "
              "on its plate; zero: every coordinate 0; given: the parameters start.* say where everything is",
              choices=("rest", "zero", "given")),
    _start("body_position", "m", "the body's place on the ground"),
    _start("body_velocity", "m/s", "the body's speed, forwards positive"),
    _start("body_height", "m", "how high the body is above the ground, by the rule hop", minimum=0.0),
    _start("body_vertical_velocity", "m/s", "the body's speed upwards, by the rule hop"),
    _start("upper_position", "m", "the upper mass's place on its guide, from the crank's centre"),
    _start("upper_velocity", "m/s", "the upper mass's speed along its guide, outwards positive"),
    _start("inclined_position", "m", "the inclined mass's place on its guide, from the crank's centre"),
    _start("inclined_velocity", "m/s", "the inclined mass's speed along its guide, outwards positive"),
    # Beyond 1e9 rad an angle in double precision is coarser than 1e-7 rad.
    _start("crank_angle", "rad", "the crank's angle", minimum=-1e9, maximum=1e9),
    Parameter("effects.upper_mass", True, "", "simulate the upper mass"),
    Parameter("effects.inclined_mass", True, "", "simulate the inclined mass; without it no mass drives the body"),
    Parameter("effects.upper_contact", "compliant", "", "contact of the upper mass with its plate",
              choices=("none", "restitution", "compliant")),
    Parameter("effects.inclined_contact", "compliant", "", "contact of the inclined mass with its plate",
              choices=("none", "restitution", "compliant")),
    Parameter("effects.adhesion", True, "", "true: a plate's damper may pull, as printed; false: no tension"),
    Parameter("effects.friction", "coulomb", "", "friction of the body on the ground; static: "
              "ground.static_friction holds a body at rest; stribeck: and falls to ground.friction with the speed",
              choices=("none", "coulomb", "static", "stribeck")),
    Parameter("effects.normal_force", "printed", "", "weight: N = M g; unilateral: eq. (6), not below 0; "
              "printed: eq. (6), may be negative; hop: at 0 the body leaves the ground, and lands as "
              "ground.restitution says",
              choices=("weight", "unilateral", "printed", "hop")),
    Parameter("effects.reaction", False, "", "the body's acceleration acts back on the masses; then energy balances"),
    Parameter("effects.misprint", False, "", "the paper's ξ2 for ξ3 in eqs. (1), (6) and (7) taken literally: while "
              "the inclined plate is closed, the body feels k1 (u - H) in place of k1 (w - H)"),
    Parameter("effects.mass_weight", False, "", "the masses' own weight pulls them along their guides"),
    Parameter("effects.motor", "ideal", "", "ideal: speed follows the command at once; ramp: with limited "
              "acceleration; lag: with a time constant; dc: a motor that the masses slow down, with winding, rotor and "
              "bearing", choices=("ideal", "ramp", "lag", "dc")),
    Parameter("solver.accounts", False, "", "book where energy comes from and goes, by the method exact; costs time, "
              "changes nothing"),
    Parameter("solver.tolerance", 1e-9, "m", "error of a position over 0.2 s that may not be exceeded; refused where "
              "rods and plates do not let rounding keep it, or, if it is the default, warned of; changes no bit",
              minimum=1e-12, maximum=1e-3),
    Parameter("solver.method", "exact", "", "exact: event by event, to rounding; rk4: steps of fixed length, blind to "
              "events within a step; rk4_located: steps of fixed length that end at events",
              choices=("exact", "rk4", "rk4_located")),
    Parameter("solver.step", 1e-5, "s", "step of a method of fixed step", minimum=1e-8, maximum=0.01),
)

#: Every parameter of a scene.
SCENE_PARAMETERS: tuple[Parameter, ...] = tuple(replace(parameter, negligible=NEGLIGIBLE)
                                                for parameter in (*_TABLE, *_SENSORS))

BY_NAME: Mapping[str, Parameter] = {parameter.name: parameter for parameter in SCENE_PARAMETERS}
"""Each parameter of a scene by its name."""

LIVE: tuple[str, ...] = tuple(name for name, parameter in BY_NAME.items() if parameter.while_running)
"""Names of the scene's parameters that may change while the device runs; all of them are numbers."""


def checked_parameters(changes: Mapping[str, object], table: Iterable[Parameter]) -> dict[str, Value]:
    """Return the values of `changes`, by name, checked by the parameters of `table` (ValueError)."""
    by_name = {parameter.name: parameter for parameter in table}
    return {name: parameter_named(name, by_name).checked(value) for name, value in changes.items()}


def parameter_named(name: str, by_name: Mapping[str, Parameter]) -> Parameter:
    """Return the parameter called `name`, or raise a ValueError that suggests the nearest name."""
    if name in by_name:
        return by_name[name]
    shown = name if name.isprintable() and len(name) <= LONGEST_QUOTE else quoted(name)
    raise ValueError(f"{shown}: unknown parameter; {nearest(name, by_name) or '`robot --help` lists the parameters'}")


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the question whether the user meant the nearest of the `known` names; empty if none is near."""
    near = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {near[0]}?" if near else ""
