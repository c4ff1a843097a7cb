"""Limits of the forces that methods of fixed step publish, by the laws of a scene.

A step that does not see an event goes on in the old mode, whose forces may break the laws: a plate that cannot pull
would pull, and ground that the body has left would push.
"""

from collections.abc import MutableMapping

import numpy as np

from vibro_ros.model.scene import Scene

#: Height [m] that rounding may give to a body that stands on the ground.
_STANDING = 1e-15


def cut_to_laws(scene: Scene, quantities: MutableMapping[str, np.ndarray]) -> None:
    """Cut the forces among `quantities`, fields of `Samples` by name, to what the laws of `scene` allow."""
    rule = scene["effects.normal_force"]
    if rule in ("unilateral", "hop"):
        normal = np.maximum(quantities["normal_force"], 0.0)
        quantities["normal_force"] = np.where(quantities["body_height"] > _STANDING, 0.0, normal)
    bound = scene.resting_friction * np.abs(quantities["normal_force"])
    quantities["friction_force"] = np.clip(quantities["friction_force"], -bound, bound) + 0.0  # no -0.0
    for side in scene.plates:
        if scene[f"effects.{side}_contact"] == "restitution" or not (
                scene["effects.adhesion"] and scene[f"{side}.plate.damping"]):
            quantities[f"{side}_plate_force"] = np.maximum(quantities[f"{side}_plate_force"], 0.0)
