"""The robot's description as URDF: the tree of its frames with shapes, masses and inertias.

The scene's parameters give lengths, angles and masses; the constants below give the rest. The crank, the rods, the
guides and the plates have no mass, because the model adds theirs to the body's.

x points forward and z up (REP-103). `base_link` lies on the ground below the crank's centre; `body` is the body.
`upper_guide` and `inclined_guide` have the crank's centre as their origin and z along the guide, outwards; mass and
plate of a guide move along that z, so that their positions in `joint_states` are the model's. `crank` turns about the
same centre, with z towards its pin; a connecting rod hangs on the pin, with z towards its slider.

A positive angle turns from z towards -x, as the model counts the angles of crank and guides.

The equations count a mass's position from the crank's centre without the length of the unstretched drive spring. So
the shapes of each mass and its plate lie farther out by that length, `FREE_LENGTH`, along the guide.
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from vibro_ros.model.scene import Scene

BASE = "base_link"
BODY = "body"
CRANK = "crank"
IMU = "imu_link"

COMMANDED = {"crank": ("velocity", "motor_speed"), "upper_plate": ("position", "upper_gap"),
             "inclined_plate": ("position", "inclined_gap")}
"""For each joint that takes commands, the array of a JointState and the argument of `Simulator.command`: the crank is
commanded by velocity [rad/s], a plate by position [m], the quantities of `joint_states`."""

FIXED, CONTINUOUS, PRISMATIC, FLOATING = "fixed", "continuous", "prismatic", "floating"
"""Types of joints, as URDF names them.

A rod's joint is `floating`, because URDF cannot state how its angle follows from the crank's, and `joint_states` lacks
it. So a robot_state_publisher does not publish the rod's frame; the robot's own tf does.
"""

ROBOT = "vibro_robot"
#: Red, green, blue from 0 to 1; the masses have the colours of every picture of the robot.
MATERIALS = {"body": (0.91, 0.92, 0.94), "rail": (0.54, 0.58, 0.64), "metal": (0.71, 0.74, 0.78),
             "dark": (0.23, 0.26, 0.30), "upper": (0.0, 0.447, 0.698), "inclined": (0.835, 0.369, 0.0)}

SLED = (0.156, 0.090, 0.008)  # m, along x, y and z
SLED_MIDDLE = -0.018  # m, along x
COLUMN = (0.044, 0.010)  # m, along x and y
COLUMN_BEHIND, CRANK_BEHIND = 0.030, 0.016  # m, along y: behind the masses, so that they stay visible
MASS_WIDTH, PLATE_WIDTH, PLATE_HEIGHT = 0.022, 0.024, 0.004  # m
BAR = 0.005  # m, thickness of rails, crank and rods
UNLIMITED = 1e9
"""Limit [m, m/s, N] that stands for none: URDF requires limits of a sliding joint, the model has none here."""

FREE_LENGTH = 0.040  # length [m] of an unstretched drive spring, between slider and mass
MASS_HEIGHT = 0.016  # size [m] of a mass along its guide
RAIL = 0.014  # distance [m] of a guide's rail from its axis
HEADROOM = 0.014  # distance [m] from a plate to the end of its guide; the plate's spring lies there
CLEARANCE = 0.024  # least distance [m] from the ground to the crank's pin, and to a guide's end

Vector = Sequence[float]


class Joint(NamedTuple):
    """One joint, named like its child frame; its kind is `FIXED`, `CONTINUOUS`, `PRISMATIC` or `FLOATING`.

    At joint position 0 the child's origin lies at `height` [m] on the parent's z axis, turned by `angle` [rad].
    """

    child: str
    parent: str
    kind: str
    height: float = 0.0
    angle: float = 0.0


def robot_description(scene: Scene, topics: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return the URDF of a robot of this scene, with the masses and plates that it has; equal scenes give equal texts.

    `topics` are the resolved names of `joint_commands` and `joint_states`, for a block by which ros2_control commands
    the robot; the block is left out if they are empty.
    """
    root = Element("robot", name=ROBOT)
    for name, colour in MATERIALS.items():
        SubElement(SubElement(root, "material", name=name), "color", rgba=_text((*colour, 1.0)))
    SubElement(root, "link", name=BASE)  # KDL supports no inertia of the root link
    for joint in robot_joints(scene):
        _fill_link(SubElement(root, "link", name=joint.child), joint.child, scene)
        _add_joint(root, joint, scene)
    if topics:
        _add_control(root, scene, topics)
    indent(root)
    return f'<?xml version="1.0"?>\n{tostring(root, encoding="unicode")}\n'


