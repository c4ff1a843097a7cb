"""What the energy audit balances: the energy of the masses, and the power that the masses receive.

In the paper's model the masses' equations depend on nothing else, so that the energy of each guide balances alone. The
drive's spring is taken as if it were fixed where the slider is a rod's length l from the crank; what the slider adds by
its motion is part of the power, as are dampers, plates and weight:

    d/dt (m q'²/2 + k (q - l)²/2) = [k (q - l) - drive - plate - weight] q'

where `drive` and `plate` are the forces of the drive on the slider and of the mass on the plate. One product a guide is
all that the balance costs. With the reaction the masses exchange energy with the body, so that the audit includes the
body's kinetic energy, the work of friction and, for a body that hops, its height.
"""

from collections.abc import Iterator

import numpy as np

from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.modes import ModeBuilder, ModeForms
from vibro_ros.model.scene import Scene
from vibro_ros.solver.system import terms


def audit_tables(builder: ModeBuilder, scene: Scene) -> dict[str, np.ndarray]:
    """The fields of `solver.system.System` for the audit; empty unless the scene asks for the audit."""
    forms, audited = builder.forms, scene["solver.audit"]
    stored = list(_stored_energy(forms, scene)) if audited else []
    powers = list(_powers(builder, scene)) if audited else []
    force = np.empty((len(builder.modes), len(powers), forms.channels.count))
    rate = np.empty(force.shape[:2], dtype=np.int64)
    for p, (form, velocity) in enumerate(powers):
        force[:, p], rate[:, p] = form, velocity
    return {"stretch": np.array([form for _, form in stored]).reshape(len(stored), forms.channels.count),
            "stiffness": np.array([weight for weight, _ in stored]),
            "potential": np.array(_potential(forms, scene) if audited else forms.zero),  # zero cannot be written
            "power": force, "power_terms": terms(force), "power_rate": rate}


def _body_takes_part(forms: Forms, scene: Scene) -> bool:
    return scene["effects.reaction"] and (forms.body_moves or forms.body_hops)


def _stored_energy(forms: Forms, scene: Scene) -> Iterator[tuple[float, Form]]:
    """Weights w and forms e of the stored energy, sum of w e² / 2."""
    for i, side in enumerate(forms.guides):
        mass, velocity = scene[f"mass.{side}"], forms.velocity(i)
        if _body_takes_part(forms, scene):
            for part, rate in zip(scene.direction(side), forms.body_velocity(), strict=True):
                yield mass, part * velocity + rate
        else:
            yield mass, velocity
        yield scene[f"{side}.spring.stiffness"], _distance_from_rod(forms, scene, side)
    if _body_takes_part(forms, scene):
        yield from ((scene["mass.body"], rate) for rate in forms.body_velocity())


def _potential(forms: Forms, scene: Scene) -> Form:
    """Energy [J] of the height of a body that hops, with its masses."""
    if _body_takes_part(forms, scene) and forms.body_hops:
        return scene.total_mass * scene["gravity"] * forms.position(forms.height)
    return forms.zero


def _distance_from_rod(forms: Forms, scene: Scene, side: str) -> Form:
    """q - l [m]: how far the mass is from where its spring is taken to be fixed."""
    return forms.position(forms.guides.index(side)) - scene[f"crank.{side}_rod"] * forms.one


def _powers(builder: ModeBuilder, scene: Scene) -> Iterator[tuple[Form | ModeForms, int]]:
    """Forces [N] whose power changes the stored energy, and the channels of the velocities along them."""
    forms = builder.forms
    for i, side in enumerate(forms.guides):
        spring = scene[f"{side}.spring.stiffness"] * _distance_from_rod(forms, scene, side)
        force = spring - forms.drive_force(side) - forms.weight(side)
        if side in forms.plates:
            force = force - builder.while_pressing(side, builder.contact_force(side))
        yield force, forms.channels.velocity(i)
    if _body_takes_part(forms, scene) and forms.body_moves:
        yield -builder.friction_force(), forms.channels.velocity(forms.body)
