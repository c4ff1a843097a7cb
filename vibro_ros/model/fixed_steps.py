"""What methods of fixed step need of a scene besides its compiled tables.

Contacts and friction as laws for Moreau's time stepping (`solver.laws`). The rows are those of the model, multiplied by
their masses, with r = 1 with the reaction on the masses and else 0:

    u: m2 (u'' + r y'') = -k2 (u - s_B) - c2 (u' - s_B') - m2 g - P        x: M x'' + m3 e_x w'' = -F_fr
    w: m3 (w'' + r (e_x x'' + e_y y'')) = ... - P                          y: M y'' + m2 u'' + m3 e_y w'' = N - M g

On a slope, with oil or a load, the row x has these forces as well (`Ground.driving_force`), and M g is M g cos(alpha).
The row y is there for the rule `hop` alone; by the other rules its N is the normal force of the friction.

Limits of the published forces. A step that does not see an event goes on in the old mode, whose forces may break the
laws: a plate that cannot pull would pull, and ground that the body has left would push.
"""

from collections.abc import MutableMapping
from typing import Any

import numpy as np

from vibro_ros.model.forms import Forms, pressed_only
from vibro_ros.model.ground import Ground
from vibro_ros.model.modes import Mode
from vibro_ros.model.scene import Scene
from vibro_ros.solver.moreau import BACKWARD, FORWARD, STICK, WITHOUT_LOAD, Laws
from vibro_ros.solver.system import NOTHING

#: Height [m] that rounding may give to a body that stands on the ground.
_STANDING = 1e-15
# States of the friction by the outcome of its law: the first of these states that a scene has.
_STATES = {STICK: ("stick", "grounded"), FORWARD: ("slip_forward", "grounded"),
           BACKWARD: ("slip_backward", "grounded"), WITHOUT_LOAD: ("unloaded", "airborne", "rest", "stick", "grounded")}


def contact_laws(scene: Scene, forms: Forms, modes: tuple[Mode, ...], step: float) -> Laws:
    """Laws of `scene` for steps of `step` [s]; `forms` and `modes` are those of the compiled scene."""
    at, n = forms.channels, forms.channels.coordinates
    inertia, force = _inertia(scene, forms), np.zeros((n, at.count))  # all forces but those of contacts and friction
    for i, side in enumerate(forms.guides):
        force[i] = -forms.drive_force(side) - forms.weight(side)
    if forms.body_moves:
        force[forms.body] = Ground(scene, forms).driving_force("slip_forward", forms.zero, forms.push[0] * forms.one)
    if forms.body_hops:
        force[forms.height] = (forms.push[1] - scene.total_mass * scene.gravity[1]) * forms.one
    stiffness, damping = -force[:, :n], -force[:, n:2 * n]
    load = force.copy()
    load[:, :2 * n] = 0.0
    inverse = np.linalg.inv(inertia + step * damping + step**2 * stiffness)
    gap = np.array([-forms.penetration(side)[0] for side in forms.plates]
                   + [forms.position(forms.height)] * forms.body_hops).reshape(-1, at.count)
    response = gap[:, :n] @ inverse.T  # a contact pushes where it widens its gap
    slips = scene.has_dry_friction and forms.body_moves
    (kinetic, _), (static, _), falls = scene.kinetic_frictions, scene.resting_frictions, float(forms.friction_decays)
    friction: dict[str, Any] = dict.fromkeys(("sliding", "rise", "fading", "holding"), 0.0)
    if scene.has_dry_friction:
        friction = {"sliding": kinetic, "rise": falls * (static - kinetic),
                    "fading": falls / scene["ground.stribeck_speed"], "holding": static}
    swing = np.zeros(n)  # factors [kg] of the accelerations in N - M g, eq. (6)
    if scene["effects.normal_force"] != "weight":
        for i, side in enumerate(forms.guides):
            swing[i] = scene[f"mass.{side}"] * scene.direction(side)[1]
    return Laws(
        inertia=inertia, stiffness=stiffness, load=load, inverse=inverse, gap=gap, **_plates(scene, forms),
        response=response, compliance=np.einsum("ij,ij->i", gap[:, :n], response),
        slipping=forms.body if slips else NOTHING, **friction,
        slip_response=inverse[:, forms.body].copy() if slips else np.zeros(n),
        weight=scene.total_mass * scene.gravity[1] - forms.push[1], swing=swing,
        support=len(forms.plates) if forms.body_hops else NOTHING,
        negative=scene["effects.normal_force"] == "printed", mode=_mode_numbers(forms, modes))


