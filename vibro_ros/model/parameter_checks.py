"""Checks that refuse combinations of a scene's parameters; messages name the value, the limit and the remedy."""

import itertools
import math
from collections.abc import Iterable, Iterator

import numpy as np

from vibro_ros.model.parameter_values import ParameterValues
from vibro_ros.model.parameters import AS_FORWARD, AS_PRESET, BY_NAME

#: Fastest rate [1/s] of a mass on its springs and dampers that is simulated. A step lasts two of the mass's time
#: constants, so at this rate a simulated second takes 5e6 steps, some ten seconds. 1 g on 1e9 N/m reaches 1e6 1/s.
FASTEST_RATE = 1e7

LEAST_ROD = 1.001  # shortest rod of a slider that has a mass, as a multiple of the crank's radius
LEAST_MOTOR_INERTIA = 1e-9  # least inertia of a dc motor with its crank [kg m²]

#: Number of crank angles in a turn for which the body's inertia in a shock of the crank is computed, and the fraction
#: by which ratios of its elements may differ between two angles: the sharpest bend, of a slider at `LEAST_ROD`, is
#: 0.04 rad wide.
_ANGLES, _BETWEEN_ANGLES = 4096, 1e-3

#: Parameters for which a sensor's preset may give the number.
_OF_PRESET = [name for name, parameter in BY_NAME.items()
              if name.startswith("sensors.") and parameter.default == AS_PRESET]

#: Fraction of a mass's inertia that a yielding body must leave to the mass, so that ten digits survive rounding.
LEAST_INERTIA = 1e-6


def check_machine(values: ParameterValues) -> None:
    """Refuse a machine whose values contradict each other or that no method can simulate (ValueError)."""
    for check in (_check_mechanism, _check_dc_motor, _check_friction, _check_blows, _check_rates, _check_reaction,
                  _check_misprint):
        check(values)


def check_operation(values: ParameterValues) -> None:
    """Refuse values of motor, solver and sensors that contradict each other or the machine (ValueError)."""
    if values["effects.motor"] == "ramp" and values["motor.acceleration"] == 0.0:
        raise ValueError("motor.acceleration: 0 rad/s² lets no ramp motor change its speed; give a number above 0, "
                         "or choose ideal for effects.motor")
    _check_solver(values)
    _check_sensors(values)


def _check_mechanism(values: ParameterValues) -> None:
    radius = values["crank.radius"]
    for side in ("upper", "inclined"):
        rod = values[f"crank.{side}_rod"]
        if radius > rod:
            raise ValueError(f"crank.radius: {radius:g} m is longer than crank.{side}_rod, {rod:g} m, and would "
                             f"jam the mechanism; give a radius of at most {rod:g} m or a longer rod")
        if values[f"mass.{side}_slider"] > 0.0 and side not in values.guides:
            raise ValueError(f"mass.{side}_slider: {values[f'mass.{side}_slider']:g} kg would move on a guide that the "
                             f"scene leaves out with its mass; give 0, or true for effects.{side}_mass")
        if rod < LEAST_ROD * radius and f"{side}_slider" in values.linkage:
            raise ValueError(f"mass.{side}_slider: {values[f'mass.{side}_slider']:g} kg would be struck twice a turn, "
                             f"because the speed of a slider jumps whose rod, {rod:g} m, is as long as the crank; give "
                             f"0, or a crank.{side}_rod of at least {LEAST_ROD * radius:g} m")


