"""What the energy audit balances: the energy of the masses, and the power they receive.

The masses' equations close on themselves in the paper's model, so their energy does, too:

    d/dt (m q'²/2 + k (q - s)²/2 + contact) = -drive s' - c (q' - s')² - plate E' - c (q' - E')²

for each guide, with the drive's and the plate's forces on slider and plate. With the reaction on the masses
they exchange energy with the body, and the audit takes its kinetic energy and the work of friction and, where it
hops, of gravity in. What a landing or a blow takes at once falls between two segments and is no part of the balance.
"""

from collections.abc import Iterator

import numpy as np

from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.modes import Mode, ModeBuilder
from vibro_ros.solver.system import terms


def audit_tables(builder: ModeBuilder, scene) -> dict[str, np.ndarray]:
    """`stretch`, `stiffness` and `power` of `solver.system.System`; empty unless the scene asks for the audit."""
    forms, modes = builder.forms, builder.modes
    stored = [[] for _ in modes]
    power = [[] for _ in modes]
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


def _stored_energy(forms: Forms, scene, side: str, closed: frozenset[str]) -> Iterator[tuple[float, Form]]:
    """Weights and forms of the energy in one guide."""
    mass, velocity = scene[f"mass.{side}"], forms.velocity(forms.guides.index(side))
    if scene["effects.reaction"] and (forms.body_moves or forms.body_hops):
        for part, rate in zip(forms.direction(side), forms.body_velocity(), strict=True):
            yield mass, part * velocity + rate
    else:
        yield mass, velocity
    yield scene[f"{side}.spring.stiffness"], forms.stretch(side)[0]
    if side in closed:
        yield scene[f"{side}.plate.stiffness"], forms.penetration(side)[0]


def _body_power(builder: ModeBuilder, scene, mode: Mode) -> Iterator[tuple[Form, Form]]:
    """Pairs of forms of the power of friction and, where the body leaves the ground, of the weight of all."""
    along_x, upwards = builder.forms.body_velocity()
    if along_x.any():
        yield -builder.friction_force(mode), along_x
    if upwards.any():
        yield -scene.total_mass * scene["gravity"] * builder.forms.one, upwards


def _received_power(forms: Forms, scene, side: str, closed: frozenset[str]) -> Iterator[tuple[Form, Form]]:
    """Pairs of forms of the power that one guide receives from its slider, its dampers and its moving plate."""
    _, rate = forms.stretch(side)
    yield -forms.drive_force(side), forms.velocity(forms.guides.index(side)) - rate
    if scene["effects.mass_weight"]:
        yield -forms.weight(side), forms.velocity(forms.guides.index(side))
    if scene[f"{side}.spring.damping"]:
        yield -scene[f"{side}.spring.damping"] * rate, rate
    if side in closed:
        yield -forms.plate_force(side), forms.plate(side)[1]
        if scene[f"{side}.plate.damping"]:
            depth_rate = forms.penetration(side)[1]
            yield -scene[f"{side}.plate.damping"] * depth_rate, depth_rate
