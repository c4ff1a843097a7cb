"""The energy accounts of a scene: what the motor and moving plates give, and who takes it.

Positive is what the robot receives. Over any time,

    motor + plates + unpaid + drive dampers + plate dampers + friction + blows + landings = change of stored energy

The stored energy is that of the moving masses and body, of the springs of drives and closed plates, and of heights.
Where a plate without tension lets go (`contact.CompliantContact`), what its spring still holds is lost to its damper.

`unpaid` is an artefact of the paper's equations: without the reaction the masses push the body and do not feel it, so
that the body receives work that nobody gives. With `effects.reaction` nothing is unpaid. The kinetic energy of the body
is then m1 V² / 2 and that of the masses includes the body's motion; without the reaction the body's equation is that of
a body of the total mass M.
"""

from collections.abc import Iterator

import numpy as np

from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.modes import ModeBuilder, ModeForms
from vibro_ros.model.scene import Scene
from vibro_ros.solver.system import NOTHING, AccountTable, terms

#: The accounts, by their numbers in the solver: `solver.accounts.SPLIT` and `RAMPS` come first.
ACCOUNTS = ("motor", "plates", "drive_dampers", "plate_dampers", "friction", "blows", "landings", "unpaid")
#: Those on which the robot loses energy.
LOSSES = ACCOUNTS[2:7]
_MOTOR, _PLATES, _DRIVE_DAMPERS, _PLATE_DAMPERS, _FRICTION, _BLOWS, _LANDINGS, _UNPAID = range(len(ACCOUNTS))

#: A power: its account, force and the channel of the velocity; and a stored energy: form, weight by mode, and account
#: of its change by a blow.
Power = tuple[int, Form | ModeForms, int]
Stored = tuple[Form, np.ndarray | float, int]


def account_table(builder: ModeBuilder, scene: Scene, guards: dict[str, np.ndarray]) -> AccountTable:
    """The accounts of a scene; empty unless the scene asks for them.

    Parameters
    ----------
    builder : ModeBuilder
        The scene's modes.
    scene : Scene
        The scene.
    guards : dict of str to ndarray
        The tables of guards (`guard_tables`).
    """
    forms, modes, booked = builder.forms, len(builder.modes), scene["solver.accounts"]
    powers = list(_powers(builder, scene)) if booked else []
    stored = list(_stored(builder, scene)) if booked else []
    force = np.zeros((modes, len(powers), forms.channels.count))
    stiffness = np.zeros((modes, len(stored)))
    for p, (_, form, _) in enumerate(powers):
        force[:, p] = form
    for e, (_, weight, _) in enumerate(stored):
        stiffness[:, e] = weight
    struck = [(k, _momentum(forms, scene, side)) for k, side in enumerate(forms.plates) if booked]
    decay = forms.channels.decay if forms.channels.decays else NOTHING
    driven = range(forms.channels.velocity(forms.channels.dynamic), forms.channels.velocity(forms.channels.coordinates))
    return AccountTable(
        force=force, terms=terms(force),
        rate=np.array([rate for *_, rate in powers], dtype=np.int64),
        account=np.array([account for account, *_ in powers], dtype=np.int64),
        force_in_piece=np.array([decay != NOTHING and form[:, decay].any() for form in force.swapaxes(0, 1)],
                                dtype=bool),
        rate_in_piece=np.array([rate in driven for *_, rate in powers], dtype=bool),
        stretch=np.array([form for form, *_ in stored]).reshape(len(stored), forms.channels.count),
        stiffness=stiffness,
        potential=np.array(_potential(forms, scene) if booked else forms.zero),
        jump=_jump_accounts(builder, guards, np.array([account for *_, account in stored], dtype=np.int64)),
        momentum=np.array([form for _, form in struck]).reshape(len(struck), forms.channels.count),
        struck=np.array([k for k, _ in struck], dtype=np.int64))


