"""Shocks that strike the crank of a dc motor, through masses of the linkage that feel the body.

What a shock does is known from the mass matrix B of q = (x, y, u, w, θ) at the crank's angle.
"""

import itertools

import numpy as np
import pytest
from commanded_device import changed
from landing_by_impulse import struck
from mass_matrix import mass_matrix

import vibro_ros

LINKAGE = {"mass.upper_slider": 0.01, "mass.inclined_slider": 0.02, "mass.crank_pin": 0.05}
#: A dc motor that holds no current: nothing but shocks changes a speed at once.
STRUCK = LINKAGE | {"effects.motor": "dc", "motor.acceleration": 0.0, "motor.control": "speed_by_current",
                    "motor.proportional_gain": 0.0, "motor.integral_gain": 0.0, "effects.reaction": True,
                    "upper.gap": 0.002, "inclined.gap": 0.002, "guide.angle": 1.0, "mass.inclined": 0.3,
                    "upper.plate.restitution": 0.6, "inclined.plate.restitution": 0.0, "solver.accounts": True}
PLATE = 0.062
COORDINATES = {"upper": 2, "inclined": 3}
ANGLE = 0.7


def scene(*changes):
    return changed("rigid", STRUCK, {"effects.normal_force": "hop"}, *changes)


def speeds(state):
    return np.array([state.body_velocity, state.body_vertical_velocity, state.upper_velocity, state.inclined_velocity,
                     state.motor_speed])


def shaken(machine, **state):
    """Speeds after the shock at t = 0 of a machine that starts in this state, the kinds of events, and the accounts."""
    device = vibro_ros.Simulator(machine)
    device.set_state(**({"crank_angle": ANGLE, "upper_position": 0.05, "inclined_position": 0.05} | state))
    device.advance_to(0.0)
    return speeds(device.state), device.take_events()["kind"].tolist(), device.statistics["energy_accounts"]


