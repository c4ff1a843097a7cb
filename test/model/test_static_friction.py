"""Friction at rest and at low speeds: a static coefficient above the kinetic one, and Stribeck's decay between the two.

The mass starts at 0, its drive spring stretched by the standing slider, and pulls with
F_in = k3 s sin φ cos Ωt, greatest at once: a bound known in closed form.
"""

import numpy as np
import pytest

import vibro_ros

STIFFNESS, INCLINED, TOTAL, GRAVITY, KINETIC = 1e3, 0.08, 1.18, 9.81, 1.0
ANGLE = 0.8726646259971648
STRETCH = 0.02 * np.cos(ANGLE) + np.sqrt(0.06**2 - (0.02 * np.sin(ANGLE)) ** 2)
PULL = STIFFNESS * STRETCH * np.sin(ANGLE)  # N, greatest F_in
FREQUENCY = np.sqrt(STIFFNESS / INCLINED)
LIMIT = PULL / (TOTAL * GRAVITY)
RELEASED = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.normal_force": "weight",
            "motor.speed": 0.0, "start.state": "zero", "ground.friction": KINETIC}
SLIPS = ("slip_forward", "slip_backward")


def run(coefficient, changes=(), times=None, friction="static"):
    scene = vibro_ros.load_scene("paper").with_parameters(RELEASED | dict(changes) | {
        "effects.friction": friction, "ground.static_friction": coefficient})
    return vibro_ros.simulate(scene, times=np.linspace(0.0, 0.5, 501) if times is None else times)


@pytest.mark.parametrize("reaction", [False, True])
@pytest.mark.parametrize(("excess", "slips"), [(1e-9, False), (-1e-9, True)])
def test_a_body_at_rest_slips_only_beyond_the_static_limit(excess, slips, reaction):
    """The body does not move in eight turns of F_in while μs N > |F_in| > μ N; with a bound lower by a billionth it
    does.
    """
    assert LIMIT > 4 * KINETIC
    motion = run(LIMIT * (1 + excess), {"effects.reaction": reaction})
    assert bool(motion.body_position.any()) is slips
    assert bool(np.isin(motion.events["kind"], SLIPS).any()) is slips
    if not slips:
        expected = PULL * np.cos(FREQUENCY * motion.time)
        np.testing.assert_allclose(motion.friction_force, expected, rtol=0, atol=1e-10)
        assert abs(motion.friction_force).max() > 4 * KINETIC * TOTAL * GRAVITY


def test_a_slipping_body_feels_the_kinetic_coefficient():
    """M x'' = F_in - μ M g from the first instant, until it turns: x to the rounding of 0.01 m."""
    times = np.linspace(0.0, 0.02, 41)
    motion = run(LIMIT * (1 - 1e-9), times=times)
    speed = PULL * np.sin(FREQUENCY * times) / (FREQUENCY * TOTAL) - KINETIC * GRAVITY * times
    assert speed[1:].min() > 0.0
    position = PULL * (1 - np.cos(FREQUENCY * times)) / (FREQUENCY**2 * TOTAL) - KINETIC * GRAVITY * times**2 / 2
    np.testing.assert_allclose(motion.body_velocity, speed, rtol=0, atol=1e-14)
    np.testing.assert_allclose(motion.body_position, position, rtol=0, atol=1e-15)
    np.testing.assert_allclose(motion.friction_force[1:], KINETIC * TOTAL * GRAVITY, rtol=1e-15)


@pytest.mark.parametrize(("share", "held"), [(1.01, True), (0.99, False)])
def test_a_body_that_comes_to_rest_is_held_by_the_static_coefficient(share, held):
    """Where the speed vanishes first, |F_in| is above μ N: it stays for good below μs N, and turns beyond."""
    moving = run(KINETIC, times=np.linspace(0.0, 0.02, 3))
    assert moving.body_velocity[-1] > 0.0
    turn = next(event["time"] for event in run(KINETIC).events if event["kind"] == "slip_backward")
    limit = abs(PULL * np.cos(FREQUENCY * turn)) / (TOTAL * GRAVITY)
    assert KINETIC < limit < LIMIT
    motion = run(limit * share)
    ends = motion.events[np.isin(motion.events["kind"], ("stick", "slip_backward"))]
    assert ends["time"][0] == pytest.approx(turn, abs=1e-12)
    assert ends["kind"][0] == ("stick" if held else "slip_backward")


