"""Plates from soft to hardly compressible, and overdamped ones, against the exact contact of a free mass.

The mass of 0.1 kg floats at 0.08 m (no drive spring, motor stopped), and its plate comes down on it.
"""

import numpy as np
import pytest
from commanded_device import booked_energy

import vibro_ros

MASS, SPEED = 0.1, 1.0
FREE = vibro_ros.load_scene("paper").with_parameters({
    "motor.speed": 0.0, "effects.inclined_mass": False, "upper.spring.stiffness": 0.0, "upper.gap": 0.021,
    "gap_actuator.speed": SPEED, "solver.accounts": True})


def hit(changes, end=0.05, way=0.0):
    """State and the only contact after a plate 1 mm above the mass has come down at SPEED.

    `way`: how far [m] the mass goes in contact. Its place, 0.08 m, is rounded to 1.4e-17 m, and the force with it.
    """
    device = vibro_ros.Simulator(FREE.with_parameters(changes))
    device.command(upper_gap=-0.06)
    device.advance_to(end)
    events = device.take_events()
    contacts = events[events["kind"] == "upper_contact"]
    accounts = device.statistics["energy_accounts"]
    rounding = 1.4e-17 * device.scene["upper.plate.stiffness"] * way
    assert abs(accounts["residual"]) <= 1e-12 * booked_energy(accounts) + 1e-15 + 2.0 * rounding
    return device.state, contacts


@pytest.mark.parametrize("stiffness", [1e3, 1e7, 1e12])
def test_plates_of_any_stiffness(stiffness):
    """A8. π √(m/k) of contact, peak v √(km), exit speed -v; the places, 0.08 m, are rounded to 1.4e-17 m."""
    state, contacts = hit({"upper.plate.stiffness": stiffness}, way=SPEED * np.pi * np.sqrt(MASS / stiffness))
    (contact,) = contacts
    assert contact["time"] == pytest.approx(0.001, abs=1e-16)
    assert contact["duration"] == pytest.approx(np.pi * np.sqrt(MASS / stiffness), abs=1e-15)
    rounding = 2e-17 * np.sqrt(stiffness / MASS)  # of the two places that make a penetration, in depths
    assert contact["peak_force"] == pytest.approx(SPEED * np.sqrt(stiffness * MASS), rel=1e-13 + rounding)
    assert state.upper_velocity == pytest.approx(-2.0 * SPEED, rel=1e-13 + rounding)


@pytest.mark.parametrize("ratio", [1.0 + 1e-6, 100.0])
def test_an_overdamped_plate_without_tension_lets_go_where_its_force_vanishes(ratio):
    """m δ'' + c δ' + k δ = 0 with roots -a, -b: k δ + c δ' = -m δ'' is 0 where a² exp(-a t) = b² exp(-b t)."""
    rate = np.sqrt(1e7 / MASS)
    a, b = rate * (ratio - np.sqrt(ratio**2 - 1)), rate * (ratio + np.sqrt(ratio**2 - 1))
    end = 2.0 * np.log(b / a) / (b - a)
    exit_speed = SPEED / (b - a) * (b * np.exp(-b * end) - a * np.exp(-a * end))
    assert exit_speed < 0.0
    changes = {"upper.plate.damping": 2.0 * ratio * np.sqrt(1e7 * MASS), "effects.adhesion": False}
    state, contacts = hit(changes, way=SPEED * end)
    (contact,) = contacts
    assert contact["duration"] == pytest.approx(end, rel=1e-9)  # near ratio 1 the formula's b - a loses 3 digits
    assert state.upper_velocity + SPEED == pytest.approx(exit_speed, rel=1e-9)
    assert contact["peak_force"] == pytest.approx(2.0 * ratio * np.sqrt(1e7 * MASS) * SPEED, rel=1e-12)  # at entry


@pytest.mark.parametrize("ratio", [1.0, 10.0])
def test_an_overdamped_plate_that_may_pull_never_lets_go(ratio):
    """As printed: δ falls towards 0 and never reaches it, so the contact goes on and the mass follows the plate."""
    state, contacts = hit({"upper.plate.damping": 2.0 * ratio * np.sqrt(1e7 * MASS)}, way=0.049)
    assert len(contacts) == 0  # not ended
    assert state.upper_velocity == pytest.approx(-SPEED, abs=1e-9)
    # Over c/k = 2 ms, about 120 steps for the larger c, roundings of 3.5e-18 m a step add up.
    assert state.upper_position >= state.upper_plate_position - 4e-16


