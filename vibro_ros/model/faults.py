"""Disturbances of a robot besides commands: faults of a limited duration, and a push.

A fault is started by its name and duration; a duration of 0 ends it. Some faults also need a number, the part that
fails, or a stretch of the ground. The device, the commands and the sensors each have faults of their own. A part that
does not follow its commands stores them: after the fault it follows the last one.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

from vibro_ros.model.parameters import BY_NAME, Parameter, quoted

LONGEST = 86_400.0  # longest duration of a fault or a push [s]
DURATION = Parameter("duration", 0.0, "s", "how long it lasts; 0 ends one that lasts", minimum=0.0, maximum=LONGEST)
FORCE = Parameter("force", 0.0, "N", "on the body", minimum=-1e6, maximum=1e6)

NO_VALUE = Parameter("value", 0.0, "", "of a fault that needs none, or ends", minimum=0.0, maximum=0.0)
NO_PLACE = replace(NO_VALUE, unit="m")
PLACE = Parameter("from_x", 0.0, "m", "an end of a stretch of the ground", minimum=-1e6, maximum=1e6)

DEVICE, SENSORS, COMMANDS = "device", "sensors", "commands"
"""Parts of the virtual device that a fault can affect."""
SENSOR_NAMES = ("imu", "encoder", "current", "tracking")


class Fault(NamedTuple):
    """One kind of fault."""

    affects: str  # `DEVICE`, `SENSORS` or `COMMANDS`
    effect: str  # as part of a sentence
    of: tuple[str, ...] = ()  # the parts that can have the fault; empty if there is no choice
    value: Parameter | None = None  # the number that the fault needs; None if it needs none
    has_place: bool = False  # whether the fault affects a stretch of the ground, from `from_x` to `to_x`


FAULTS: Mapping[str, Fault] = {
    "motor_stall": Fault(DEVICE, "the motor stops, as it does for a command of 0, and follows no command"),
    "supply_sag": Fault(DEVICE, "the supply of a dc motor has no more than so many volts", value=Parameter(
        "value", 0.0, "V", "voltage of the supply", minimum=0.0, maximum=BY_NAME["motor.supply_voltage"].maximum,
        positive=True)),
    "plate_stuck": Fault(DEVICE, "the plate stands where it is and follows no command", of=("upper", "inclined")),
    "friction_patch": Fault(DEVICE, "a stretch of the ground has another friction coefficient", value=Parameter(
        "value", 0.0, "", "friction coefficient, of a body at rest and in motion", minimum=0.0,
        maximum=BY_NAME["ground.friction"].maximum), has_place=True),
    "sensor_dropout": Fault(SENSORS, "the sensor gives nothing", of=SENSOR_NAMES),
    "sensor_freeze": Fault(SENSORS, "the sensor gives what it gave last", of=SENSOR_NAMES),
    "sensor_offset": Fault(SENSORS, "so much is added to what the sensor measures", of=SENSOR_NAMES, value=Parameter(
        "value", 0.0, "", "offset, in the sensor's unit", minimum=-1e6, maximum=1e6)),
    "late_commands": Fault(COMMANDS, "each command takes effect so much later", value=Parameter(
        "value", 0.0, "s", "delay", minimum=0.0, maximum=60.0, positive=True)),
    "lost_commands": Fault(COMMANDS, "no command arrives"),
}


class Incident(NamedTuple):
    """A requested fault, checked."""

    fault: str  # a name of `FAULTS`
    duration: float  # how long the fault lasts [s]; 0 ends it
    of: str = ""  # the part that fails, or empty
    value: float = 0.0  # the fault's number, in its unit; 0 if the fault needs none
    from_x: float = 0.0  # the stretch of the ground [m], from here to `to_x`; 0 if the fault needs none
    to_x: float = 0.0


def checked_incident(fault: object, duration: object, of: object = "", value: object = 0.0, from_x: object = 0.0,
                     to_x: object = 0.0) -> Incident:
    """Return the fault after checking it (ValueError: names the value, the limit and the remedy)."""
    name = Parameter("fault", "", "", "what fails", choices=tuple(FAULTS)).checked(fault)
    kind, seconds = FAULTS[name], DURATION.checked(duration)
    if not isinstance(of, str) or of not in (kind.of or ("",)):
        raise ValueError(f"of: {quoted(of)} has no {name}; give {' or '.join(kind.of) or 'nothing'}")
    number = NO_VALUE.checked(value) if kind.value is None or not seconds else kind.value.checked(value)
    place = PLACE if kind.has_place and seconds else NO_PLACE
    begin, end = replace(place, name="from_x").checked(from_x), replace(place, name="to_x").checked(to_x)
    if place is PLACE and not begin < end:
        raise ValueError(f"to_x: {end:g} m does not lie ahead of from_x, {begin:g} m; give a greater one")
    return Incident(name, seconds, of, number, begin, end)


def part_of(name: str, of: str) -> str:
    """Return the name of a disturbance in lists and messages, with the part that it affects, if there is a choice."""
    return f"{name} of {of}" if of else name


def check_lasting(name: str, of: str, duration: float, lasting: Collection[str]) -> None:
    """Refuse a duration of 0, which ends a disturbance, if none lasts (ValueError); `lasting` has names by `part_of`.

    Such a request mostly lacks its duration.
    """
    if not duration and part_of(name, of) not in lasting:
        raise ValueError(f"duration: 0 s ends a {part_of(name, of)}, and none lasts; give a duration above 0 and up to "
                         f"{LONGEST:g} s")