@pytest.mark.parametrize("motor_speed", [40.0, 0.0, -0.05])
@pytest.mark.parametrize("body_speed", [0.0, 0.3, -0.3])
@pytest.mark.parametrize("side", COORDINATES)
@pytest.mark.parametrize("rule", ["hop", "airborne", "unilateral", "weight"])
def test_a_blow_is_an_impulse_between_a_mass_and_its_plate(rule, side, body_speed, motor_speed):
    """A71. B dq' = R e_i, and a force on y that holds the body there by the rules without a hop, so that the mass
    leaves the plate with its restitution: by Lagrange's multipliers, to rounding. A crank that is struck backwards
    turns back."""
    held = rule in ("unilateral", "weight")
    machine = scene({"effects.normal_force": rule if held else "hop", "motor.speed": motor_speed})
    state = {"motor_speed": motor_speed, "body_velocity": body_speed, f"{side}_position": PLATE,
             f"{side}_velocity": 1.3}
    speeds_before = np.array([body_speed, 0.0, 0.0, 0.0, motor_speed])
    if rule == "airborne":
        state |= {"body_height": 0.01, "body_vertical_velocity": 0.2}
        speeds_before[1] = 0.2
    i, matrix = COORDINATES[side], mass_matrix(machine, ANGLE)
    speeds_before[i] = 1.3
    rows = np.eye(5)[[i, 1] if held else [i]]
    change = [-(1.0 + machine[f"{side}.plate.restitution"]) * 1.3, 0.0][:len(rows)]
    whole = np.block([[matrix, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    expected = speeds_before + np.linalg.solve(whole, [0.0] * 5 + change)[:5]
    speeds_after, kinds, accounts = shaken(machine, **state)
    np.testing.assert_allclose(speeds_after, expected, rtol=1e-13, atol=1e-13)
    assert f"{side}_contact" in kinds
    lost = (speeds_before @ matrix @ speeds_before - expected @ matrix @ expected) / 2.0
    assert accounts["blows"] == pytest.approx(lost, abs=1e-14) and abs(accounts["residual"]) < 1e-14
    assert speeds_after[4] != motor_speed or (held and side == "upper")


def test_an_elastic_blow_keeps_the_energy():
    speeds_after, _, accounts = shaken(scene({"upper.plate.restitution": 1.0}), motor_speed=40.0, upper_position=PLATE,
                                upper_velocity=1.0)
    assert abs(speeds_after[4] - 40.0) > 0.5 and accounts["blows"] == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("restitution", [0.0, 0.6])
@pytest.mark.parametrize("friction", [{}, {"ground.friction": 1e-4, "ground.friction_backward": 0.4},
                                      {"effects.friction": "none"}], ids=["rough", "one-way", "ice"])
@pytest.mark.parametrize("motor_speed", [40.0, 0.0])
def test_a_landing_strikes_the_crank(motor_speed, friction, restitution):
    """A69. Routh's and Poisson's law in steps of the impulse on A, the inverse of B's part of the inverse; the other
    speeds by B, to rounding."""
    machine = scene(friction, {"ground.restitution": restitution, "motor.speed": motor_speed})
    coefficients = machine.kinetic_frictions if machine.has_dry_friction else (0.0, 0.0)
    for angle, speed in itertools.product((ANGLE, 2.5, 5.0), (-2.0, -0.05, -1e-3, 0.0, 1e-3, 0.05, 2.0)):
        inverse = np.linalg.inv(mass_matrix(machine, angle))
        speeds_before = np.array([speed, -0.5, 0.0, 0.0, motor_speed])
        after = struck(np.linalg.inv(inverse[:2, :2]), speed, 0.5, coefficients, coefficients, restitution)
        impulse = np.linalg.solve(inverse[:2, :2], after - speeds_before[:2])
        speeds_after, kinds, accounts = shaken(machine, crank_angle=angle, motor_speed=motor_speed, body_velocity=speed,
                                        body_vertical_velocity=-0.5)
        np.testing.assert_allclose(speeds_after, speeds_before + inverse[:, :2] @ impulse, rtol=1e-13, atol=1e-14)
        assert "landing" in kinds and abs(accounts["residual"]) < 1e-14


def test_a_mass_at_rest_on_its_plate_parts_from_a_body_that_lands_and_is_thrown_up():
    """The landing is that of a body with a free mass; only at a slow landing does the mass land together with the body.
    """
    for fall, parts in ((0.5, True), (1e-10, False)):
        device = vibro_ros.Simulator(scene({"motor.speed": 0.0, "inclined.gap": -0.03, "ground.restitution": 0.3}))
        device.advance_to(0.5)
        assert device.state.inclined_plate_force > 1.0
        device.set_state(body_height=1e-18, body_vertical_velocity=-fall)
        device.advance_to(device.time + 1e-15)
        assert (device.state.inclined_velocity < -1e-2) == parts
        assert (device.state.inclined_plate_force == 0.0) == parts


@pytest.mark.parametrize("changes", [{}, {"effects.normal_force": "unilateral"}], ids=["hop", "unilateral"])
def test_a_heavy_rotor_is_an_ideal_motor_and_no_mass_strikes_nothing(changes):
    """A73. The deviation is proportional to 1/J, or to the masses of the linkage, through some blows and landings."""
    free = {"motor.friction": 0.0, "motor.static_friction": 0.0, "motor.damping": 0.0, "motor.speed": 80.0,
            "ground.restitution": 0.4 * ("effects.normal_force" not in changes)}

    def end(*more):
        run = vibro_ros.simulate(scene(changes, free, *more), times=[0.0, 0.09])
        assert np.count_nonzero(np.char.endswith(run.events["kind"], "contact")) >= 3
        return np.array([run.body_position[1], run.upper_position[1], run.inclined_position[1]])

    ideal = end({"effects.motor": "ideal"})
    errors = [end({"motor.crank_inertia": inertia}) - ideal for inertia in (100.0, 200.0)]
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=1e-3)
    light = end(dict.fromkeys(LINKAGE, 0.0))
    errors = [end({name: share * mass for name, mass in LINKAGE.items()}) - light for share in (2e-5, 1e-5)]
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=1e-2)


@pytest.mark.parametrize("rule", ["hop", "unilateral"])
def test_rigid_plates_are_the_limit_of_stiff_ones(rule):
    """A73. A crank that feels every instant of an elastic contact: the error is of first order in 1/√k, the contact's
    duration."""
    free = {"effects.normal_force": rule, "motor.speed": 80.0, "start.state": "given", "start.crank_angle": 3.0,
            "start.upper_position": 0.045, "start.inclined_position": 0.045, "start.upper_velocity": 1.0,
            "start.inclined_velocity": 2.0, "upper.plate.restitution": 1.0, "inclined.plate.restitution": 1.0}
    times = np.linspace(0.0, 0.1, 51)
    rigid = vibro_ros.simulate(scene(free), times=times)
    assert np.count_nonzero(np.char.endswith(rigid.events["kind"], "contact")) >= 3
    apart = np.all([getattr(rigid, f"{s}_position") - getattr(rigid, f"{s}_plate_position") < -1e-3
                    for s in COORDINATES], axis=0)
    errors = []
    for stiffness in (1e8, 1e10):
        plates = {f"{side}.plate.stiffness": stiffness for side in COORDINATES}
        plates |= {f"effects.{side}_contact": "compliant" for side in COORDINATES} | {"solver.tolerance": 1e-6}
        soft = vibro_ros.simulate(scene(free, plates), times=times)
        errors.append([np.abs(getattr(soft, name) - getattr(rigid, name))[apart].max()
                       for name in ("body_position", "upper_position", "inclined_position", "crank_angle")])
    np.testing.assert_allclose(np.log10(np.divide(*errors)), 1.0, rtol=0, atol=0.15)


@pytest.mark.parametrize(("changes", "message"), [
    ({"guide.angle": 1.57}, "guide.angle: 1.57 rad lets a blow .* by way of a dc motor's crank .*more motor.crank_ine"),
    ({"mass.crank_pin": 2.0, "motor.crank_inertia": 0.0, "ground.friction": 2.5},
     "ground.friction: at 2.5 the reaction .*Painlevé.*give less than 2."),
])
def test_a_crank_that_would_jam_the_body_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        scene({"guide.angle": 0.5, "effects.upper_contact": "none", "mass.inclined": 0.08}, changes)
