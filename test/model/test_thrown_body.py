"""The rule `hop` with rigid plates: a blow throws the body up, and what follows.

A blow is known from the mass matrix B of docs/robot.md for q = (x, y, u, w) alone: an impulse J between mass i and its
plate changes the speeds by -J B⁻¹ e_i, and restitution asks for -J (B⁻¹)_ii = -(1 + e) times the approach.
"""

import math

import numpy as np
import pytest
from mass_matrix import mass_matrix
from scipy.optimize import brentq

import vibro_ros

RIGID = vibro_ros.load_scene("rigid").with_parameters({"effects.normal_force": "hop"})
REACTION = {"effects.reaction": True}
HEAVY = REACTION | {"effects.mass_weight": True}
RESTING = HEAVY | {"inclined.gap": -0.004, "inclined.plate.restitution": 0.0}
COORDINATES = {"upper": 2, "inclined": 3}
SPEEDS = ("body_velocity", "body_vertical_velocity", "upper_velocity", "inclined_velocity")
each_coupling = pytest.mark.parametrize("changes", [{}, REACTION, HEAVY, RESTING, HEAVY | {"effects.friction": "none"},
                                                    HEAVY | {"guide.angle": 1.5}],
                                        ids=["no reaction", "reaction", "heavy", "one rests", "ice", "steep"])


def blows(scene, duration, least=0.05):
    """Hard blows with nothing else within 1e-6 s but the lift-off and, with e = 0, the rest that follow: the events,
    their guides, and all speeds 1e-9 s before and after each; shapes (n,), (n,), (2, n, 4)."""
    events = vibro_ros.simulate(scene, times=[duration]).events
    hits = events[np.isinf(events["peak_force"]) & (events["speed"] > least)]
    hits = hits[[set(events["kind"][abs(events["time"] - hit["time"]) < 1e-6]) <= {hit["kind"], "lift_off"}
                 for hit in hits]]
    hits = hits[np.argsort(hits["time"])]
    run = vibro_ros.simulate(scene, times=np.ravel(np.column_stack((hits["time"] - 1e-9, hits["time"] + 1e-9))))
    speeds = np.transpose([getattr(run, name) for name in SPEEDS])
    return hits, [str(kind).removesuffix("_contact") for kind in hits["kind"]], np.stack((speeds[::2], speeds[1::2]))


@each_coupling
def test_a_blow_changes_every_speed_as_the_mass_matrix_asks(changes):
    """A20. In 2 ns forces of some 100 N change a mass of 80 g by 3e-6 m/s, which is all the difference there is."""
    scene = RIGID.with_parameters(changes)
    inverse = np.linalg.inv(mass_matrix(scene))
    hits, sides, (speeds_before, after) = blows(scene, 2.0)
    assert set(sides) == {"upper", "inclined"} and len(hits) > 30
    for hit, side, old, new in zip(hits, sides, speeds_before, after, strict=True):
        i, restitution = COORDINATES[side], scene[f"{side}.plate.restitution"]
        impulse = (1.0 + restitution) * hit["speed"] / inverse[i, i]
        np.testing.assert_allclose(new - old, -impulse * inverse[:, i], rtol=0, atol=1e-5)
        assert new[1] > old[1]


def test_a_mass_at_rest_on_the_other_plate_parts_from_a_body_that_is_thrown_up():
    """The mass keeps its speed in space, so after the other mass's blow it is slower than its plate by e . dV."""
    scene = RIGID.with_parameters(RESTING | {"upper.gap": 0.004})
    hits, sides, (speeds_before, after) = blows(scene, 2.0)
    parted = [(old, new) for side, old, new in zip(sides, speeds_before, after, strict=True)
             if side == "upper" and old[3] == 0.0]
    assert len(parted) > 3
    across, up = -math.sin(scene["guide.angle"]), math.cos(scene["guide.angle"])
    for old, new in parted:
        assert new[3] == pytest.approx(-(across * (new - old)[0] + up * (new - old)[1]), abs=1e-5)
        assert new[3] < -1e-3


@each_coupling
def test_a_blow_on_a_standing_body_is_a_lift_off_and_the_fall_ends_in_a_landing_at_its_speed(changes):
    """Each landing notes the fall 1e-9 s before it, to the 1e-5 m/s of that time; other changes of mode, nothing."""
    scene = RIGID.with_parameters(changes)
    events = vibro_ros.simulate(scene, times=[2.0]).events
    lifts, falls = (events[events["kind"] == kind] for kind in ("lift_off", "landing"))
    assert len(falls) > 10
    assert np.isin(lifts["time"], events["time"][np.isinf(events["peak_force"])]).mean() > 0.5
    run = vibro_ros.simulate(scene, times=falls["time"] - 1e-9)
    np.testing.assert_allclose(falls["speed"], -run.body_vertical_velocity, rtol=0, atol=1e-5)
    assert falls["speed"].max() > 0.05
    assert not events["speed"][np.isin(events["kind"], ["lift_off", "slip_forward", "slip_backward", "stick"])].any()