def cut_to_laws(scene: Scene, quantities: MutableMapping[str, np.ndarray]) -> None:
    """Cut the forces among `quantities`, fields of `Samples` by name, to what the laws of `scene` allow."""
    if pressed_only(scene):
        normal = np.maximum(quantities["normal_force"], 0.0)
        quantities["normal_force"] = np.where(quantities["body_height"] > _STANDING, 0.0, normal)
    bound = max(scene.resting_frictions) * np.abs(quantities["normal_force"])
    quantities["friction_force"] = np.clip(quantities["friction_force"], -bound, bound) + 0.0  # no -0.0
    for side in scene.plates:
        if scene[f"effects.{side}_contact"] == "restitution" or not (
                scene["effects.adhesion"] and scene[f"{side}.plate.damping"]):
            quantities[f"{side}_plate_force"] = np.maximum(quantities[f"{side}_plate_force"], 0.0)


def _inertia(scene: Scene, forms: Forms) -> np.ndarray:
    """Mass matrix of the rows [kg], shape (coordinates, coordinates)."""
    n = forms.channels.coordinates
    inertia, felt = np.zeros((n, n)), float(scene["effects.reaction"])
    rows = [forms.body] * forms.body_moves + [forms.height] * forms.body_hops
    parts = [0] * forms.body_moves + [1] * forms.body_hops
    for row in rows:
        inertia[row, row] = scene.total_mass
    for i, side in enumerate(forms.guides):
        mass = scene[f"mass.{side}"]
        inertia[i, i] = mass
        for row, part in zip(rows, parts, strict=True):
            inertia[row, i] = mass * scene.direction(side)[part]
            inertia[i, row] = felt * inertia[row, i]
    return inertia


def _plates(scene: Scene, forms: Forms) -> dict[str, Any]:
    """Laws of the plates and, by the rule `hop`, of the ground, where landings are inelastic: shape (contacts,)."""
    rigid = [scene[f"effects.{side}_contact"] == "restitution" for side in forms.plates]
    numbers = {field: np.array([scene[f"{side}.plate.{name}"] for side in forms.plates] + [0.0] * forms.body_hops)
               for field, name in (("spring", "stiffness"), ("damper", "damping"), ("restitution", "restitution"))}
    return numbers | {
        "rigid": np.array(rigid + [True] * forms.body_hops, dtype=bool),
        "pulls": np.array([scene["effects.adhesion"]] * len(forms.plates) + [False] * forms.body_hops, dtype=bool),
    }


def _mode_numbers(forms: Forms, modes: tuple[Mode, ...]) -> np.ndarray:
    """Numbers of the modes by the outcomes of the laws: which contacts press, as bits, then that of the friction."""
    by_state = {(mode.pressing, mode.ground): m for m, mode in reversed(list(enumerate(modes)))}
    frictions = {mode.ground for mode in modes}
    numbers = []
    for code in range(2 ** len(forms.plates)):
        bits = [code >> (len(forms.plates) - 1 - k) & 1 for k in range(len(forms.plates))]
        pressing = frozenset(side for side, bit in zip(forms.plates, bits, strict=True) if bit)
        for outcome in sorted(_STATES):
            friction = next(name for name in _STATES[outcome] if name in frictions)
            numbers.append(by_state[pressing, friction])
    return np.array(numbers)