def _check_dc_motor(values: ParameterValues) -> None:
    if not values.has_rotor:
        return
    friction, static, inertia = values["motor.friction"], values["motor.static_friction"], values.motor_inertia
    if static < friction:
        raise ValueError(f"motor.static_friction: {static:g} N·m is below motor.friction, {friction:g} N·m; give at "
                         f"least {friction:g} N·m")
    if inertia < LEAST_MOTOR_INERTIA:
        raise ValueError(f"motor.crank_inertia: {values['motor.crank_inertia']:g} kg·m² leaves the crank {inertia:g} "
                         f"kg·m², with the rotor's share; give at least {LEAST_MOTOR_INERTIA:g} kg·m² in all")
    resistance, inductance = values["motor.winding_resistance"], values["motor.winding_inductance"]
    if 0.0 < inductance < resistance / FASTEST_RATE:
        raise ValueError(f"motor.winding_inductance: {inductance:g} H lets the current change faster than "
                         f"{FASTEST_RATE:g} 1/s, which takes too long to simulate; give 0, or at least "
                         f"{resistance / FASTEST_RATE:g} H")
    stiffest = max(values.motor_constant**2 / resistance, values["motor.damping"]) / inertia
    if stiffest > FASTEST_RATE:
        raise ValueError(f"motor.crank_inertia: {values['motor.crank_inertia']:g} kg·m² lets the motor change its "
                         f"speed at {stiffest:.3g} 1/s, faster than {FASTEST_RATE:g} 1/s, which takes too long to "
                         "simulate; give more")
    for side in values.guides:
        rod, radius = values[f"crank.{side}_rod"], values["crank.radius"]
        if rod < LEAST_ROD * radius:
            raise ValueError(f"crank.{side}_rod: {rod:g} m is as long as the crank, whose slider's speed jumps, and a "
                             f"dc motor feels it; give at least {LEAST_ROD * radius:g} m")


def _check_friction(values: ParameterValues) -> None:
    kinetic, backward, law = values["ground.friction"], values["ground.friction_backward"], values["effects.friction"]
    if values.resting_frictions[0] < kinetic:
        raise ValueError(f"ground.static_friction: {values.resting_frictions[0]:g} is below ground.friction, "
                         f"{kinetic:g}; give at least {kinetic:g}")
    if AS_FORWARD < backward < 0.0:
        raise ValueError(f"ground.friction_backward: {backward:g} is below 0; give at least 0, or {AS_FORWARD:g} for "
                         "that of ground.friction")
    if backward not in (AS_FORWARD, kinetic) and law in ("static", "stribeck"):
        raise ValueError(f"ground.friction_backward: {backward:g} has no coefficient of its own for a body at rest by "
                         f"effects.friction {law!r}; choose coulomb, or give {AS_FORWARD:g}")
    if backward > BY_NAME["ground.friction"].maximum and values["effects.normal_force"] != "weight":
        raise ValueError(f"ground.friction_backward: {backward:g} makes a one-way wheel, which is sound only where N "
                         "is never 0, and elsewhere slides on its tyre; choose weight for effects.normal_force, or "
                         f"give at most {BY_NAME['ground.friction'].maximum:g}")
    # The friction coefficient at which the inertia of slipping body and inclined mass is singular. The coefficient is
    # at least twice the body's mass over the sum of all other masses, whatever the directions in which these move.
    largest = max(map(abs, values.slipping_frictions))
    others = values.total_mass - values["mass.body"]
    if (not values["effects.reaction"] or values["effects.normal_force"] == "weight"
            or largest * others < (1.0 - _BETWEEN_ANGLES) * 2.0 * values["mass.body"]):
        return
    (along, across), _ = np.moveaxis(_shock_inertia(values, values.guides), 0, -1)
    with np.errstate(divide="ignore"):
        highest = float((along / abs(across)).min()) * (1.0 - _BETWEEN_ANGLES * values.crank_is_struck)
    if values.has_dry_friction and largest >= highest:
        name = "ground.static_friction" if law == "stribeck" else (
            "ground.friction" if largest == kinetic else "ground.friction_backward")
        raise ValueError(f"{name}: at {largest:g} the reaction on the masses has no unique solution while "
                         f"the body slips (Painlevé's paradox); give less than {highest:g}, or set "
                         "effects.reaction to false")


