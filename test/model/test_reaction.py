"""The body's acceleration on the masses, and their weight: known answers A25, A29 to A31, limits and equivalents."""

import numpy as np
import pytest
from commanded_device import changed as scene

import vibro_ros

ANGLE = 0.8726646259971648
SINE, COSINE = np.sin(ANGLE), np.cos(ANGLE)
GRAVITY = 9.81
BODY, UPPER, INCLINED = 1.0, 0.1, 0.08
TOTAL = BODY + UPPER + INCLINED
REACTION = {"effects.reaction": True}
HEAVY = REACTION | {"effects.mass_weight": True}
STATIC = {"effects.friction": "static", "ground.static_friction": 0.4}
NO_CONTACT = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}
NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)


def energy(run, heavy):
    """Mechanical energy [J] of the undamped machine, from its samples and the mass matrix of docs/robot.md."""
    kinetic = (TOTAL * run.body_velocity**2 + UPPER * run.upper_velocity**2 + INCLINED * run.inclined_velocity**2
               - 2 * INCLINED * SINE * run.body_velocity * run.inclined_velocity)
    springs = (run.upper_drive_force**2 + run.inclined_drive_force**2) / 1e3
    plates = (run.upper_plate_force**2 + run.inclined_plate_force**2) / 1e7
    weight = heavy * GRAVITY * (UPPER * run.upper_position + INCLINED * COSINE * run.inclined_position)
    return (kinetic + springs + plates) / 2 + weight


@pytest.mark.parametrize("heavy", [False, True])
def test_a_machine_left_alone_keeps_its_energy(heavy):
    """A31. Without motor, friction and dampers: constant through every impact, to the rounding of its 4 J."""
    changes = {"motor.speed": 0.0, "start.state": "zero", "upper.gap": 0.01, "effects.mass_weight": heavy}
    run = vibro_ros.simulate(scene("frictionless", REACTION, changes), duration=2.0, rate=2000.0)
    assert np.count_nonzero(np.char.endswith(run.events["kind"], "contact")) > 30
    assert abs(energy(run, heavy) / energy(run, heavy)[0] - 1).max() <= 1e-11
    without = vibro_ros.simulate(scene("frictionless", changes), duration=2.0, rate=2000.0)
    assert abs(energy(without, heavy) / energy(without, heavy)[0] - 1).max() > 0.01


def quadrature(events, until):
    """Instants and weights of Gauss's rule from 0 to `until` [s] on pieces that end at every event."""
    cuts = np.concatenate((events["time"], events["time"] + np.nan_to_num(events["duration"]),
                           np.arange(0.0, until, 0.004), [until]))
    edges = np.unique(np.clip(cuts, 0.0, until))
    middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
    return (middle[:, None] + half[:, None] * NODES).ravel(), (half[:, None] * WEIGHTS).ravel()


@pytest.mark.parametrize("effects", [REACTION, HEAVY, HEAVY | STATIC], ids=["reaction", "heavy", "static"])
@pytest.mark.parametrize("force", ["unilateral", "weight", "printed"])
def test_motor_work_goes_to_energy_and_friction(force, effects):
    """A30. From the outputs alone: 20 points a piece integrate P - F_fr x' of 10 W to 1e-11 J."""
    until = 0.2
    machine = scene("unilateral", effects, {"effects.normal_force": force})
    events = vibro_ros.simulate(machine, times=[0.0, until]).events
    instants, weights = quadrature(events, until)
    inside = vibro_ros.simulate(machine, times=instants)
    ends = energy(vibro_ros.simulate(machine, times=[0.0, until]), machine["effects.mass_weight"])
    friction = inside.friction_force * inside.body_velocity @ weights
    motor = inside.motor_power @ weights
    assert abs(friction) > 1e-3
    assert motor - friction == pytest.approx(ends[1] - ends[0], abs=1e-9)


@pytest.mark.parametrize("effects", [{}, REACTION, HEAVY], ids=["no reaction", "reaction", "heavy"])
@pytest.mark.parametrize("name", ["paper", "frictionless", "rigid"])
def test_momentum_through_every_impact(name, effects):
    """A29. Without friction M x' - m3 w' sin φ stays 0, to 1e-12 kg m/s; impacts reach thousands of newtons, or have no
    duration, and weight acts on the masses across x alone."""
    run = vibro_ros.simulate(scene(name, effects, {"effects.friction": "none"}), duration=2.0, rate=5000.0)
    assert np.count_nonzero(run.events["kind"] == "inclined_contact") > 30
    assert abs(TOTAL * run.body_velocity - INCLINED * SINE * run.inclined_velocity).max() <= 1e-12


