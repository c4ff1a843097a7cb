"""Forces within the laws of a scene: what steps of fixed length publish of the events that they have not seen.

Within a step, and at the end of one that an event has cut, the forces of the step's mode may be none that the laws
allow: a plate that cannot pull would pull, and ground that the body has left would push.
"""

from collections.abc import MutableMapping

import numpy as np

#: Height [m] up to which a step leaves a body that stands on the ground, by rounding.
_STANDING = 1e-15


def cut_to_laws(scene, quantities: MutableMapping[str, np.ndarray]) -> None:
    """Cut the forces of `quantities`, fields of `samples.Samples`, to what the laws of `scene`, a Scene, allow."""
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