def _check_blows(values: ParameterValues) -> None:
    """Refuse rigid plates where a rule of the normal force gives the friction of a blow no meaning."""
    rule, angle, friction = values["effects.normal_force"], values["guide.angle"], values.has_dry_friction
    rigid = [side for side in values.guides if values[f"effects.{side}_contact"] == "restitution"]
    if rigid and friction and rule == "printed":
        raise ValueError("effects.normal_force: 'printed' makes friction drive the body infinitely hard in a blow "
                         "on a rigid plate; choose unilateral or weight, or a compliant contact")
    if "inclined" in rigid and angle > math.pi / 2 and (rule == "hop" or (friction and rule == "unilateral")):
        raise ValueError(f"guide.angle: {angle:g} rad points the inclined guide down, where a blow on its rigid "
                         "plate presses the body on the ground; give at most 1.5708 rad, or a compliant contact")
    if "inclined" in rigid and values.crank_is_struck and (rule == "hop" or (friction and rule == "unilateral")):
        (along, across), _ = np.moveaxis(_shock_inertia(values, set(values.guides) - {"inclined"}), 0, -1)
        along_x, upwards = values.direction("inclined")
        if (along * upwards - across * along_x).min() < _BETWEEN_ANGLES * values.total_mass:
            raise ValueError(f"guide.angle: {angle:g} rad lets a blow on the rigid inclined plate press the body on "
                             "the ground, by way of a dc motor's crank at some of its angles; give a smaller angle, "
                             "more motor.crank_inertia, or a compliant contact")


def _check_rates(values: ParameterValues) -> None:
    """Refuse a mass that is so light for its springs and dampers that a simulation would take too long."""
    body = values["mass.body"]
    for force, (_, damper, spring) in values.ground_laws.items():
        for number, most in ((damper, FASTEST_RATE * body), (spring, FASTEST_RATE**2 * body)):
            if number > most:
                parameter = BY_NAME[force.parameter]
                raise ValueError(f"{parameter.name}: {number:g} {parameter.unit} moves mass.body, {body:g} kg, faster "
                                 f"than {FASTEST_RATE:g} 1/s, which takes too long to simulate; give at most {most:g} "
                                 f"{parameter.unit}")
    for side in values.guides:
        parts = ("spring", "plate") if values[f"effects.{side}_contact"] == "compliant" else ("spring",)
        stiffness = {f"{side}.{part}.stiffness": values[f"{side}.{part}.stiffness"] for part in parts}
        damping = {f"{side}.{part}.damping": values[f"{side}.{part}.damping"] for part in parts}
        # Bounds of the mass from w = sqrt(k / m), and from w < c / m where the damping prevails.
        by_spring, by_damper = sum(stiffness.values()) / FASTEST_RATE**2, sum(damping.values()) / FASTEST_RATE
        lightest, mass = max(by_spring, by_damper), values[f"mass.{side}"]
        if mass < lightest:
            name, value = max((stiffness if by_spring >= by_damper else damping).items(), key=lambda item: item[1])
            raise ValueError(f"{name}: {value:g} {BY_NAME[name].unit} moves mass.{side}, {mass:g} kg, faster than "
                             f"{FASTEST_RATE:g} 1/s, which takes too long to simulate; give a mass of at least "
                             f"{lightest:g} kg, or less stiffness and damping")


def _check_reaction(values: ParameterValues) -> None:
    """Refuse a body that yields so much that the masses become too fast or lose digits of their inertia."""
    if not (values["effects.reaction"] and values.guides) or _yields_little(values):
        return
    share, rate = least_inertia(values), fastest_rate(values)
    if share < LEAST_INERTIA:
        fault = (f"leaves the masses {share:.2g} of their inertia, less than the {LEAST_INERTIA:g} that rounding "
                 "allows")
    elif rate > FASTEST_RATE:
        fault = (f"lets the masses move at {rate:.3g} 1/s, faster than {FASTEST_RATE:g} 1/s, which takes too "
                 "long to simulate")
    else:
        return
    mass, remedy = values["mass.body"], ""
    while not remedy and (mass := 2.0 * mass) <= BY_NAME["mass.body"].maximum:
        heavier = ParameterValues("", {**values.parameters, "mass.body": mass})
        if least_inertia(heavier) >= LEAST_INERTIA and fastest_rate(heavier) <= FASTEST_RATE:
            remedy = f"at least {mass:.2g} kg, "
    raise ValueError(f"mass.body: {values['mass.body']:g} kg with effects.reaction {fault}; give {remedy}less "
                     "ground.friction, stiffness and damping, or set effects.reaction to false")


