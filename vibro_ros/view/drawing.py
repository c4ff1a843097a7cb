"""Description of a scene for a page, which draws the robot to scale and offers its commands."""

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
