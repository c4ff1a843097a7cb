"""The tree of the robot's frames: which joint carries which frame, and how it lies when every joint stands at 0.

x points forward and z up (REP-103). `base_link` lies on the ground below the crank's centre; `body` is the body.
`upper_guide` and `inclined_guide` have the crank's centre as their origin and z along the guide, outwards; mass and
plate of a guide move along that z, so that their positions in `joint_states` are the model's. `crank` turns about the
same centre, with z towards its pin; a connecting rod hangs on the pin, with z towards its slider.

Turning by a positive angle leads from z towards -x, as the model counts the crank's angle and the guides'.
"""

import math
from typing import NamedTuple

from vibro_ros.messages.outlines import hub_height
from vibro_ros.model.scene import Scene
from vibro_ros.model.slider import Slider

BASE = "base_link"
BODY = "body"
CRANK = "crank"

FIXED, CONTINUOUS, PRISMATIC, FLOATING = "fixed", "continuous", "prismatic", "floating"
"""Kinds of joints, in the words of URDF.

A rod's joint is `floating`: its angle follows from the crank's by no law that URDF can state, and it is none of
`joint_states`. So a robot_state_publisher leaves the rod's frame to the one who knows it, which is the robot's tf.
"""


class Joint(NamedTuple):
    """One joint, named like the frame that it carries.

    Attributes
    ----------
    child, parent : str
        Frames.
    kind : str
        `FIXED`, `CONTINUOUS`, `PRISMATIC` or `FLOATING`.
    height : float
        Place of the child's origin on the parent's z axis while the joint stands at 0 [m].
    angle : float
        Angle of the child in the parent while the joint stands at 0 [rad].
    """

    child: str
    parent: str
    kind: str
    height: float = 0.0
    angle: float = 0.0


def robot_joints(scene: Scene) -> tuple[Joint, ...]:
    """Every joint below `base_link` that a robot of this scene has, each behind the one that carries it."""
    hub = hub_height(scene)
    found = [Joint(BODY, BASE, FIXED)]
    found += [Joint(f"{side}_guide", BASE, FIXED, hub, scene.guide_angle(side)) for side in scene.guides]
    found.append(Joint(CRANK, BASE, CONTINUOUS, hub))
    found += [Joint(f"{side}_rod", CRANK, FLOATING, scene["crank.radius"], rod_angle(slider(scene, side), 0.0))
              for side in scene.guides]
    found += [Joint(f"{side}_mass", f"{side}_guide", PRISMATIC) for side in scene.guides]
    found += [Joint(f"{side}_plate", f"{side}_guide", PRISMATIC) for side in scene.plates]
    return tuple(found)


def slider(scene: Scene, side: str) -> Slider:
    """The slider of a guide."""
    return Slider(scene["crank.radius"], scene[f"crank.{side}_rod"], scene.guide_angle(side))


def rod_angle(driven: Slider, crank_angle: float) -> float:
    """Angle [rad] of a rod in the frame `crank`, at the crank's angle [rad].

    The rod leads from the pin to the slider. In the guide's frame the pin stands at l (-sin psi, cos psi), and the
    slider above it, so that the rod leans back by asin(l sin(psi) / L); psi is the crank's angle from the guide.
    """
    psi, radius, rod = crank_angle - driven.angle, driven.radius, driven.rod
    root = math.sqrt((rod - radius) * (rod + radius) + (radius * math.cos(psi)) ** 2)  # as in `Slider.root`
    return -psi - math.atan2(radius * math.sin(psi), root)
