"""The effects that the peer simulates, so that the peer refuses an effect that the model has and the peer has not."""

from vibro_ros.model.scene import Scene

#: Every effect that `equations.Equations` has, and its values.
KNOWN = {
    "effects.upper_mass": (True, False), "effects.inclined_mass": (True, False),
    "effects.upper_contact": ("compliant", "restitution", "none"),
    "effects.inclined_contact": ("compliant", "restitution", "none"), "effects.adhesion": (True, False),
    "effects.friction": ("coulomb", "static", "stribeck", "none"),
    "effects.normal_force": ("weight", "unilateral", "printed", "hop"),
    "effects.reaction": (True, False), "effects.misprint": (True, False), "effects.mass_weight": (True, False),
    "effects.motor": ("ideal", "ramp", "lag"), "start.state": ("rest", "zero", "given"),
}


def refuse_unknown(scene: Scene) -> None:
    """Raise ValueError for an effect of the scene, or a value of one, that is not among `KNOWN`."""
    effects = {name: value for name, value in scene.parameters.items() if name.startswith("effects.") or name in KNOWN}
    for name, value in effects.items():
        if value not in KNOWN.get(name, ()):
            raise ValueError(f"scene {scene.name}: the peer has no {name} {value!r}")