def test_a_body_that_one_blow_throws_up_falls_back_like_a_stone():
    """A21. A plate that comes down at 1 m/s on a mass that no spring holds: y' = m2 (1 + e)/M from then on, and no
    force but the weights, so y = y' t - g t²/2, and the landing after 2 y'/g is at the speed y'; to rounding."""
    scene = vibro_ros.Scene("stone", HEAVY | {
        "effects.normal_force": "hop", "effects.upper_contact": "restitution", "effects.inclined_mass": False,
        "upper.plate.restitution": 0.6, "upper.spring.stiffness": 0.0, "upper.gap": 0.01, "gravity": 2.0,
        "motor.speed": 0.0, "gap_actuator.speed": 1.0})
    device = vibro_ros.Simulator(scene)
    device.command(upper_gap=-0.03)
    thrown = 0.1 * 1.6 / 1.1
    device.advance_to(0.05)
    assert device.state.body_height == pytest.approx(thrown * 0.05 - 0.05**2, rel=1e-13)
    device.advance_to(0.2)
    events = {event["kind"]: event for event in device.take_events()}
    assert (events["upper_contact"]["time"], events["lift_off"]["time"]) == (0.0, 0.0)
    assert events["upper_contact"]["speed"] == 1.0
    assert events["landing"]["time"] == pytest.approx(thrown, rel=1e-13)
    assert events["landing"]["speed"] == pytest.approx(thrown, rel=1e-13)
    assert device.state.body_height == 0.0 and device.state.body_vertical_velocity == 0.0


def test_everything_comes_to_rest_when_the_motor_stops():
    """Bounces and hops that throw each other up die out: one event at most a second, body on the ground, x' = 0."""
    for changes in ({}, HEAVY, RESTING | {"upper.gap": -0.001}):
        device = vibro_ros.Simulator(RIGID.with_parameters(changes | {
            "upper.spring.damping": 2.0, "inclined.spring.damping": 2.0}))
        device.advance_to(1.0)
        device.command(motor_speed=0.0)
        device.advance_to(9.0)
        device.take_events()
        device.advance_to(10.0)
        assert len(device.take_events()) <= 1
        assert device.state.body_height == 0.0 and device.state.body_velocity == 0.0


def restitution_without_tension(ratio):
    """The formula of A10, for damping ratios below 1/sqrt(2)."""
    root = math.sqrt(1.0 - ratio**2)
    return math.exp(-ratio / root * (math.pi - math.atan(2 * ratio * root / (1.0 - 2.0 * ratio**2))))


@pytest.mark.parametrize("restitution", [1.0, 0.7])
@pytest.mark.parametrize(("rule", "changes"), [("unilateral", {}), ("hop", {}), ("hop", HEAVY)],
                         ids=["unilateral", "hop", "hop, heavy"])
def test_rigid_plates_are_the_limit_of_stiff_ones(rule, changes, restitution):
    """A24. A contact lasts some sqrt(m/k), lifts the body some M g/(k v) after it began, and is v sqrt(m/k) deep: the
    error is of first order in 1/sqrt(k). The damper is the one that gives that restitution to a contact that feels the
    inertia 1/(B⁻¹)_ii."""
    scene = RIGID.with_parameters(changes | {"effects.normal_force": rule, "upper.gap": 0.01, "inclined.gap": 0.01})
    felt = 1.0 / np.diag(np.linalg.inv(mass_matrix(scene)))
    ratio = 0.0 if restitution == 1.0 else brentq(lambda r: restitution_without_tension(r) - restitution, 0.0, 0.7)
    times = np.linspace(0.0, 0.13, 66)
    rigid = vibro_ros.simulate(scene.with_parameters({f"{s}.plate.restitution": restitution for s in COORDINATES}),
                               times=times)
    assert np.count_nonzero(np.char.endswith(rigid.events["kind"], "contact")) >= 3
    apart = np.all([getattr(rigid, f"{s}_position") - getattr(rigid, f"{s}_plate_position") < -1e-3
                    for s in COORDINATES], axis=0)
    errors = []
    for stiffness in (1e8, 1e10):
        plates = {"effects.adhesion": False}
        for side, i in COORDINATES.items():
            plates |= {f"effects.{side}_contact": "compliant", f"{side}.plate.stiffness": stiffness,
                       f"{side}.plate.damping": 2.0 * ratio * math.sqrt(stiffness * felt[i])}
        soft = vibro_ros.simulate(scene.with_parameters(plates), times=times)
        errors.append([np.abs(getattr(soft, name) - getattr(rigid, name))[apart].max()
                       for name in ("body_position", "body_height", "upper_position", "inclined_position")])
    coarse, fine = np.array(errors)
    moved = coarse > 0.0
    np.testing.assert_allclose(np.log10(coarse[moved] / fine[moved]), 1.0, rtol=0, atol=0.15)