@pytest.mark.parametrize("nothing", [0.0, 5e-324, 9.9e-31])
def test_a_plate_without_stiffness_and_damping_is_no_plate(nothing):
    """Bits, events, modes and guards are those of a scene without the contact."""
    state, contacts = hit({"upper.plate.stiffness": nothing})
    assert state.upper_position == vibro_ros.Simulator(FREE).state.upper_position and state.upper_velocity == 0.0
    assert len(contacts) == 0
    paper = vibro_ros.load_scene("paper")
    soft = paper.with_parameters({"inclined.plate.stiffness": nothing, "inclined.plate.damping": nothing})
    bare = paper.with_parameters({"effects.inclined_contact": "none"})
    one, other = (vibro_ros.simulate(scene, duration=0.3, rate=1000.0) for scene in (soft, bare))
    for name in vars(one):
        if name not in ("events", "statistics"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(one.events, other.events)
    assert soft.describe() == bare.describe()
    assert "inclined" in paper.with_parameters({"inclined.plate.stiffness": 0.0, "inclined.plate.damping": 1.0}).plates


def test_a_preload_beyond_the_stroke_keeps_a_rigid_contact_closed():
    """The plate stands at 0.03 m, below all of the slider's way from 0.04 m on: the mass never leaves it."""
    scene = vibro_ros.load_scene("rigid").with_parameters({"upper.gap": -0.03, "effects.inclined_mass": False})
    run = vibro_ros.simulate(scene, duration=10.0, rate=1000.0)
    assert not run.upper_velocity.any() and (run.upper_position == 0.03).all()
    assert len(run.events) == 0
    slider = 0.02 * np.cos(100.0 * run.time) + np.sqrt(0.06**2 - (0.02 * np.sin(100.0 * run.time)) ** 2)
    np.testing.assert_allclose(run.upper_plate_force, 1e3 * (slider - 0.03), rtol=0, atol=1e-10)  # phase 1e3, rounded


@pytest.mark.parametrize(("kind", "restitution"), [("restitution", 0.5), ("restitution", 1.0), ("compliant", 1.0)])
@pytest.mark.parametrize("phase", [1.0, 2.0])
def test_a_plate_that_closes_onto_a_moving_mass(phase, kind, restitution):
    """u = s (1 - cos Ωt), s = 0.08 m, moves up; a plate that comes down at 10 m/s is timed to meet it at Ωt = phase."""
    meeting, time, plate = 0.08 * (1.0 - np.cos(phase)), phase / 100.0, 10.0
    device = vibro_ros.Simulator(vibro_ros.load_scene("paper").with_parameters({
        "motor.speed": 0.0, "effects.inclined_mass": False, "start.state": "zero", "effects.upper_contact": kind,
        "upper.plate.restitution": restitution, "upper.plate.stiffness": 1e12, "gap_actuator.speed": plate,
        "upper.gap": 0.06, "effects.normal_force": "weight", "solver.accounts": True}))
    device.advance_to(time - (0.12 - meeting) / plate)  # it waits at 0.12 m until then
    device.command(upper_gap=-0.06)
    device.advance_to(time + 2e-6)
    events = device.take_events()
    contact = events[events["kind"] == "upper_contact"][0]
    approach = 8.0 * np.sin(phase) + plate
    assert contact["time"] == pytest.approx(time, abs=1e-16)
    assert contact["speed"] == pytest.approx(approach, rel=1e-14)
    lasts = 0.0 if kind == "restitution" else np.pi * np.sqrt(MASS / 1e12)
    assert contact["duration"] == pytest.approx(lasts, rel=1e-4)
    # the drive spring changes the speed by 1e3 N/m * 0.08 m / 0.1 kg * 2e-6 s at most
    assert device.state.upper_velocity == pytest.approx(-restitution * approach - plate, abs=2e-3)
    accounts = device.statistics["energy_accounts"]
    # the plate's work among it; 3e6 N times a penetration rounded to 1e-17 m, and 5 J rounded
    assert abs(accounts["residual"]) <= 1e-11 * booked_energy(accounts) + 1e-14
