"""The energy accounts, against integrals of the samples, exact answers and each other."""

import dataclasses
import math

import numpy as np
import pytest
from commanded_device import booked_energy as flow
from commanded_device import changed
from exact_motion import slider
from scipy.integrate import cumulative_simpson

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.simulation.motion import new_stepper

BOOKED = {"solver.accounts": True, "motor.speed": 100.0}
REACTION, HOP = {"effects.reaction": True}, {"effects.normal_force": "hop"}
STRIBECK = {"effects.friction": "stribeck", "ground.static_friction": 0.35, "ground.stribeck_speed": 0.02,
            "upper.gap": 1e-3, "inclined.gap": 1e-3, "motor.speed": 92.0}
LAG = {"effects.motor": "lag", "motor.time_constant": 0.2}
RAMP = {"effects.motor": "ramp", "motor.speed": 60.0}
LINKAGE = {"mass.upper_slider": 0.02, "mass.inclined_slider": 0.03, "mass.crank_pin": 0.01}
FALLING = {"motor.speed": 0.0, "effects.friction": "none", "start.state": "zero", "effects.mass_weight": True,
           "inclined.spring.stiffness": 0.0, "effects.upper_mass": False, "guide.angle": math.pi}


def scene(name, *changes):
    return changed(name, BOOKED, *changes)


def accounts(machine, duration=1.0, commands=()):
    return vibro_ros.simulate(machine, duration=duration, rate=10.0, commands=commands).statistics["energy_accounts"]


@pytest.mark.parametrize("changes", [{}, REACTION, HOP, REACTION | HOP, REACTION | {"effects.mass_weight": True}, LAG,
                                     REACTION | STRIBECK | {"effects.normal_force": "unilateral"},
                                     REACTION | STRIBECK | HOP | {"ground.restitution": 0.4}, LAG | LINKAGE,
                                     REACTION | HOP | RAMP | LINKAGE, {"ground.friction_backward": 0.6}],
                         ids=["own", "reaction", "hop", "reaction hop", "weight", "lag", "stribeck", "stribeck hop",
                              "linkage", "linkage hop", "backward"])
@pytest.mark.parametrize("name", ["unilateral", "damped", "device"])
def test_accounts_balance(name, changes):
    """A30, A56, A59. With commands and moving plates, to 1e-13 of the energy that is exchanged."""
    commands = [(0.3, {"motor_speed": 140.0, "upper_gap": 4e-4}), (0.61, {"inclined_gap": -3e-4})]
    booked = accounts(scene(name, changes), commands=commands)
    assert abs(booked["residual"]) <= 1e-13 * flow(booked)
    assert booked["plates"] != 0.0
    assert (booked["unpaid"] == 0.0) == (changes.get("effects.reaction", name == "device"))


@pytest.mark.parametrize("name", shipped_scenes())
def test_accounts_change_no_bit(name):
    runs = [vibro_ros.simulate(scene(name, {"solver.accounts": booked}), duration=1.0, rate=500.0)
            for booked in (True, False)]
    np.testing.assert_array_equal(runs[0].events, runs[1].events)
    for field in ("body_position", "inclined_velocity", "normal_force"):
        np.testing.assert_array_equal(getattr(runs[0], field), getattr(runs[1], field))
    assert "energy_accounts" not in runs[1].statistics


def integral(values, times):
    return float(cumulative_simpson(values, x=times)[-1])


@pytest.mark.parametrize("changes", [{}, STRIBECK, LAG], ids=["coulomb", "stribeck", "lag"])
def test_accounts_are_the_integrals_of_the_sampled_powers(changes):
    """With samples every 2 µs the sums are off by some 1e-6 of the exchanged energy where a power jumps. The motor with
    a lag is slow at first.
    """
    machine = scene("damped", changes)
    times = np.linspace(0.0, 0.5, 250_001)
    run = vibro_ros.simulate(machine, times=times)
    booked = run.statistics["energy_accounts"]
    # Drive force = -k (q - s) - c (q' - s'), so that the damper's rate follows from the slider.
    drive = sum(integral(np.gradient(_stretch(run, machine, side), times, edge_order=2)**2, times)
                * machine[f"{side}.spring.damping"] for side in machine.guides)
    plate = sum(_integral_over_contacts(machine, run.events, side) * machine[f"{side}.plate.damping"]
                for side in machine.plates)
    expected = {
        "motor_delivered": integral(np.maximum(run.motor_power, 0.0), times),
        "motor_taken_back": integral(np.maximum(-run.motor_power, 0.0), times),
        "drive_dampers": drive, "plate_dampers": plate,
        "friction": integral(run.friction_force * run.body_velocity, times)}
    for name, amount in expected.items():
        assert booked[name] == pytest.approx(amount, abs=5e-6 * flow(booked)), name
        assert amount > 1e-3 * flow(booked)


