"""The energy accounts of a scene: how much energy each source gives the robot, and each loss takes.

An account is positive if the robot receives energy. Over any time,

    motor + plates + unpaid + drive dampers + plate dampers + friction + blows + landings = change of stored energy

The stored energy is that of the moving masses and body, of the springs of drives and closed plates, and of heights.
Where a plate without tension lets go (`contact.CompliantContact`), the energy of its spring is lost to its damper.

`unpaid` is an artefact of the paper's equations: without the reaction the masses push the body and do not feel it, so
that the body receives work that no other part gives. With `effects.reaction` only the work of a push from outside is
unpaid. The kinetic energy of the body is then m1 V² / 2 and that of the masses includes the body's motion; without the
reaction the body's equation is that of a body of the total mass M.
"""

import functools
import math
from collections.abc import Iterator

import numpy as np

from vibro_ros.model.forms import Form, Forms, StanceForms
from vibro_ros.model.modes import ModeBuilder, ModeSet
from vibro_ros.model.scene import Scene
from vibro_ros.solver.system import NOTHING, AccountTable, GuardTable

#: The accounts, by their numbers in the solver: `solver.energy.MOTOR` and `RAMPS` come first.
ACCOUNTS = ("motor", "plates", "drive_dampers", "plate_dampers", "friction", "blows", "landings", "unpaid", "supply",
            "copper", "bearing")
OF_DC_MOTOR = ACCOUNTS[8:]  # accounts of a dc motor
LOSSES = (*ACCOUNTS[2:7], "copper", "bearing")  # accounts of energy that the robot loses
(_MOTOR, _PLATES, _DRIVE_DAMPERS, _PLATE_DAMPERS, _FRICTION, _BLOWS, _LANDINGS, _UNPAID, _SUPPLY, _COPPER,
 _BEARING) = range(len(ACCOUNTS))

#: A `Power` is an account, a force and the channel of the velocity along it. A `Stored` energy is a form, its weight by
#: mode, and the account of its change by a blow.
Power = tuple[int, Form | StanceForms, int]
Stored = tuple[Form, np.ndarray | float, int]


def account_table(builder: ModeBuilder, scene: Scene, guards: GuardTable) -> AccountTable:
    """Return the accounts of a scene with the tables `guards`; empty unless the scene asks for accounts."""
    forms, mode_set = builder.forms, builder.mode_set
    if not scene["solver.accounts"]:
        return _no_accounts(mode_set, guards.row.shape, forms.channels.count)
    powers, stored = list(_powers(builder, scene)), list(_stored(builder, scene))
    force = np.zeros((len(mode_set.stances), len(powers), forms.channels.count))
    stored_weight = np.zeros((len(mode_set.stances), len(stored)))
    for p, (_, form, _) in enumerate(powers):
        force[:, p] = form
    for e, (_, weight, _) in enumerate(stored):
        stored_weight[:, e] = weight
    # Momentum of a mass along its guide [N s]; its change in a jump is the shock of the plate.
    body = forms.body_velocity()
    momenta = [scene[f"mass.{side}"] * (forms.velocity(forms.guides.index(side)) + (
        forms.along(side, body) if scene["effects.reaction"] else 0.0)) for side in forms.plates]
    # Energy [J] of the heights of a body that hops, with its masses, and of masses that feel their weight.
    weights = [forms.weight(side)[forms.channels.one] * forms.position(i) for i, side in enumerate(forms.guides)]
    if scene["effects.mass_weight"]:
        downhill, down = scene.gravity
        weights += [part.mass * (part.direction[0] * downhill + part.direction[1] * down) * forms.units[
            forms.channels.signal(part.signal)] for part in forms.linkage]
    stored_linear = sum(weights, _height(forms, scene))
    force_by_mode, terms = mode_set.with_terms(force)
    return AccountTable(
        force=force_by_mode, terms=terms,
        rate=np.array([rate for *_, rate in powers], dtype=np.int64),
        account=np.array([account for account, *_ in powers], dtype=np.int64),
        stored_form=np.array([form for form, *_ in stored]).reshape(len(stored), forms.channels.count),
        stored_weight=stored_weight[mode_set.stance],
        stored_linear=np.array(stored_linear),
        jump=_jump_accounts(builder, guards, np.array([account for *_, account in stored], dtype=np.int64)),
        momentum=np.array(momenta).reshape(len(momenta), forms.channels.count),
        struck=np.arange(len(momenta), dtype=np.int64))


