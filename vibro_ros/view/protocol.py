"""The protocol between page and server: requests of the page, frames of the server, and the description of a robot.

A page sends a text of JSON for each request, `read_request`. The server sends texts of JSON, and binary frames of
samples and of motions. A binary frame begins with two little-endian numbers of 32 bits, the first of which is its kind.
In a frame of `SAMPLES` the second is the number of rows, and the rows follow, a float64 for each of `COLUMNS`; in a
frame of `MOTION` the second is the request's id, and the motion's payload follows. A page draws the robot to scale and
offers its commands from the description that `drawing` makes of a scene, for a live robot and for a recording.
"""

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.messages.urdf import CLEARANCE, FREE_LENGTH, HEADROOM, MASS_HEIGHT, guide_end, hub_height
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.process.files import one_line
from vibro_ros.simulation.samples import FIELDS

COLUMNS = FIELDS  # quantities of a row, SI units; `time` is counted from the robot's `origin` [s]
SAMPLES, MOTION = 1, 2  # kinds of binary frames
_HEAD = struct.Struct("<II")

LONGEST = 4096  # longest text [bytes] that a page may send
MOST_SECONDS = 5.0  # longest slow motion [s] that a page may ask for; the view keeps the samples of this time
PLAIN_CALLS = ("reset", "step")
SWITCHES = ("pause", "record")
PARAMETERS = ("ground.friction",)
"""Parameters of the scene that a page may set; each may change while the robot runs."""
_MOST_IDS = 2**32  # a binary frame has 32 bits for an id

COMMAND, PARAMETER, CALL, SLOW_MOTION = "command", "parameter", "call", "slow_motion"
"""Kinds of requests: to publish a command, to set a parameter, to call a service, to compute slow motion."""
#: Names that each kind of request may have, by the keys of its JSON object beside `id`.
_NAMES: Mapping[frozenset[str], tuple[str, tuple[str, ...]]] = {
    frozenset({COMMAND, "value"}): (COMMAND, tuple(COMMAND_UNITS)),
    frozenset({PARAMETER, "value"}): (PARAMETER, PARAMETERS),
    frozenset({CALL}): (CALL, PLAIN_CALLS),
    frozenset({CALL, "on"}): (CALL, SWITCHES),
    frozenset({SLOW_MOTION}): (SLOW_MOTION, ()),
}


@dataclass(frozen=True)
class Request:
    """A page's request, with its `id`, `kind`, and the `name` of a command, a parameter or a service.

    `value` is the value of a command or parameter in its unit, whether a switch is to be on, or the length [s] of the
    slow motion; None for a service that is no switch.
    """

    id: int
    kind: str
    name: str
    value: float | bool | None


class RefusedError(ValueError):
    """A page's text is no valid request; `id` is that of the request, if it has one."""

    def __init__(self, words: str, id: int | None = None):
        super().__init__(words)
        self.id = id


def read_request(text: str | bytes) -> Request:
    """Read the request in a page's text (RefusedError says in one line what is wrong)."""
    if isinstance(text, bytes):
        raise RefusedError("bytes are no request; send text")
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise RefusedError("no JSON object; send one such as {\"id\": 1, \"call\": \"reset\"}")
    id = fields.pop("id", None)
    if type(id) is not int or not 0 <= id < _MOST_IDS:
        raise RefusedError(f"id: give an integer from 0 to {_MOST_IDS - 1}, which the answer repeats")
    try:
        kind, names = _NAMES.get(frozenset(fields), ("", ()))
        if not kind:
            raise ValueError(f"{_shown(sorted(fields))} is no request; send command and value, parameter and value, "
                             "call, call and on, or slow_motion")
        if names and fields[kind] not in names:
            raise ValueError(f"{kind}: {_shown(fields[kind])} is unknown; choose one of {', '.join(names)}")
        return Request(id, kind, fields[kind] if names else "", _value(kind, fields))
    except ValueError as error:
        raise RefusedError(str(error), id) from None


def _value(kind: str, fields: dict[str, Any]) -> float | bool | None:
    """Return the checked value of a request (ValueError)."""
    if kind == CALL:
        if type(fields.get("on", True)) is not bool:
            raise ValueError(f"on: {_shown(fields['on'])} is not true or false; give one of them")
        return fields.get("on")
    key = SLOW_MOTION if kind == SLOW_MOTION else "value"
    value = fields[key]
    try:
        number = float(value) if type(value) in (int, float) else math.nan
    except OverflowError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{key}: {_shown(value)} is not a finite number; give one")
    if kind == SLOW_MOTION and not 0.0 < number <= MOST_SECONDS:
        raise ValueError(f"slow_motion: {number:g} s is out of range; give above 0 to {MOST_SECONDS:g} s")
    return number


def _shown(value: object) -> str:
    return one_line(repr(value), 60)


def text_frame(kind: str, **fields: object) -> str:
    """Return a text frame: JSON with the `kind` and the `fields` (ValueError for a number that is not finite)."""
    return json.dumps({"kind": kind, **fields}, allow_nan=False, separators=(",", ":"))


