"""Two events in one instant: the result must not depend on their order, nor on a rounding error between them."""

import itertools
import math

import numpy as np
import pytest

import vibro_ros

PAPER = vibro_ros.load_scene("paper")
SINE, COSINE = math.sin(PAPER["guide.angle"]), math.cos(PAPER["guide.angle"])
POSITIONS = ("body_position", "upper_position", "inclined_position")


def assert_runs_agree(runs, tolerance):
    """All runs have the same events and the same end."""
    for run in runs[1:]:
        assert sorted(run.events["kind"]) == sorted(runs[0].events["kind"])
        for name in POSITIONS:
            np.testing.assert_allclose(getattr(run, name), getattr(runs[0], name), rtol=0, atol=tolerance)


MEETING = 0.012  # [s] both masses rise at 7 and 9 m/s, from 0
LEADS = [sign * 10.0**-digits for digits in (15, 14, 13) for sign in (1, -1)]  # [s]


def both_meet(kind, rule, reaction):
    """The device before both masses meet their plates at MEETING, and the scene in which the upper plate is met `lead`
    seconds later, by function."""
    free = PAPER.with_parameters({
        "effects.normal_force": rule, "effects.reaction": reaction, "start.state": "zero",
        "effects.upper_contact": "none", "effects.inclined_contact": "none"})
    met = vibro_ros.Simulator(free)
    met.advance_to(MEETING)
    met = met.state

    def scene(lead):
        return free.with_parameters({
            "effects.upper_contact": kind, "effects.inclined_contact": kind, "upper.plate.restitution": 0.7,
            "inclined.plate.restitution": 0.5, "inclined.gap": met.inclined_position - 0.06,
            "upper.gap": met.upper_position + lead * met.upper_velocity - 0.06})
    return met, scene


# Not rigid plates as printed, which are refused, nor on a body that hops and acts on the masses: see below.
@pytest.mark.parametrize(("kind", "rule", "reaction"), [
    *itertools.product(["compliant"], ["weight", "unilateral", "printed", "hop"], [False, True]),
    *itertools.product(["restitution"], ["weight", "unilateral"], [False, True]), ("restitution", "hop", False)])
def test_two_impacts_in_the_same_instant_in_either_order(kind, rule, reaction):
    """A19. The upper plate is met in the same instant as the inclined one, or 1e-15 to 1e-13 s before or after."""
    met, scene = both_meet(kind, rule, reaction)
    assert met.upper_velocity > 5.0 and met.inclined_velocity > 5.0
    times = np.linspace(0.0, MEETING + 0.04, 200)
    together = vibro_ros.simulate(scene(0.0), times=times)
    for lead in LEADS:
        run = vibro_ros.simulate(scene(lead), times=times)
        first = [run.events["time"][run.events["kind"] == f"{side}_contact"][0] for side in ("upper", "inclined")]
        assert first[0] - first[1] == pytest.approx(lead, abs=1e-17 + 1e-2 * abs(lead))
        # The plate is 7 m/s x lead off, which further impacts make more of: 90 m/s x lead, and roundings of 0.1 m.
        assert_runs_agree([together, run], 150.0 * abs(lead) + 1e-14)


def thrown(speeds, order):
    """x', y', u', w' [m/s] after the blows of `order`; one with the approach a adds -(1 + e) a A⁻¹ e_i / (A⁻¹)_ii."""
    m1, m2, m3, x, y = 1.0, 0.1, 0.08, -SINE, COSINE
    whole = m1 + m2 + m3
    inverse = np.linalg.inv([[whole, 0, 0, m3 * x], [0, whole, m2, m3 * y], [0, m2, m2, 0], [m3 * x, m3 * y, 0, m3]])
    for side in order:
        row, restitution = (2, 0.7) if side == "upper" else (3, 0.5)
        assert speeds[row] > 1.0
        speeds = speeds - (1.0 + restitution) * speeds[row] * inverse[row] / inverse[row, row]
    return speeds


def test_two_blows_that_throw_the_body_up_change_the_speeds_in_their_order():
    """A19. The order matters because the first takes the body, and so the other mass's plate, along."""
    met, scene = both_meet("restitution", "hop", True)
    orders = [thrown(speeds_of(met), order) for order in (("upper", "inclined"), ("inclined", "upper"))]
    assert np.abs(orders[0] - orders[1]).max() > 0.1
    for lead, expected in ((-1e-13, orders[:1]), (1e-13, orders[1:]), (0.0, orders)):
        device = vibro_ros.Simulator(scene(lead))
        device.advance_to(MEETING + 3e-13)
        errors = [np.abs(speeds_of(device.state) - speeds).max() for speeds in expected]
        assert min(errors) < 1e-8  # up to 1e4 m/s² for 3e-13 s


def speeds_of(state):
    return np.array([state.body_velocity, state.body_vertical_velocity, state.upper_velocity, state.inclined_velocity])