def test_a_held_body_slips_where_the_pull_exceeds_the_static_limit():
    """The first slip after the first stick begins where k3 s sin φ |cos Ωt| = μs M g."""
    turn = next(event["time"] for event in run(KINETIC).events if event["kind"] == "slip_backward")
    coefficient = abs(PULL * np.cos(FREQUENCY * turn)) / (TOTAL * GRAVITY) * 1.01
    kinds = run(coefficient).events
    kinds = kinds[np.isin(kinds["kind"], (*SLIPS, "stick"))]
    stick = list(kinds["kind"]).index("stick")
    release = kinds[stick + 1]
    angle = np.arccos(coefficient / LIMIT)
    candidates = np.sort(np.concatenate([np.arange(40) * np.pi - angle, np.arange(40) * np.pi + angle])) / FREQUENCY
    rising = np.sin(FREQUENCY * candidates) * np.cos(FREQUENCY * candidates) < 0.0
    expected = candidates[rising & (candidates > kinds["time"][stick])][0]
    assert release["kind"] in SLIPS
    assert release["time"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("law", ["static", "stribeck"])
@pytest.mark.parametrize("reaction", [False, True])
@pytest.mark.parametrize("force", ["unilateral", "weight", "printed"])
def test_equal_coefficients_are_coulombs(force, reaction, law):
    """Bit for bit."""
    scenes = [vibro_ros.load_scene("damped").with_parameters({
        "effects.friction": friction, "ground.static_friction": 0.2, "effects.normal_force": force,
        "effects.reaction": reaction}) for friction in (law, "coulomb")]
    static, coulomb = (vibro_ros.simulate(scene, duration=1.0, rate=1000.0) for scene in scenes)
    np.testing.assert_array_equal(static.body_position, coulomb.body_position)
    assert static.events.tobytes() == coulomb.events.tobytes()


STATIC, SPEED = 0.35, 0.02
RULES = ("unilateral", "weight", "printed")


def scene(name="damped", **changes):
    stribeck = {"effects.friction": "stribeck", "ground.static_friction": STATIC, "ground.stribeck_speed": SPEED,
                "upper.gap": 1e-3, "inclined.gap": 1e-3, "motor.speed": 92.0}
    return vibro_ros.load_scene(name).with_parameters(stribeck | changes)


def distances(limit, speeds, duration=0.5):
    """Greatest distance [m] of the body from its motion in the scene `limit`, for each v_s."""
    times = np.linspace(0.0, duration, 501)
    expected = vibro_ros.simulate(limit, times=times).body_position
    return [abs(vibro_ros.simulate(scene(**{"ground.stribeck_speed": speed}), times=times).body_position
                - expected).max() for speed in speeds]


def test_a_slow_decay_tends_to_coulombs_law_with_the_static_coefficient():
    """A26. At first order in 1/v_s: mu(v) = mu_s - (mu_s - mu) v / v_s; the second is v/v_s, 1e-2 and 1e-3, of it."""
    near, nearer = distances(scene(**{"effects.friction": "coulomb", "ground.friction": STATIC}), [30.0, 300.0])
    assert near < 1e-3
    assert near / nearer == pytest.approx(10.0, rel=0.1)


def test_a_fast_decay_tends_to_the_static_law():
    """A26. mu_s at rest and mu beyond: a body that leaves v_s behind at once is moved by about v_s times the time."""
    far, near, nearest = distances(scene(**{"effects.friction": "static"}), [1e-2, 1e-4, 1e-6])
    assert nearest < 0.05 * near < 0.05 * 0.05 * far


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("speed", [1e-6, 1e3])
def test_the_extremes_of_the_stribeck_speed_are_simulated(rule, speed):
    """However fast the decay: each stop and each start takes some forty steps through it, measured up to 13 times as
    many in all as by the static law."""
    steps = {friction: vibro_ros.simulate(
        scene("unilateral", **{"effects.friction": friction, "effects.normal_force": rule,
                               "ground.stribeck_speed": speed}), duration=1.0, rate=100.0).statistics["steps"]
        for friction in ("static", "stribeck")}
    assert steps["stribeck"] < 15 * steps["static"]


def test_a_body_that_passes_stribecks_speed_within_1e_19_s():
    """The misread force of 1e10 N on a gram: a segment's first trial is 1e13 times too long, and its series overflows.
    Beside 1e4 m/s v_s changes the motion by 1e-11 of its way, and rounding by less."""
    both = [scene("paper", **{
        "effects.friction": friction, "ground.stribeck_speed": 1e-6, "mass.body": 1e-3, "effects.misprint": True,
        "inclined.plate.stiffness": 1e12, "solver.tolerance": 1e-3}) for friction in ("stribeck", "static")]
    stribeck, static = (vibro_ros.simulate(each, duration=0.01, rate=1000.0) for each in both)
    assert np.abs(static.body_velocity).max() > 1e4
    np.testing.assert_allclose(stribeck.body_position, static.body_position, rtol=1e-9, atol=1e-6)