def _integral_over_contacts(machine, events, side):
    """Integral of a mass's squared velocity over its contacts, which are sampled from end to end [m²/s]."""
    contacts = events[events["kind"] == f"{side}_contact"]
    times = [np.linspace(begin, begin + duration, 2001) for begin, duration in contacts[["time", "duration"]]]
    run = vibro_ros.simulate(machine, times=np.concatenate(times))
    squares = getattr(run, f"{side}_velocity").reshape(-1, 2001)**2
    return math.fsum(integral(of_contact, at) for of_contact, at in zip(squares, times, strict=True))


def _stretch(run, machine, side):
    """Return q - s [m] by the paper's eqs. (2) and (3), from the crank's angle."""
    angle = run.crank_angle - machine.guide_angle(side)
    return getattr(run, f"{side}_position") - slider(angle, machine["crank.radius"], machine[f"crank.{side}_rod"])


def test_blows_take_the_energy_that_the_restitution_implies():
    """A mass falls onto a rigid plate below: every blow takes m v² (1 - e²) / 2."""
    run = vibro_ros.simulate(scene("rigid", FALLING, {"inclined.plate.restitution": 0.7}), duration=0.7, rate=10.0)
    speeds = run.events["speed"][run.events["kind"] == "inclined_contact"]
    booked = run.statistics["energy_accounts"]
    assert len(speeds) > 3
    assert booked["blows"] == pytest.approx(0.5 * 0.08 * (1.0 - 0.7**2) * math.fsum(speeds**2), rel=1e-13)
    assert booked["motor_delivered"] == booked["motor_taken_back"] == booked["friction"] == 0.0
    assert booked["stored"] == pytest.approx(-booked["blows"], rel=1e-13)


def test_a_moving_rigid_plate_works_by_its_blows():
    """The plate meets a mass at rest with its speed V: by restitution the mass leaves with (1 + e) V. The plate gives
    the shock's m (1 + e) V times V, of which m V² (1 - e²) / 2 is lost."""
    machine = scene("rigid", {"motor.speed": 0.0, "effects.upper_mass": False, "inclined.spring.stiffness": 0.0,
                              "effects.friction": "none", "gap_actuator.speed": 0.5, "inclined.plate.restitution": 0.6})
    device = vibro_ros.Simulator(machine)
    device.command(inclined_gap=-0.05)
    while not (events := device.take_events()).size:
        device.advance_to(device.time + 1e-3)
    booked, speed, mass = device.statistics["energy_accounts"], 0.5, machine["mass.inclined"]
    [blow] = events
    assert blow["speed"] == pytest.approx(speed, rel=1e-14)
    assert booked["plates"] == pytest.approx(mass * 1.6 * speed**2, rel=1e-14)
    assert booked["blows"] == pytest.approx(0.5 * mass * speed**2 * (1.0 - 0.6**2), rel=1e-14)
    assert booked["stored"] - booked["unpaid"] == pytest.approx(0.5 * mass * (1.6 * speed) ** 2, rel=1e-14)


def test_landings_take_the_energy_of_the_fall():
    """Without friction and masses' weight the body alone lands: M y'² / 2 of each landing."""
    machine = scene("device", {"effects.reaction": False, "effects.mass_weight": False, "effects.friction": "none"})
    run = vibro_ros.simulate(machine, duration=1.0, rate=10.0)
    falls = run.events["speed"][run.events["kind"] == "landing"]
    assert len(falls) > 10
    lost = 0.5 * machine.total_mass * math.fsum(falls**2)
    assert run.statistics["energy_accounts"]["landings"] == pytest.approx(lost, rel=1e-12)


def missing_share(name, factor=1.0):
    """Return the share of the exchanged energy that does not balance within 1 s, if the upper mass's spring pulls
    `factor` times as hard as it should.
    """
    machine = scene(name)
    device = vibro_ros.Simulator(machine)
    original = device._motion.model
    acceleration = original.system.equations.copy()
    acceleration[:, 0, 0] *= factor
    device._motion.model = dataclasses.replace(original, system=original.system._replace(equations=acceleration))
    device._motion.stepper = new_stepper(machine, device._motion.model)
    device.advance_to(1.0)
    booked = device.statistics["energy_accounts"]
    return abs(booked["residual"]) / flow(booked)


@pytest.mark.parametrize("name", ["unilateral", "rigid", "device"])
def test_an_exact_motion_balances_and_a_wrong_equation_shows(name):
    """Blows of rigid plates and landings are in the balance; a force wrong by 1e-9 of itself leaves a residual."""
    assert missing_share(name) < 1e-13
    assert missing_share(name, 1.0 + 1e-9) > 1e-11
