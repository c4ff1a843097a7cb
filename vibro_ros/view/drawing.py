"""What a page needs to know of a scene in order to draw the robot to scale and to offer its commands."""

from typing import Any

from vibro_ros.messages.topics import COMMAND_UNITS
from vibro_ros.messages.urdf import CLEARANCE, FREE_LENGTH, HEADROOM, MASS_HEIGHT, guide_end, hub_height
from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import FIELDS
from vibro_ros.view.protocol import PARAMETERS

#: Unit of a quantity by the last word of its name; `crank_angle` is the only angle, `motor_speed` the only speed.
_UNITS = {"time": "s", "position": "m", "height": "m", "velocity": "m/s", "angle": "rad", "speed": "rad/s",
          "power": "W", "torque": "N m", "force": "N", "voltage": "V", "current": "A"}


#: Quantities that only a dc motor has.
ELECTRICAL = ("motor_voltage", "motor_current", "electrical_power")


def drawing(scene: Scene) -> dict[str, Any]:
    """The robot of a scene, ready for JSON.

    Lengths are in m and angles in rad, counted from z (upwards) towards -x. A mass's position in the quantities is
    counted from the crank's centre to where its drive spring is unstretched, so that a picture sets mass and plate
    farther out by `free_length` (see `messages.urdf`).

    Returns
    -------
    dict
        ``name`` of the scene; ``hops``, whether its body can leave the ground; ``slope`` of the ground, x pointing
        uphill, and ``weight`` of the robot [N]; ``crank_radius``; ``hub_height`` of the crank's centre above the
        ground; ``free_length``, ``mass_height``, ``headroom`` and ``clearance`` of `messages.urdf`; ``guides``, for
        each mass that the scene has: ``side``, ``angle``, ``rod`` [m], ``plate`` (whether there is one) and ``end``,
        the distance of the guide's end from the crank's centre; ``knobs``, for each
        command and each parameter that does something: ``name``, ``unit``, ``from`` and ``to`` (the limits beyond which
        the robot refuses), ``value`` (of a command what holds before the first one) and ``parameter``, whether it is
        one; ``quantities``, the unit of each.

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
        at_rest = scene["effects.friction"] in ("static", "stribeck")  # by a coefficient of its own, the largest
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
    """Those fields of `Samples` that the robot of a scene has; ``time`` is not among them."""
    absent = {side for side in ("upper", "inclined") if side not in scene.guides}
    electrical = () if scene.has_rotor else ELECTRICAL
    without_plate = {side for side in ("upper", "inclined") if side not in scene.plates}
    return tuple(name for name in FIELDS if name not in ("time", *electrical) and name.partition("_")[0] not in absent
                 and not (name.partition("_")[0] in without_plate and "_plate_" in name))


def shown(scene: Scene) -> tuple[str, ...]:
    """Those of its `quantities` whose motion is shown: not the torque, power over speed, of which nothing but rounding
    is left where the crank hardly turns; nor what a dc motor takes from its supply, voltage times current."""
    return tuple(name for name in quantities(scene) if name not in ("motor_torque", "electrical_power"))