def samples_frame(rows: bytes) -> bytes:
    """Return the binary frame of rows of samples."""
    return _HEAD.pack(SAMPLES, len(rows) // (8 * len(COLUMNS))) + rows


def motion_frame(id: int, payload: bytes) -> bytes:
    """Return the binary frame of a motion's payload, for the request `id`."""
    return _HEAD.pack(MOTION, id) + payload


#: Unit of a quantity by the last word of its name; `crank_angle` is the only angle, `motor_speed` the only speed.
_UNITS = {"time": "s", "position": "m", "height": "m", "velocity": "m/s", "angle": "rad", "speed": "rad/s",
          "power": "W", "torque": "N m", "force": "N", "voltage": "V", "current": "A"}


ELECTRICAL = ("motor_voltage", "motor_current", "electrical_power")  # quantities that only a dc motor has


def drawing(scene: Scene) -> dict[str, Any]:
    """Describe the robot of a scene, ready for JSON.

    Lengths are in m and angles in rad, counted from z (upwards) towards -x. The position of a mass does not include the
    length of its unstretched drive spring, so that a picture draws mass and plate farther out by `free_length` (see
    `messages.urdf`).

    Returns
    -------
    dict
        ``name`` of the scene; ``hops``, whether its body can leave the ground; ``slope`` of the ground, x pointing
        uphill, and ``weight`` of the robot [N]; ``crank_radius``; ``hub_height`` of the crank's centre above the
        ground; ``free_length``, ``mass_height``, ``headroom`` and ``clearance`` of `messages.urdf`; ``guides``, for
        each mass that the scene has: ``side``, ``angle``, ``rod`` [m], ``plate`` (whether there is one) and ``end``,
        the distance of the guide's end from the crank's centre; ``knobs``, for each command, and for each parameter
        that a page may set and that has an effect: ``name``, ``unit``, ``from`` and ``to`` (the robot's limits),
        ``value`` (the initial one) and ``parameter``, whether it is a parameter; ``quantities``, the unit of each.

    Examples
    --------
    >>> robot = drawing(vibro_ros.load_scene("device"))
    >>> [(guide["side"], guide["rod"]) for guide in robot["guides"]]
    [('upper', 0.06), ('inclined', 0.06)]
    """
    command = scene.motor_command
    highest = scene["motor.supply_voltage" if command == "motor_voltage" else "motor.max_speed"]
    knobs = [(command, -highest, highest, scene[command.replace("_", ".")])]
    for side in scene.plates:
        rod = scene[f"crank.{side}_rod"]  # the limit of `Scene.checked_gap`
        knobs.append((f"{side}_gap", -rod, rod, scene[f"{side}.gap"]))
    if scene["effects.friction"] != "none":
        at_rest = scene["effects.friction"] in ("static", "stribeck")  # has its own coefficient, the limit
        largest = scene["ground.static_friction"] if at_rest else BY_NAME["ground.friction"].maximum
        knobs.append(("ground.friction", 0.0, largest, scene["ground.friction"]))
    return {
        "name": scene.name, "hops": scene["effects.normal_force"] == "hop",
        "slope": scene["ground.slope"], "weight": scene.total_mass * scene["gravity"],
        "crank_radius": scene["crank.radius"],
        "hub_height": hub_height(scene),
        "free_length": FREE_LENGTH, "mass_height": MASS_HEIGHT, "headroom": HEADROOM, "clearance": CLEARANCE,
        "guides": [{"side": side, "angle": scene.guide_angle(side), "rod": scene[f"crank.{side}_rod"],
                    "plate": side in scene.plates, "end": guide_end(scene, side)} for side in scene.guides],
        "knobs": [{"name": name, "unit": COMMAND_UNITS.get(name, ""), "from": low, "to": high, "value": value,
                   "parameter": name in PARAMETERS} for name, low, high, value in knobs],
        "quantities": {name: _UNITS[name.rpartition("_")[2]] for name in quantities(scene)},
    }


def quantities(scene: Scene) -> tuple[str, ...]:
    """Return the fields of `Samples` that the robot of a scene has, without ``time``."""
    absent = {side for side in ("upper", "inclined") if side not in scene.guides}
    electrical = () if scene.has_rotor else ELECTRICAL
    without_plate = {side for side in ("upper", "inclined") if side not in scene.plates}
    return tuple(name for name in FIELDS if name not in ("time", *electrical) and name.partition("_")[0] not in absent
                 and not (name.partition("_")[0] in without_plate and "_plate_" in name))


def shown_quantities(scene: Scene) -> tuple[str, ...]:
    """Return the `quantities` of a scene whose motion is shown.

    Left out are the torque, which is power over speed and only rounding error where the crank hardly turns, and the
    power from a dc motor's supply, which is voltage times current.
    """
    return tuple(name for name in quantities(scene) if name not in ("motor_torque", "electrical_power"))