def _check_misprint(values: ParameterValues) -> None:
    if not values["effects.misprint"]:
        return
    false = "or set effects.misprint to false"
    if set(values.guides) != {"upper", "inclined"}:
        absent = next(side for side in ("upper", "inclined") if side not in values.guides)
        raise ValueError(f"effects.misprint: true puts the upper mass's position into the inclined plate's force, and "
                         f"effects.{absent}_mass is false; give true for effects.{absent}_mass, {false}")
    contact, stiffness = values["effects.inclined_contact"], values["inclined.plate.stiffness"]
    if contact != "compliant" or stiffness == 0.0:
        choice = f"inclined.plate.stiffness is {stiffness:g} N/m" if contact == "compliant" else (
            f"effects.inclined_contact is {contact!r}")
        raise ValueError("effects.misprint: true changes the force of the inclined plate's spring, and "
                         f"{choice}; choose compliant with a stiffness above 0 N/m, {false}")
    if values["effects.reaction"]:
        raise ValueError("effects.misprint: true gives the body a force that no mass gives back, against "
                         f"effects.reaction true; give false for effects.reaction, {false}")


def _check_solver(values: ParameterValues) -> None:
    """Refuse a tolerance that `exact` cannot keep because of rounding (`Simulator` warns if it is the default), and
    energy accounts with another method, whose errors would be in no account.
    """
    if values["solver.tolerance"] != BY_NAME["solver.tolerance"].default and (fault := values.broken_promise):
        raise ValueError(fault)
    if values["solver.accounts"] and values["solver.method"] != "exact":
        raise ValueError(f"solver.accounts: true needs solver.method exact, not {values['solver.method']}, whose "
                         "errors no account would hold; give false, or choose exact")


def _check_sensors(values: ParameterValues) -> None:
    for name in _OF_PRESET:
        if AS_PRESET < values[name] < 0.0:
            raise ValueError(f"{name}: {values[name]:g} is below 0; give at least 0, or {AS_PRESET:g} for the "
                             "preset's")
    for name in ("sensors.seed", "sensors.encoder.ticks"):
        if not values[name].is_integer():
            raise ValueError(f"{name}: {values[name]!r} is no whole number; give one")
    if values["sensors.current.rate"] and not values.has_rotor:
        raise ValueError(f"sensors.current.rate: {values['sensors.current.rate']:g} Hz, but only a dc motor has a "
                         "supply; give 0, or choose dc for effects.motor")
    if values["sensors.imu.bandwidth"] == 0.0:
        raise ValueError("sensors.imu.bandwidth: 0 Hz lets nothing pass; give a number above 0 Hz, or "
                         f"{AS_PRESET:g} for the preset's")
    if values["sensors.imu.rate"] and values["solver.method"] != "exact":
        raise ValueError(f"sensors.imu.rate: {values['sensors.imu.rate']:g} Hz needs solver.method exact, whose motion "
                         f"the low-pass follows, not {values['solver.method']}; give 0, or choose exact")


def _shock_inertia(values: ParameterValues, free: Iterable[str]) -> np.ndarray:
    """Return the inertia A [kg] of `model.shock`, shape (angles, 2, 2), in which the masses of `free` are free: over a
    turn if the crank is struck, else for one angle."""
    inertia = values.total_mass * np.eye(2)
    for side in free:
        inertia -= values[f"mass.{side}"] * np.outer(values.direction(side), values.direction(side))
    if not values.crank_is_struck:
        return inertia[None]
    angles, radius = np.arange(_ANGLES) * (2.0 * math.pi / _ANGLES), values["crank.radius"]
    crank, momentum = np.full(_ANGLES, values.motor_inertia), np.zeros((_ANGLES, 2))
    for part in values.linkage:
        mass = values[f"mass.{part}"]
        if part == "crank_pin":
            slope = radius * np.array([-np.cos(angles), -np.sin(angles)])
        else:
            side = part.removesuffix("_slider")
            psi, rod = angles - values.guide_angle(side), values[f"crank.{side}_rod"]
            rate = -np.sin(psi) * (1.0 + radius * np.cos(psi) / np.sqrt(rod**2 - (radius * np.sin(psi)) ** 2))
            slope = radius * np.multiply.outer(values.direction(side), rate)
        crank += mass * (slope * slope).sum(axis=0)
        momentum += mass * slope.T
    return inertia - momentum[:, :, None] * momentum[:, None, :] / crank[:, None, None]