@pytest.mark.parametrize("kind", ["compliant", "restitution"])
@pytest.mark.parametrize(("rule", "friction"), [("weight", 6.0), ("unilateral", 4.0)])
@pytest.mark.parametrize("reaction", [False, True])
def test_contact_and_stick_in_the_same_instant(reaction, rule, friction, kind):
    """The upper mass, which rises, reaches its plate exactly when the body stops, or within 1e-15 to 1e-13 s of that
    instant.
    """
    base = PAPER.with_parameters({
        "effects.normal_force": rule, "effects.upper_contact": "none", "effects.reaction": reaction,
        "start.state": "zero", "effects.inclined_contact": "none", "ground.friction": friction,
        "upper.spring.stiffness": 10.0})
    events = vibro_ros.simulate(base, duration=0.3, rate=100.0).events
    stop = events["time"][(events["kind"] == "stick") & (events["time"] > 0.01)][0]
    met = vibro_ros.simulate(base, times=np.array([stop]))
    place, speed = met.upper_position[0], met.upper_velocity[0]
    assert speed > 0.05 and abs(met.body_velocity[0]) < 1e-12
    changes = {"effects.upper_contact": kind, "upper.plate.restitution": 0.7}
    runs = [vibro_ros.simulate(base.with_parameters(changes | {"upper.gap": place - 0.06 + lead * speed}),
                               times=np.linspace(0.0, stop + 0.004, 50))
            for lead in (0.0, 1e-15, -1e-15, 1e-14, -1e-14, 1e-13, -1e-13)]
    for run in runs:
        contacts = run.events["time"][run.events["kind"] == "upper_contact"]
        assert contacts[0] == pytest.approx(stop, abs=2e-13)
    assert_runs_agree(runs, 1e-12)  # 1e-13 s at up to 10 m/s


def test_stick_is_released_where_the_pull_reaches_the_bound():
    """m3 w'' sin φ = μ M g, for the swing w = s + (w0 - s) cos Ωt of a mass on a standing slider."""
    scene = PAPER.with_parameters({
        "effects.upper_mass": False, "effects.inclined_contact": "none", "motor.speed": 0.0, "start.state": "zero",
        "effects.normal_force": "weight", "ground.friction": 4.0})
    slider = 0.02 * COSINE + math.sqrt(0.06**2 - (0.02 * SINE) ** 2)
    rate, bound = math.sqrt(1e3 / 0.08), 4.0 * 1.08 * 9.81
    assert 1e3 * slider * SINE > bound  # it is pulled off at once, and comes to rest
    run = vibro_ros.simulate(scene, duration=0.5, rate=1000.0)
    kinds, times = run.events["kind"], run.events["time"]
    for k in np.flatnonzero(kinds == "stick"):
        slips = np.flatnonzero(kinds[k + 1:] != "stick")
        if len(slips) == 0:
            continue
        force = 1e3 * slider * math.cos(rate * times[k + 1]) * SINE
        assert abs(force) == pytest.approx(bound, rel=1e-13)
        assert kinds[k + 1] == ("slip_forward" if force > 0.0 else "slip_backward")
    assert np.count_nonzero(kinds == "stick") > 10


@pytest.mark.parametrize("stiffness", [1e4, 1e7, 1e9])
def test_the_normal_force_passes_zero_in_contact(stiffness):
    """`unloaded` and `loaded` where M g + m2 u'' = 0, for the upper mass that swings on its plate about its balance."""
    scene = PAPER.with_parameters({
        "effects.inclined_contact": "none", "motor.speed": 0.0, "start.state": "zero", "upper.gap": 0.0,
        "inclined.spring.stiffness": 0.0, "effects.normal_force": "unilateral", "upper.plate.stiffness": stiffness})
    run = vibro_ros.simulate(scene, duration=0.1, rate=1000.0)
    contact = run.events[run.events["kind"] == "upper_contact"][0]
    free, both = 100.0, math.sqrt((1e3 + stiffness) / 0.1)
    touched = math.acos(1.0 - 0.06 / 0.08) / free
    assert contact["time"] == pytest.approx(touched, abs=1e-16)
    speed = 8.0 * math.sin(free * touched)
    push = 1e3 * 0.02 / 0.1 / both**2  # the balance's depth; u - E - push = a sin(both t) - push cos(both t)
    size, lag = math.hypot(speed / both, push), math.atan2(push, speed / both)
    depth = 1.18 * 9.81 / 0.1 / both**2  # beyond the balance, where u'' = -M g / m2
    unloaded = (lag + math.asin(depth / size)) / both
    loaded = (lag + math.pi - math.asin(depth / size)) / both
    instants = {kind: run.events["time"][run.events["kind"] == kind][0] for kind in ("unloaded", "loaded")}
    # instants of 0.013 s rounded, and a place of 0.06 m rounded to 7e-18 m at some m/s
    assert instants["unloaded"] - contact["time"] == pytest.approx(unloaded, abs=1e-16)
    assert instants["loaded"] - contact["time"] == pytest.approx(loaded, abs=1e-16)
    assert np.abs(run.body_position).max() < 1e-18  # nothing pushes it along the ground


def test_a_normal_force_that_is_rounding_decides_nothing():
    """On a level guide, without gravity and with the upper mass at rest on its plate, N is exactly zero all the time:
    it must not be the 6e-17 that the rounding of pi/2 leaves of m3 w'' cos(phi), whose sign changes with every rounding
    of w''.
    """
    scene = vibro_ros.Scene("level", {
        "guide.angle": math.pi / 2, "gravity": 0.0, "mass.inclined": 19.984064754164955, "motor.speed": 0.0,
        "inclined.spring.damping": 0.02063814804786417, "ground.friction": 1.2787046034823155, "start.state": "zero",
        "ground.static_friction": 1.5344455241787787, "effects.upper_contact": "restitution",
        "effects.normal_force": "unilateral", "effects.reaction": True})
    run = vibro_ros.simulate(scene, duration=2.0, rate=1000.0)
    rests = run.events["time"][run.events["kind"] == "upper_contact"].max()
    assert rests < 1.0
    late = run.time > rests + 0.01
    assert not run.normal_force[late].any()
    assert not run.friction_force[late].any()
    assert np.ptp(run.inclined_velocity[late]) > 0.01
