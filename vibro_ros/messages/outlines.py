"""Sizes [m] that the equations do not need and a picture does: of the drawings, of the URDF and of its frames.

The equations count a mass's position from the crank's centre to the point where the drive spring is unstretched. So
the pictures set each mass and its plate farther out by the spring's length, `FREE_LENGTH`, along the guide.
"""

from vibro_ros.model.scene import Scene

FREE_LENGTH = 0.040
"""Of an unstretched drive spring, between slider and mass."""
MASS_HEIGHT = 0.016
"""Of a mass, along its guide."""
RAIL = 0.014
"""Distance of a guide's rail from its axis."""
HEADROOM = 0.014
"""From a plate to the end of its guide, with the plate's spring in it."""
CLEARANCE = 0.024
"""Least distance from the ground to the crank's pin, and to a guide's end."""


def guide_end(scene: Scene, side: str) -> float:
    """Distance [m] from the crank's centre to a guide's end, for the plate where the scene starts it."""
    plate = scene[f"crank.{side}_rod"] + max(0.0, scene[f"{side}.gap"])
    return plate + FREE_LENGTH + MASS_HEIGHT + HEADROOM


def hub_height(scene: Scene) -> float:
    """Height [m] of the crank's centre above the ground: crank and guides, also one that points down, stay above it."""
    depths = [-scene.direction(side)[1] * guide_end(scene, side) for side in scene.guides]
    return max(scene["crank.radius"], *depths, 0.0) + CLEARANCE
