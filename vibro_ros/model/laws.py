"""A scene's contact and friction as laws for time stepping (`solver.laws`).

The rows are those of the model, multiplied by their masses, with r = 1 for the reaction on the masses and else 0:

    u: m2 (u'' + r y'') = -k2 (u - s_B) - c2 (u' - s_B') - m2 g - P        x: M x'' + m3 e_x w'' = -F_fr
    w: m3 (w'' + r (e_x x'' + e_y y'')) = ... - P                          y: M y'' + m2 u'' + m3 e_y w'' = N - M g

The row y is there for the rule `hop` alone; else its N is the normal force of the friction.
"""

import numpy as np

from vibro_ros.model.forms import Forms
from vibro_ros.model.modes import Mode
from vibro_ros.solver.laws import BACKWARD, FORWARD, STICK, WITHOUT_LOAD, Laws
from vibro_ros.solver.system import NOTHING

# Names of the friction's states by its outcome, as far as a scene has them, the first that it has.
_STATES = {STICK: ("stick", "grounded"), FORWARD: ("slip_forward", "grounded"),
           BACKWARD: ("slip_backward", "grounded"), WITHOUT_LOAD: ("unloaded", "airborne", "rest", "stick", "grounded")}


def contact_laws(scene, forms: Forms, modes: tuple[Mode, ...], step: float) -> Laws:
    """Laws of `scene` for steps of `step` [s]; `forms` and `modes` are those of its tables."""
    at, n = forms.channels, forms.channels.coordinates
    inertia, force = _inertia(scene, forms), _forces(scene, forms)
    stiffness, damping = -force[:, :n], -force[:, n:2 * n]
    load = force.copy()
    load[:, :2 * n] = 0.0
    inverse = np.linalg.inv(inertia + step * damping + step**2 * stiffness)
    gap = np.array([-forms.penetration(side)[0] for side in forms.plates]
                   + [forms.position(forms.height)] * forms.body_hops).reshape(-1, at.count)
    response = gap[:, :n] @ inverse.T  # a contact pushes where it widens its gap
    friction = _coefficients(scene, forms)
    slips = friction["holding"] > 0.0 and forms.body_moves
    return Laws(
        inertia=inertia, stiffness=stiffness, load=load, inverse=inverse, gap=gap, **_plates(scene, forms),
        response=response, compliance=np.einsum("ij,ij->i", gap[:, :n], response),
        slipping=forms.body if slips else NOTHING, **friction,
        slip_response=inverse[:, forms.body].copy() if slips else np.zeros(n),
        weight=scene.total_mass * scene["gravity"], swing=_swing(scene, forms),
        support=len(forms.plates) if forms.body_hops else NOTHING,
        negative=scene["effects.normal_force"] == "printed", mode=_mode_numbers(forms, modes))


def _inertia(scene, forms: Forms) -> np.ndarray:
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
            inertia[row, i] = mass * forms.direction(side)[part]
            inertia[i, row] = felt * inertia[row, i]
    return inertia


def _forces(scene, forms: Forms) -> np.ndarray:
    """Rows of all forces but the contacts' and the friction."""
    force = np.zeros((forms.channels.coordinates, forms.channels.count))
    for i, side in enumerate(forms.guides):
        force[i] = -forms.drive_force(side) - forms.weight(side)
    if forms.body_hops:
        force[forms.height] = -scene.total_mass * scene["gravity"] * forms.one
    return force


def _plates(scene, forms: Forms) -> dict[str, np.ndarray]:
    """The plates' laws, and the ground's, on which a landing is inelastic, if it is a contact."""
    ground = [0.0] * forms.body_hops
    rigid = [scene[f"effects.{side}_contact"] == "restitution" for side in forms.plates]
    return {
        "spring": np.array([scene[f"{side}.plate.stiffness"] for side in forms.plates] + ground),
        "damper": np.array([scene[f"{side}.plate.damping"] for side in forms.plates] + ground),
        "restitution": np.array([scene[f"{side}.plate.restitution"] for side in forms.plates] + ground),
        "rigid": np.array(rigid + [True] * forms.body_hops, dtype=bool),
        "pulls": np.array([scene["effects.adhesion"]] * len(forms.plates) + [False] * forms.body_hops, dtype=bool),
    }


def _coefficients(scene, forms: Forms) -> dict[str, float]:
    """mu of the slipping body, as it falls with its speed, and of the body at rest."""
    kinetic = scene["ground.friction"]
    if not scene.has_friction:
        return {"sliding": 0.0, "rise": 0.0, "fading": 0.0, "holding": 0.0}
    static, falls = scene.resting_friction, float(forms.friction_decays)
    return {"sliding": kinetic, "rise": falls * (static - kinetic), "fading": falls / scene["ground.stribeck_speed"],
            "holding": static}


def _swing(scene, forms: Forms) -> np.ndarray:
    """N - M g, eq. (6), by velocities in the place of accelerations."""
    swing = np.zeros(forms.channels.coordinates)
    if scene["effects.normal_force"] != "weight":
        for i, side in enumerate(forms.guides):
            swing[i] = scene[f"mass.{side}"] * forms.direction(side)[1]
    return swing


def _mode_numbers(forms: Forms, modes: tuple[Mode, ...]) -> np.ndarray:
    """Numbers of the modes by the outcomes of the laws."""
    by_state = {(mode.pressing, mode.friction): m for m, mode in reversed(list(enumerate(modes)))}
    frictions = {mode.friction for mode in modes}
    numbers = []
    for code in range(2 ** len(forms.plates)):
        bits = [code >> (len(forms.plates) - 1 - k) & 1 for k in range(len(forms.plates))]
        pressing = frozenset(side for side, bit in zip(forms.plates, bits, strict=True) if bit)
        for outcome in sorted(_STATES):
            friction = next(name for name in _STATES[outcome] if name in frictions)
            numbers.append(by_state[pressing, friction])
    return np.array(numbers)