@functools.lru_cache(maxsize=64)
def _no_accounts(mode_set: ModeSet, guards: tuple[int, ...], count: int) -> AccountTable:
    """Return no accounts, for `guards` of this shape, (modes, guards of a mode), and so many channels."""
    modes, numbers = len(mode_set.modes), np.empty(0, np.int64)
    return AccountTable(
        force=np.empty((modes, 0, count)), terms=np.empty((modes, 0, count), np.int64), rate=numbers, account=numbers,
        stored_form=np.empty((0, count)), stored_weight=np.empty((modes, 0)), stored_linear=np.zeros(count),
        jump=np.empty((*guards, 0), np.int64), momentum=np.empty((0, count)), struck=numbers)


def _kinetic_energies(forms: Forms, scene: Scene, with_body: bool) -> Iterator[tuple[Form, float]]:
    """Yield velocities of the masses, each with the mass [kg]; along x and y if they include the body's motion."""
    for i, side in enumerate(forms.guides):
        parts = zip(scene.direction(side), forms.body_velocity(), strict=True)
        velocities = [part * forms.velocity(i) + rate for part, rate in parts] if with_body else [forms.velocity(i)]
        yield from ((velocity, scene[f"mass.{side}"]) for velocity in velocities)


def _height(forms: Forms, scene: Scene) -> Form:
    """Energy [J] of the height of a body that hops or is on a slope, with its masses."""
    energy: Form = forms.zero
    if forms.body_hops:
        energy = energy + scene.total_mass * scene.gravity[1] * forms.position(forms.height)
    for force, (constant, _, _) in scene.ground_laws.items():
        if not force.account:
            energy = energy + constant * forms.position(forms.body)
    return energy


def _powers(builder: ModeBuilder, scene: Scene) -> Iterator[Power]:
    """Yield every force that does work, with the channel of the velocity of its point of attack."""
    forms, channels = builder.forms, builder.forms.channels
    for i, side in enumerate(forms.guides):
        slider, mass = channels.signal_rate(i), channels.velocity(i)
        yield _MOTOR, -forms.drive_force(side), slider
        yield from _damper(_DRIVE_DAMPERS, scene[f"{side}.spring.damping"], forms.stretch(side)[1], mass, slider)
    for part in forms.linkage:
        yield _MOTOR, builder.linkage_force(part), channels.signal_rate(part.signal)
    for k, side in enumerate(forms.plates):
        plate, mass = channels.ramp_rate(k), channels.velocity(forms.guides.index(side))
        yield _PLATES, builder.while_pressing(side, -builder.contact_force(side)), plate
        if builder.has_compliant_plate(side):
            rate = builder.while_pressing(side, forms.penetration(side)[1])
            yield from _damper(_PLATE_DAMPERS, scene[f"{side}.plate.damping"], rate, mass, plate)
    if motor := builder.motor:
        current, speed = channels.velocity(forms.charge), channels.velocity(forms.phase)
        yield _SUPPLY, builder.by_motor_state(lambda bearing, loop: motor.voltage(loop)), current
        yield _COPPER, -motor.resistance * motor.current, current
        yield _BEARING, builder.by_motor_state(lambda bearing, loop: -motor.bearing_torque(bearing)), speed
    has_reaction = scene["effects.reaction"]  # else no part gives the work of the forces that drive and lift the body
    if forms.body_moves:
        speed = channels.velocity(forms.body)
        for force, (constant, damping, _) in scene.ground_laws.items():
            if force.account:
                yield ACCOUNTS.index(force.account), -constant * forms.one - damping * forms.velocity(forms.body), speed
        if builder.ground.has_dry_friction:
            yield _FRICTION, -builder.friction_force(), speed
        if not has_reaction:
            yield _UNPAID, builder.at_contact(forms.inertial_force), speed
    for coordinate, push in zip((forms.body, forms.height), forms.push, strict=True):
        if push and has_reaction:  # a push is part of F_in and N
            yield _UNPAID, push * forms.one, channels.velocity(coordinate)
    if forms.body_hops and not has_reaction:
        lift = scene.total_mass * scene.gravity[1] * forms.one - builder.at_contact(forms.normal_force)
        yield _UNPAID, np.where(builder.mode_set.airborne[:, None], lift, 0.0), channels.velocity(forms.height)


