"""The rule `hop`: lift-off, flight and inelastic landing of the body."""

import numpy as np
import pytest
from commanded_device import changed
from mass_matrix import mass_matrix

import vibro_ros

BODY, UPPER, INCLINED = 1.0, 0.1, 0.08
TOTAL, GRAVITY = BODY + UPPER + INCLINED, 9.81
HOP = {"effects.normal_force": "hop"}
REACTION = {"effects.reaction": True}
HEAVY = REACTION | {"effects.mass_weight": True}
STATIC = {"effects.friction": "static", "ground.static_friction": 0.4}
NO_CONTACT = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}
RUNNING = {"motor.speed": 100.0}


def scene(name, *changes):
    return changed(name, HOP, RUNNING, *changes)


def times_of(events, kind):
    return events["time"][events["kind"] == kind]


def samples_around(instants, machine):
    """Samples just before and after each of `instants`, shape (2 n,): 1e-9 s change no speed by more than 1e-5 m/s."""
    return vibro_ros.simulate(machine, times=np.ravel(np.column_stack((instants - 1e-9, instants + 1e-9))))


@pytest.mark.parametrize("changes", [{}, REACTION, HEAVY], ids=["no reaction", "reaction", "heavy"])
def test_the_centre_of_gravity_flies_on_a_parabola(changes):
    """A32. Rows x and y without the ground: M y + m2 u + m3 w cos φ = a + b t - M g t²/2 through every impact in
    the air, and M x' - m3 w' sin φ is constant; to the rounding of 0.05 kg m and 0.5 kg m/s."""
    machine = scene("damped", changes)
    angle = machine["guide.angle"]
    run = vibro_ros.simulate(machine, duration=1.0, rate=10000.0)
    moment = TOTAL * run.body_height + UPPER * run.upper_position + INCLINED * np.cos(angle) * run.inclined_position
    momentum = TOTAL * run.body_velocity - INCLINED * np.sin(angle) * run.inclined_velocity
    landings, struck = times_of(run.events, "landing"), 0
    for start in times_of(run.events, "lift_off"):
        flying = (run.time > start) & (run.time < np.min(landings[landings > start], initial=run.time[-1]))
        if np.count_nonzero(flying) < 20:
            continue
        t = run.time[flying] - run.time[flying][0]
        free = moment[flying] + TOTAL * GRAVITY * t**2 / 2
        line = np.polynomial.Polynomial.fit(t, free, 1)
        assert abs(free - line(t)).max() <= 1e-13
        assert np.ptp(momentum[flying]) <= 1e-12
        struck += any(start < instant < start + t[-1] for instant in times_of(run.events, "inclined_contact"))
    assert struck > 3


@pytest.mark.parametrize("changes", [{}, REACTION, HEAVY], ids=["no reaction", "reaction", "heavy"])
def test_a_landing_takes_the_energy_of_the_fall(changes):
    """A22. y'²/2 times the inertia that the ground feels, M, or 1/(B⁻¹)_yy with the mass matrix B of docs/robot.md.
    The 2 ns between the samples leave 1e-6 of it to everything else."""
    machine = scene("damped", {"effects.friction": "none"}, changes)
    inertia = mass_matrix(machine)
    if not machine["effects.reaction"]:
        inertia[:2, 2:] = 0.0
    felt = 1.0 / np.linalg.inv(inertia)[1, 1]
    landings = times_of(vibro_ros.simulate(machine, times=[1.0]).events, "landing")
    run = samples_around(landings, machine)
    v = np.array([run.body_velocity, run.body_vertical_velocity, run.upper_velocity, run.inclined_velocity])
    energy = np.einsum("ik,ij,jk->k", v, inertia, v) / 2
    fall = v[1, ::2]
    hard = fall < -0.05
    assert np.count_nonzero(hard) > 5
    np.testing.assert_allclose((energy[::2] - energy[1::2])[hard], (felt * fall**2 / 2)[hard], rtol=1e-4)


@pytest.mark.parametrize("excess", [-1e-6, 1e-6])
def test_the_ground_is_left_where_the_normal_force_would_vanish_and_not_before(excess):
    """The least N over a run is M g plus what does not depend on g, without reaction: that g decides, to 1e-6."""
    calm = NO_CONTACT | {"motor.speed": 40.0, "effects.friction": "none"}
    still = vibro_ros.simulate(scene("unilateral", calm, {"effects.normal_force": "printed"}), duration=1.0, rate=2e5)
    critical = GRAVITY - still.normal_force.min() / TOTAL
    run = vibro_ros.simulate(scene("unilateral", calm, {"gravity": critical * (1 + excess)}), times=[1.0])
    assert np.any(run.events["kind"] == "lift_off") == (excess < 0)


@pytest.mark.parametrize("gravity", [0.0, 1e-9, 1.0])
@pytest.mark.parametrize("changes", [{}, REACTION, HEAVY], ids=["no reaction", "reaction", "heavy"])
def test_a_normal_force_near_0_does_not_lock_up_the_simulation(gravity, changes):
    """With an N that is only rounding error, at rest, and with hardly any weight, running and stopped, no more events
    occur than the motion has.
    """
    for speed in (0.0, 30.0):
        device = vibro_ros.Simulator(scene("damped", changes, NO_CONTACT, {"gravity": gravity, "motor.speed": speed}))
        device.advance_to(0.5)
        device.command(motor_speed=0.0)
        device.advance_to(1.0)
        assert len(device.take_events()) < 500


@pytest.mark.parametrize("changes", [{}, REACTION, HEAVY, HEAVY | STATIC], ids=["none", "reaction", "heavy", "static"])
def test_hop_and_unilateral_agree_while_the_ground_is_pressed(changes):
    """A27. Where N > 0 all the time they are the same equations: 1e-13 m and m/s."""
    calm = NO_CONTACT | {"motor.speed": 40.0, "ground.friction": 0.05} | changes
    runs = [vibro_ros.simulate(scene("damped", calm, {"effects.normal_force": rule}), duration=2.0, rate=1000.0)
            for rule in ("hop", "unilateral")]
    assert runs[0].normal_force.min() > 0.0
    assert np.ptp(runs[0].body_position) > 1e-4
    for name in ("body_position", "body_velocity", "upper_position", "inclined_position", "normal_force"):
        np.testing.assert_allclose(getattr(runs[0], name), getattr(runs[1], name), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(runs[0].events, runs[1].events)