# With `effects.reaction` a mass feels the body's acceleration, so that it moves as if it were lighter: in the air, on
# ground that does not hold the body, and most of all where friction nearly jams the body (Painlevé's paradox). Rows
# x and y of the equations give the body's acceleration from the accelerations of the masses, x'' = sum X_j q_j'' and
# y'' = sum Y_j q_j'', plus terms that do not depend on them. So the masses' own rows are I q'' = -C q' - K q with
# I = m (1 + e_x X + e_y Y).


def fastest_rate(values: ParameterValues) -> float:
    """Largest magnitude of an eigenvalue [1/s] of the masses on a yielding body, over all states of plates and body.

    It is the rate that limits the segments of the solver, and infinite where the body leaves the masses no inertia.
    """
    from vibro_ros.solver.equations import fastest_rates  # imports compiled code, which readers of bags do not need

    inertias, loads, n = np.array(list(_inertias(values))), np.array(list(_loads(values))), len(values.guides)
    try:
        rows = -np.linalg.solve(inertias[:, None], loads).reshape(-1, n, 2 * n)
    except np.linalg.LinAlgError:
        return np.inf
    return float(fastest_rates(rows[..., :n], rows[..., n:]).max(initial=0.0))


def _yields_little(values: ParameterValues) -> bool:
    """Return whether simple bounds show that the body leaves the masses enough inertia, and that they are slow enough.

    A mass on a resting body has I = m; the body subtracts products of m / M and of directions, which are at most 1 long
    (`_inertias`). With |I^-1| <= 1 / (share m), no eigenvalue exceeds |C| / (share m) + sqrt(|K| / (share m)).
    """
    masses = [values[f"mass.{side}"] for side in values.guides]
    slipping = max(map(abs, values.slipping_frictions)) if values.has_dry_friction else 0.0
    share = 1.0 - len(masses) * (1.0 + slipping) * max(masses) / values.total_mass
    if share < 0.1:
        return False
    stiffness, damping = (max((values[f"{side}.spring.{part}"] + values[f"{side}.plate.{part}"]) / mass
                              for side, mass in zip(values.guides, masses, strict=True))
                          for part in ("stiffness", "damping"))
    return damping / share + math.sqrt(stiffness / share) < FASTEST_RATE


def least_inertia(values: ParameterValues) -> float:
    """Least fraction of its own inertia that a mass, or a combination of the masses, keeps on a yielding body.

    The fraction is 1 where the body does not yield, and 0 where the body yields without resistance.
    """
    masses = np.array([values[f"mass.{side}"] for side in values.guides])
    shares = np.array(list(_inertias(values))) / masses[:, None]
    return float(np.linalg.svd(shares, compute_uv=False).min(initial=1.0))


def _inertias(values: ParameterValues) -> Iterator[np.ndarray]:
    """Yield the inertia I [kg], shape (n, n), on a body that slides without friction, slips, and is in the air."""
    rule, total = values["effects.normal_force"], values.total_mass
    masses = np.array([values[f"mass.{side}"] for side in values.guides])
    across, up = np.reshape([values.direction(side) for side in values.guides], (-1, 2)).T
    slipping = values.slipping_frictions if values.has_dry_friction and rule != "weight" else set()
    for friction in {0.0} | slipping:
        yield np.diag(masses) - np.outer(masses * across, masses * (across + friction * up)) / total
    if rule == "hop":
        yield np.diag(masses) - sum(np.outer(masses * part, masses * part) for part in (across, up)) / total


def _loads(values: ParameterValues) -> Iterator[np.ndarray]:
    """Yield stiffness K and damping C side by side, shape (n, 2 n), for every set of compliant plates in contact."""
    compliant = [side for side in values.plates if values[f"effects.{side}_contact"] == "compliant"]
    for count in range(len(compliant) + 1):
        for pressing in itertools.combinations(compliant, count):
            yield np.hstack([np.diag([
                values[f"{side}.spring.{part}"] + (side in pressing) * values[f"{side}.plate.{part}"]
                for side in values.guides]) for part in ("stiffness", "damping")])