def _damper(account: int, damping: float, rate: Form | StanceForms, mass: int, other: int) -> Iterator[Power]:
    """Yield the power -c (q' - s')² as two forces, -c (q' - s') and c (q' - s'), on the damper's ends."""
    if damping > 0.0:
        yield account, -damping * rate, mass
        yield account, damping * rate, other


def _stored(builder: ModeBuilder, scene: Scene) -> Iterator[Stored]:
    """Yield the stored energies; those of the masses come first, as `AccountTable.momentum` requires."""
    forms, has_reaction = builder.forms, scene["effects.reaction"]
    yield from ((velocity, mass, _BLOWS) for velocity, mass in _kinetic_energies(forms, scene, has_reaction))
    with_body = math.fsum(scene[f"mass.{part}"] for part in ("body", *scene.linkage))  # without the masses on guides
    for rate in forms.body_velocity():
        yield rate, with_body if has_reaction else scene.total_mass, _BLOWS if has_reaction else _UNPAID
    # With V the body's velocity, m (s' + e V)²/2 - m (e V)²/2, because m V²/2 belongs to the body. The crank gives the
    # change of this energy in a shock of the body.
    for part in forms.linkage:
        rate, (speed, rise) = forms.units[forms.channels.signal_rate(part.signal)], forms.body_velocity()
        of_body = float(has_reaction) * (part.direction[0] * speed + part.direction[1] * rise)
        account = _BLOWS if forms.has_rotor else _MOTOR  # a crank that is struck pays as the body does
        yield rate + of_body, part.mass, account
        yield of_body, -part.mass, account
    if builder.motor:
        yield builder.motor.speed, builder.motor.inertia, _BLOWS
        yield builder.motor.current, builder.motor.inductance, _BLOWS
    for side in forms.guides:
        yield forms.stretch(side)[0], scene[f"{side}.spring.stiffness"], _BLOWS
    for _, _, stiffness in scene.ground_laws.values():
        if stiffness:
            yield forms.position(forms.body), stiffness, _BLOWS
    for side in filter(builder.has_compliant_plate, forms.plates):
        weight = np.where(builder.mode_set.pressing[side], scene[f"{side}.plate.stiffness"], 0.0)
        yield forms.penetration(side)[0], weight, _BLOWS


def _jump_accounts(builder: ModeBuilder, guards: GuardTable, at_blows: np.ndarray) -> np.ndarray:
    """Return the accounts of the energy changes in a guard's jump, shape (modes, guards, stored energies)."""
    effect, plates, mode_set = guards.effect[:, :, None], len(builder.forms.plates), builder.mode_set
    others = np.where(mode_set.airborne[mode_set.stance][:, None, None], _LANDINGS, _FRICTION)
    others = np.where((0 <= effect) & (effect < plates), _PLATE_DAMPERS, others)
    is_blow_or_motor = (guards.blow_monitor[:, :, None] != NOTHING) | (at_blows == _MOTOR)
    return np.where(is_blow_or_motor, at_blows, others)
