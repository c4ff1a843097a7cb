"""`solver.tolerance` is kept, and `solver.method: auto` picks what is cheapest for the accuracy asked for."""

import dataclasses
import math

import numpy as np
import pytest

import vibro_ros
from vibro_ros import choice
from vibro_ros.model.scene import Scene
from vibro_ros.scene_file import shipped_scenes
from vibro_ros.study.methods import METHODS, UnableError

TIMES = np.linspace(0.0, 0.2, 101)
# The motor turns 80 times a second and the masses hardly follow it: `exact` resolves every turn for nothing.
SOFT = {"motor.max_speed": 5000.0, "motor.speed": 5000.0, "upper.spring.stiffness": 1.0,
        "inclined.spring.stiffness": 1.0}
POSITIONS = ("body_position", "upper_position", "inclined_position")


def positions(scene):
    run = vibro_ros.simulate(scene, times=TIMES)
    return np.array([getattr(run, name) for name in POSITIONS]), run


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_tolerance_is_kept(name):
    """Against heyoka at its strictest, whose own error within 0.2 s is below 1e-13 m (test_peer)."""
    scene = vibro_ros.load_scene(name)
    try:
        peer = METHODS["heyoka"](scene, TIMES, 1e-15).samples
    except UnableError as reason:
        pytest.skip(str(reason))
    for tolerance in (1e-3, 1e-6, 1e-9, 1e-12):
        samples = METHODS["exact"](scene, TIMES, tolerance).samples
        error = np.abs(samples - peer)[:, ::2].max()
        assert error < tolerance, f"{error:.1e} m"


def test_a_tolerance_below_rounding_is_refused():
    long = {"crank.upper_rod": 5.0, "crank.inclined_rod": 20.0}
    with pytest.raises(ValueError, match="solver.tolerance: 1e-12 m is below what rounding .* give at least 2e-11 m"):
        Scene(parameters=long | {"solver.tolerance": 1e-12})
    assert Scene(parameters=long | {"solver.tolerance": 2e-11})
    with pytest.raises(ValueError, match="solver.accuracy: 1e-12 m is below"):
        Scene(parameters=long | {"solver.accuracy": 1e-12})


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3])  # at a fifth of the cost of exact, or less: no matter of luck
def test_auto_keeps_the_accuracy_and_says_how(accuracy):
    scene = vibro_ros.load_scene("no_impact").with_parameters(SOFT | {"solver.accuracy": accuracy})
    device = vibro_ros.Simulator(scene.with_parameters({"solver.method": "auto"}))
    picked = device.choice
    assert picked.method != "exact" and picked.cost < picked.exact_cost
    assert device.scene["solver.method"] == picked.method and device.scene["solver.step"] == picked.step
    assert f"{picked.method} with a step of {picked.step:.3g} s" in str(picked)
    exact, found = positions(scene), positions(device.scene)
    assert np.abs(found[0] - exact[0]).max() <= accuracy
    assert found[1].statistics["solver.method"] == picked.method
    assert found[1].statistics["solver.step"] == picked.step


@pytest.mark.parametrize("name", ["device", "unilateral"])
def test_auto_stays_exact_where_no_step_is_cheaper(name):
    scene = vibro_ros.load_scene(name).with_parameters({"solver.method": "auto", "solver.accuracy": 1e-6})
    device = vibro_ros.Simulator(scene)
    assert device.choice.method == "exact" and "no step of fixed length is as accurate" in str(device.choice)
    other = vibro_ros.Simulator(scene.with_parameters({"solver.method": "exact"}))
    for each in (device, other):
        each.command(motor_speed=100.0)
        each.advance_to(0.1)
    assert dataclasses.astuple(device.state) == dataclasses.astuple(other.state)


def measured(costs, orders):
    """A stand-in for measurement: a method's error is step**order, its cost a step `costs` [s]."""
    def measure(scene, times):
        name, step = scene["solver.method"], scene["solver.step"]
        error = step ** orders[name] if name in orders else 0.0
        steps = choice.HORIZON / step if name in orders else 1.0
        return np.full((3, len(times)), error), costs[name] * steps
    return measure


def test_the_cheapest_of_those_that_are_accurate_is_picked():
    """A step of 1e-2.5 s is the longest of the ladder whose fourth power is below 1e-9 / SAFETY m."""
    scene = Scene(parameters={"solver.accuracy": 1e-9})
    costs = {"exact": 1e-3, "rk4": 4e-6, "semi_implicit_euler": 1e-6, "moreau": 1e-6}
    picked = choice.choose(scene, measured(costs, {"rk4": 4.0, "semi_implicit_euler": 1.0, "moreau": 1.0}))
    assert picked.method == "rk4" and picked.step == pytest.approx(10**-2.5, rel=1e-12)
    assert picked.error == pytest.approx(1e-10, rel=1e-9)
    picked = choice.choose(scene, measured(costs, {"rk4": 4.0, "semi_implicit_euler": 4.0, "moreau": 1.0}))
    assert picked.method == "semi_implicit_euler"
    dear = costs | {"exact": 1e-6}
    assert choice.choose(scene, measured(dear, dict.fromkeys(("rk4", "semi_implicit_euler", "moreau"), 9.0))) == (
        choice.Choice("exact", math.inf, 0.0, 1e-6 / choice.HORIZON, 1e-6 / choice.HORIZON))


def test_what_diverges_is_not_picked():
    def measure(scene, times):
        lost = scene["solver.method"] != "exact"
        return np.full((1, len(times)), math.nan if lost else 0.0), 1e-9 if lost else 1.0
    assert choice.choose(Scene(), measure).method == "exact"