def _add_control(root: Element, scene: Scene, topics: Mapping[str, str]) -> None:
    """Add the block of ros2_control for its topic-based hardware.

    The threshold of -1 lets it repeat unchanged commands, because the robot's `command.timeout` needs them.
    """
    control = SubElement(root, "ros2_control", name=ROBOT, type="system")
    hardware = SubElement(control, "hardware")
    SubElement(hardware, "plugin").text = "joint_state_topic_hardware_interface/JointStateTopicSystem"
    for name, value in (("joint_commands_topic", topics["joint_commands"]),
                        ("joint_states_topic", topics["joint_states"]), ("trigger_joint_command_threshold", "-1")):
        SubElement(hardware, "param", name=name).text = value
    for joint, (kind, _) in COMMANDED.items():
        if joint == CRANK or joint.removesuffix("_plate") in scene.plates:
            element = SubElement(control, "joint", name=joint)
            SubElement(element, "command_interface", name=kind)
            for state in ("position", "velocity", "effort"):
                SubElement(element, "state_interface", name=state)


def robot_joints(scene: Scene) -> tuple[Joint, ...]:
    """Return all joints below `base_link` of a robot of this scene, each after the joint of its parent."""
    from vibro_ros.solver.readout import rod_angle  # compiled code, which readers of bags do not need

    hub = hub_height(scene)
    joints = [Joint(BODY, BASE, FIXED)]
    joints += [Joint(f"{side}_guide", BASE, FIXED, hub, scene.guide_angle(side)) for side in scene.guides]
    joints.append(Joint(CRANK, BASE, CONTINUOUS, hub))
    joints += [Joint(f"{side}_rod", CRANK, FLOATING, scene["crank.radius"], rod_angle(*rod, 0.0))
              for side, rod in zip(scene.guides, rods(scene), strict=True)]
    joints += [Joint(f"{side}_mass", f"{side}_guide", PRISMATIC) for side in scene.guides]
    joints += [Joint(f"{side}_plate", f"{side}_guide", PRISMATIC) for side in scene.plates]
    joints += [Joint(IMU, BODY, FIXED, SLED[2])] if scene["sensors.imu.rate"] else []
    return tuple(joints)


def rods(scene: Scene) -> list[tuple[float, float, float]]:
    """Return the angle [rad] of each guide, with crank radius and length [m] of its rod."""
    return [(scene.guide_angle(side), scene["crank.radius"], scene[f"crank.{side}_rod"]) for side in scene.guides]


def guide_end(scene: Scene, side: str) -> float:
    """Return the distance [m] from the crank's centre to a guide's end, for the plate at the scene's initial gap."""
    plate = scene[f"crank.{side}_rod"] + max(0.0, scene[f"{side}.gap"])
    return plate + FREE_LENGTH + MASS_HEIGHT + HEADROOM


def hub_height(scene: Scene) -> float:
    """Return the height [m] of the crank's centre above the ground, at which the crank and all guides clear it."""
    depths = [-scene.direction(side)[1] * guide_end(scene, side) for side in scene.guides]
    return max(scene["crank.radius"], *depths, 0.0) + CLEARANCE


def _add_joint(root: Element, joint: Joint, scene: Scene) -> None:
    element = SubElement(root, "joint", name=joint.child, type=joint.kind)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    SubElement(element, "origin", xyz=_text((0.0, 0.0, joint.height)), rpy=_text((0.0, -joint.angle, 0.0)))
    if joint.kind in (CONTINUOUS, PRISMATIC):
        SubElement(element, "axis", xyz="0 -1 0" if joint.kind == CONTINUOUS else "0 0 1")
    if joint.kind == PRISMATIC:
        side, _, part = joint.child.rpartition("_")
        lower, upper, speed = -UNLIMITED, UNLIMITED, UNLIMITED
        if part == "plate":
            lower, upper, speed = 0.0, 2.0 * scene[f"crank.{side}_rod"], scene["gap_actuator.speed"]
        SubElement(element, "limit", lower=_text([lower]), upper=_text([upper]), effort=_text([UNLIMITED]),
                   velocity=_text([speed]))


