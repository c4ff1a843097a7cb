"""What the energy audit balances: the energy of the masses, and the power that the masses receive.

In the paper's model the masses' equations depend on nothing else, so that the energy of each guide balances alone:

    d/dt (m q'²/2 + k (q - s)²/2 + contact) = -drive s' - c (q' - s')² - plate E' - c (q' - E')²
        = -[c (q' - s') + c (q' - E')] q' + [c (q' - s') - drive] s' + [c (q' - E') - plate] E'

where `drive` and `plate` are the forces of the drive on the slider and of the mass on the plate. With the reaction the
masses exchange energy with the body, so that the audit includes the body's kinetic energy and the work of friction and,
for a body that hops, of gravity. The energy that a landing or a blow takes at once is lost between two segments and is
no part of the balance.
"""

from collections.abc import Iterator

import numpy as np

from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.modes import Mode, ModeBuilder
from vibro_ros.model.scene import Scene
from vibro_ros.solver.system import terms


def audit_tables(builder: ModeBuilder, scene: Scene) -> dict[str, np.ndarray]:
    """The fields of `solver.system.System` for the audit; empty unless the scene asks for the audit."""
    forms, modes = builder.forms, builder.modes
    stored: list[list] = [[] for _ in modes]
    power: list[list] = [[] for _ in modes]
    if scene["solver.audit"]:
        for m, mode in enumerate(modes):
            for side in forms.guides:
                stored[m] += _stored_energy(forms, scene, side, mode.closed)
                power[m] += _received_power(forms, scene, side, mode.closed)
                if side in mode.resting:
                    power[m].append((-builder.contact_force(mode, side), forms.plate(side)[1]))
            if scene["effects.reaction"]:
                stored[m] += [(scene["mass.body"], rate) for rate in forms.body_velocity() if rate.any()]
                power[m] += _body_power(builder, scene, mode)
    stretch = np.zeros((len(modes), max(map(len, stored)), forms.channels.count))
    stiffness = np.zeros(stretch.shape[:2])
    pairs = np.zeros((len(modes), max(map(len, power)), 2, forms.channels.count))
    for m in range(len(modes)):
        for e, (weight, form) in enumerate(stored[m]):
            stiffness[m, e], stretch[m, e] = weight, form
        for p, pair in enumerate(power[m]):
            pairs[m, p] = pair
    return {"stretch": stretch, "stiffness": stiffness, "power": pairs, "power_terms": terms(pairs)}


def _stored_energy(forms: Forms, scene: Scene, side: str, closed: frozenset[str]) -> Iterator[tuple[float, Form]]:
    """Weights w and forms e of the energy stored in one guide, sum of w e² / 2."""
    mass, velocity = scene[f"mass.{side}"], forms.velocity(forms.guides.index(side))
    if scene["effects.reaction"] and (forms.body_moves or forms.body_hops):
        for part, rate in zip(scene.direction(side), forms.body_velocity(), strict=True):
            yield mass, part * velocity + rate
    else:
        yield mass, velocity
    yield scene[f"{side}.spring.stiffness"], forms.stretch(side)[0]
    if side in closed:
        yield scene[f"{side}.plate.stiffness"], forms.penetration(side)[0]


def _body_power(builder: ModeBuilder, scene: Scene, mode: Mode) -> Iterator[tuple[Form, Form]]:
    """Forces [N] and speeds [m/s] whose products are the power of friction and, in the air, of the total weight."""
    along_x, upwards = builder.forms.body_velocity()
    if along_x.any():
        yield -builder.friction_force(mode), along_x
    if upwards.any():
        yield -scene.total_mass * scene["gravity"] * builder.forms.one, upwards


def _received_power(forms: Forms, scene: Scene, side: str, closed: frozenset[str]) -> Iterator[tuple[Form, Form]]:
    """Forces [N] and speeds [m/s] whose products are the power of slider, dampers and plate on one guide."""
    velocity, (_, rate) = forms.velocity(forms.guides.index(side)), forms.stretch(side)
    damper = scene[f"{side}.spring.damping"] * rate
    on_mass, on_slider = -damper, damper - forms.drive_force(side)
    if scene["effects.mass_weight"]:
        on_mass = on_mass - forms.weight(side)
    if side in closed:
        damper = scene[f"{side}.plate.damping"] * forms.penetration(side)[1]
        on_mass = on_mass - damper
        yield damper - forms.plate_force(side), forms.plate(side)[1]
    yield on_mass, velocity
    yield on_slider, velocity - rate