def _powers(builder: ModeBuilder, scene: Scene) -> Iterator[Power]:
    """Every force that does work, as the force on what moves with the velocity."""
    forms, channels = builder.forms, builder.forms.channels
    for i, side in enumerate(forms.guides):
        slider, mass = channels.signal_rate(i), channels.velocity(i)
        yield _MOTOR, -forms.drive_force(side), slider
        yield from _damper(_DRIVE_DAMPERS, scene[f"{side}.spring.damping"], forms.stretch(side)[1], mass, slider)
    for k, side in enumerate(forms.plates):
        plate, mass = channels.ramp_rate(k), channels.velocity(forms.guides.index(side))
        yield _PLATES, builder.while_pressing(side, -builder.contact_force(side)), plate
        if builder.has_compliant_plate(side):
            rate = builder.while_pressing(side, forms.penetration(side)[1])
            yield from _damper(_PLATE_DAMPERS, scene[f"{side}.plate.damping"], rate, mass, plate)
    yield from _powers_on_the_body(builder, scene)


def _damper(account: int, damping: float, rate: Form | ModeForms, mass: int, other: int) -> Iterator[Power]:
    """-c (q' - s')², as two forces -c (q' - s') and c (q' - s') on the damper's ends."""
    if damping > 0.0:
        yield account, -damping * rate, mass
        yield account, damping * rate, other


def _powers_on_the_body(builder: ModeBuilder, scene: Scene) -> Iterator[Power]:
    """Friction, and without the reaction what drives and lifts the body."""
    forms, paid = builder.forms, scene["effects.reaction"]
    if forms.body_moves:
        speed = forms.channels.velocity(forms.body)
        force, decayed = builder.friction_force().copy(), np.zeros_like(builder.friction_force())
        if forms.friction_decays:
            decayed[:, forms.channels.decay] = force[:, forms.channels.decay]
            force[:, forms.channels.decay] = 0.0
            yield _FRICTION, -decayed, speed
        yield _FRICTION, -force, speed
        if not paid:
            yield _UNPAID, builder.at_contact(forms.inertial_force), speed
    if forms.body_hops and not paid:
        lift = scene.total_mass * scene["gravity"] * forms.one - builder.at_contact(forms.normal_force)
        yield _UNPAID, np.where(builder.mode_set.airborne[:, None], lift, 0.0), forms.channels.velocity(forms.height)


def _stored(builder: ModeBuilder, scene: Scene) -> Iterator[Stored]:
    """Kinetic energies of the masses first, as `AccountTable.momentum` wants them."""
    forms, paid = builder.forms, scene["effects.reaction"]
    for i, side in enumerate(forms.guides):
        if paid:
            for part, rate in zip(scene.direction(side), forms.body_velocity(), strict=True):
                yield part * forms.velocity(i) + rate, scene[f"mass.{side}"], _BLOWS
        else:
            yield forms.velocity(i), scene[f"mass.{side}"], _BLOWS
    for rate in forms.body_velocity():
        yield rate, scene["mass.body"] if paid else scene.total_mass, _BLOWS if paid else _UNPAID
    for side in forms.guides:
        yield forms.stretch(side)[0], scene[f"{side}.spring.stiffness"], _BLOWS
    for side in filter(builder.has_compliant_plate, forms.plates):
        weight = np.where(builder.mode_set.pressing[side], scene[f"{side}.plate.stiffness"], 0.0)
        yield forms.penetration(side)[0], weight, _BLOWS


def _potential(forms: Forms, scene: Scene) -> Form:
    """Energy [J] of the heights of a body that hops, with its masses, and of masses that feel their weight."""
    height = scene.total_mass * scene["gravity"] * forms.position(forms.height) if forms.body_hops else forms.zero
    weights = (forms.weight(side) @ forms.one * forms.position(i) for i, side in enumerate(forms.guides))
    return sum(weights, height)


def _momentum(forms: Forms, scene: Scene, side: str) -> Form:
    """Momentum of a mass along its guide [N s], by which a shock of its plate is known."""
    velocity = forms.velocity(forms.guides.index(side))
    if scene["effects.reaction"]:
        velocity = velocity + forms.along(side, forms.body_velocity())
    return scene[f"mass.{side}"] * velocity


def _jump_accounts(builder: ModeBuilder, guards: dict[str, np.ndarray], at_blows: np.ndarray) -> np.ndarray:
    """Accounts of what a guard's jump changes, shape (modes, guards, stored energies)."""
    effect, plates = guards["guard_effect"][:, :, None], len(builder.forms.plates)
    others = np.where(builder.mode_set.airborne[:, None, None], _LANDINGS, _FRICTION)
    others = np.where((0 <= effect) & (effect < plates), _PLATE_DAMPERS, others)
    return np.where(guards["blow_monitor"][:, :, None] != NOTHING, at_blows, others)
