"""Legal scenes that would take for ever are refused with a remedy; the stiffest sensible scenes are accepted."""

import re

import pytest

import vibro_ros
from vibro_ros.model.parameter_checks import fastest_rate
from vibro_ros.model.tables import compile_scene
from vibro_ros.solver.equations import RATE_LIMIT

PAPER = vibro_ros.load_scene("paper")


@pytest.mark.parametrize(("changes", "message"), [
    ({"mass.upper": 1e-3, "upper.spring.damping": 1e6},
     "0.001 kg, faster than 1e+07 1/s, which takes too long to simulate; give a mass of at least 0.1 kg"),
    ({"mass.inclined": 1e-3, "inclined.plate.stiffness": 1e12},
     "inclined.plate.stiffness: 1e+12 N/m moves mass.inclined, 0.001 kg, faster than 1e+07 1/s"),
    ({"mass.inclined": 1e-12}, "inclined.plate.stiffness: 1e+07 N/m moves mass.inclined, 1e-12 kg")])
def test_a_scene_that_would_take_for_ever_is_refused(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        PAPER.with_parameters(changes)


@pytest.mark.parametrize(("changes", "message"), [
    ({"mass.body": 1e-5, "effects.inclined_mass": False},
     "takes too long to simulate; give at least 2e-05 kg, less ground.friction, stiffness and damping"),
    ({"mass.body": 1e-9, "effects.inclined_mass": False}, "mass.body: 1e-09 kg with effects.reaction leaves the"),
    ({"mass.body": 1e-9, "guide.angle": 1e-7}, "mass.body: 1e-09 kg with effects.reaction leaves the masses"),
    ({"guide.angle": 1.0, "ground.friction": 30.0}, None)])
def test_a_body_that_is_too_light_for_the_reaction_is_refused(changes, message):
    scene = vibro_ros.load_scene("device")
    if message is None:  # almost Painlevé's paradox, but heavy enough
        assert scene.with_parameters(changes)
        return
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        scene.with_parameters(changes)
    assert "\n" not in str(refusal.value)
    if enough := re.search("give at least (.*) kg", message):
        assert scene.with_parameters(changes | {"mass.body": float(enough[1])})
    assert scene.with_parameters(changes | {"effects.reaction": False})


@pytest.mark.parametrize("rule", ["weight", "unilateral", "printed", "hop"])
@pytest.mark.parametrize(("friction", "body"), [("none", 1.0), ("coulomb", 1e-2), ("static", 1e-4)])
def test_the_rate_that_is_limited_is_that_of_the_compiled_tables(rule, friction, body):
    scene = vibro_ros.load_scene("device").with_parameters({
        "effects.normal_force": rule, "effects.friction": friction, "mass.body": body, "ground.friction": 0.05})
    shortest = compile_scene(scene).system.longest_segment.min()
    assert fastest_rate(scene) == pytest.approx(2.0 * RATE_LIMIT / shortest, rel=1e-9)


@pytest.mark.parametrize("changes", [
    {"mass.upper": 1e-3, "upper.plate.stiffness": 1e9}, {"upper.plate.stiffness": 1e12},
    {"mass.upper": 1e-3, "upper.plate.damping": 1e3, "effects.adhesion": False},
    {"mass.upper": 1e-9, "upper.spring.damping": 1e6, "effects.upper_mass": False},
    {"mass.upper": 1e-12, "upper.spring.stiffness": 10.0, "effects.upper_contact": "none"},
    {"mass.upper": 1e-3, "upper.plate.stiffness": 1e12, "effects.upper_contact": "restitution",
     "effects.friction": "none"}])
def test_what_is_fast_but_sensible_or_not_simulated_is_accepted(changes):
    device = vibro_ros.Simulator(PAPER.with_parameters(changes))
    device.advance_to(1e-3)
    assert device.statistics["steps"] < 10_000  # 1e-3 s at 5e6 steps a second, and some for events


def test_a_guide_that_hardly_leans_has_no_limit_of_friction():
    """The product of the guide's sine and the mass is below the smallest number."""
    scene = vibro_ros.load_scene("device").with_parameters({"guide.angle": 5e-324})
    device = vibro_ros.Simulator(scene)
    device.command(motor_speed=50.0)
    device.advance_to(0.1)
    assert device.state.body_position == 0.0