@pytest.mark.parametrize("friction", [0.0, 2.0])
def test_reaction_on_and_off_agree_as_the_body_grows_heavy(friction):
    """A25. Differences in w and in x M/m3 fall in proportion to m3/M; `friction` [N] stays, so that the body slips."""
    shares, masses, bodies = [], [], []
    for body in (1e2, 1e3, 1e4, 1e5):
        total = body + UPPER + INCLINED
        changes = {"mass.body": body, "effects.normal_force": "weight", "ground.friction": friction / (total * GRAVITY)}
        on, off = (vibro_ros.simulate(scene("damped", changes, {"effects.reaction": reaction}), duration=0.2, rate=1e3)
                   for reaction in (True, False))
        assert abs(on.body_position).max() * total > 1e-3
        shares.append(INCLINED / total)
        masses.append(abs(on.inclined_position - off.inclined_position).max())
        bodies.append(abs(on.body_position - off.body_position).max() * total / INCLINED)
    for differences in (masses, bodies):
        order, _ = np.polyfit(np.log(shares), np.log(differences), 1)
        assert order == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("angle", [ANGLE, np.pi / 2, 2.2])
@pytest.mark.parametrize("reaction", [False, True])
def test_masses_sag_under_their_weight(reaction, angle):
    """m g/k along each guide, from the slider; free motion has decayed by e⁻⁴⁰, and the ground carries M g."""
    damping = {"upper.spring.damping": 8.0, "inclined.spring.damping": 8.0}
    run = vibro_ros.simulate(scene("unilateral", NO_CONTACT, damping, {
        "effects.mass_weight": True, "effects.reaction": reaction, "motor.speed": 0.0, "guide.angle": angle,
    }), times=[0.0, 1.0])
    assert run.upper_position[1] - run.upper_position[0] == pytest.approx(-UPPER * GRAVITY / 1e3, abs=1e-15)
    sag = -INCLINED * GRAVITY * np.cos(angle) / 1e3
    assert run.inclined_position[1] - run.inclined_position[0] == pytest.approx(sag, abs=1e-15)
    assert run.normal_force[1] == pytest.approx(TOTAL * GRAVITY, abs=1e-11)
    assert run.friction_force[1] == pytest.approx(0.0, abs=1e-11)


def painleve_limit(angle):
    """μ at which the slipping body's inertia M - m3 sin²φ - μ m3 sin φ |cos φ| vanishes."""
    return (TOTAL - INCLINED * np.sin(angle) ** 2) / (INCLINED * np.sin(angle) * abs(np.cos(angle)))


@pytest.mark.parametrize("angle", [ANGLE, np.pi - ANGLE, 1.5])
@pytest.mark.parametrize("force", ["unilateral", "printed"])
def test_friction_beyond_painleves_limit_is_refused(force, angle):
    """Beyond it a slipping body has no unique acceleration."""
    excessive = {"effects.normal_force": force, "guide.angle": angle,
                 "ground.friction": painleve_limit(angle) * (1 + 1e-9)}
    with pytest.raises(ValueError, match="ground.friction") as caught:
        vibro_ros.Simulator(scene("damped", REACTION, excessive))
    assert "\n" not in str(caught.value) and "effects.reaction" in str(caught.value)


@pytest.mark.parametrize("angle", [ANGLE, np.pi - ANGLE, 1.5])
@pytest.mark.parametrize("force", ["unilateral", "printed"])
@pytest.mark.parametrize("name", ["damped", "unilateral"])
def test_the_ground_carries_the_body_again_just_below_painleves_limit(name, force, angle):
    """There N of a slipping body is a thousand times that of a free one, and so is its rounding where N = 0."""
    near = {"effects.normal_force": force, "guide.angle": angle, "ground.friction": painleve_limit(angle) * (1 - 1e-3)}
    run = vibro_ros.simulate(scene(name, REACTION, near), duration=0.2, rate=1000.0)
    assert np.count_nonzero(run.events["kind"] == "stick") > 5