def _fill_link(link: Element, name: str, scene: Scene) -> None:
    """Add visual and collision shapes and the inertia of a link."""
    side, _, part = name.rpartition("_")
    if name == IMU:
        return  # a frame without shapes
    if part == BODY:
        hub, (length, width, height) = hub_height(scene), SLED
        _add_inertial(link, scene["mass.body"], (length, width, hub), (SLED_MIDDLE, 0.0, hub / 2))
        _add_box(link, SLED, (SLED_MIDDLE, 0.0, height / 2), "body", solid=True)
        _add_box(link, (*COLUMN, hub - height), (0.0, COLUMN_BEHIND, (hub + height) / 2), "body")
    elif part == CRANK:
        radius = scene["crank.radius"]
        _add_box(link, (BAR, BAR, radius), (0.0, CRANK_BEHIND, radius / 2), "dark")
        for height in (0.0, radius):  # shaft and pin, along y
            _add_cylinder(link, BAR, 2 * CRANK_BEHIND, height, "dark", tilt=math.pi / 2)
    elif part == "guide":
        start, end = CLEARANCE / 2, guide_end(scene, side)
        for across in (-RAIL, RAIL):
            _add_box(link, (BAR / 2, BAR, end - start), (across, 0.0, (start + end) / 2), "rail")
        _add_box(link, (2 * RAIL + BAR / 2, BAR, BAR), (0.0, 0.0, end), "rail")
    elif part == "rod":
        length = scene[f"crank.{side}_rod"]
        _add_cylinder(link, BAR / 2, length, length / 2, "metal")
        SubElement(_add_visual(link, (0.0, 0.0, length), "metal"), "sphere", radius=_text([BAR]))
    elif part == "mass":
        size, middle = (MASS_WIDTH, MASS_WIDTH, MASS_HEIGHT), (0.0, 0.0, FREE_LENGTH + MASS_HEIGHT / 2)
        _add_inertial(link, scene[f"mass.{side}"], size, middle)
        _add_box(link, size, middle, side, solid=True)
    else:
        middle = (0.0, 0.0, FREE_LENGTH + MASS_HEIGHT + PLATE_HEIGHT / 2)
        _add_box(link, (PLATE_WIDTH, PLATE_WIDTH, PLATE_HEIGHT), middle, "dark", solid=True)


def _add_box(link: Element, size: Vector, middle: Vector, material: str, solid: bool = False) -> None:
    """Add a box to the link's visuals, and if `solid` to its collision shapes; size and middle [m]."""
    elements = [_add_visual(link, middle, material)]
    if solid:
        elements.append(_add_geometry(SubElement(link, "collision"), middle))
    for element in elements:
        SubElement(element, "box", size=_text(size))


def _add_cylinder(link: Element, radius: float, length: float, height: float, material: str, tilt: float = 0.0) -> None:
    """Add a cylinder [m] with its middle at `height` on z; it lies along z, or is turned about x by `tilt` [rad]."""
    element = _add_visual(link, (0.0, 0.0, height), material, (tilt, 0.0, 0.0))
    SubElement(element, "cylinder", radius=_text([radius]), length=_text([length]))


def _add_visual(link: Element, middle: Vector, material: str, rpy: Vector = (0.0, 0.0, 0.0)) -> Element:
    visual = SubElement(link, "visual")
    geometry = _add_geometry(visual, middle, rpy)
    SubElement(visual, "material", name=material)
    return geometry


def _add_geometry(element: Element, middle: Vector, rpy: Vector = (0.0, 0.0, 0.0)) -> Element:
    SubElement(element, "origin", xyz=_text(middle), rpy=_text(rpy))
    return SubElement(element, "geometry")


def _add_inertial(link: Element, mass: float, size: Vector, middle: Vector) -> None:
    """Add mass [kg] and inertia [kg m²] of a solid box of this size [m], about its middle."""
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=_text(middle), rpy=_text((0.0, 0.0, 0.0)))
    SubElement(inertial, "mass", value=_text([mass]))
    x, y, z = (mass * length * length / 12.0 for length in size)
    SubElement(inertial, "inertia", ixx=_text([y + z]), ixy="0", ixz="0", iyy=_text([x + z]), iyz="0",
               izz=_text([x + y]))


def _text(numbers: Sequence[float]) -> str:
    """Return numbers with 12 digits, so that no rounding shows, such as that of a sine."""
    return " ".join(f"{number + 0.0:.12g}" for number in numbers)
