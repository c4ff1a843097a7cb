"""Runge-Kutta by hand is fair: it tends to the exact solution of every scene as its step falls."""

import numpy as np
import pytest

from benchmark import rk4_by_hand
from benchmark.costs import SCENES
from benchmark.rk4_by_hand import PROGRAM
from vibro_lab.accuracy.harness import SceneProblem
from vibro_lab.accuracy.programs import Setting, UnableError, by_device
from vibro_ros import load_scene

DURATION = {"rigid": 0.2, "device": 0.6}  # s; the device's motor takes 0.5 s to its speed; 0.3 s for the others


def positions(scene, times, step):
    """u, w, x and y [m] at `times`, shape (n, 4)."""
    return PROGRAM.prepare(SceneProblem(scene, times), Setting(step, ""))().samples[:, ::2]


def errors(name, steps):
    """Largest errors [m] of a mass and of the body, its height included, for each step [s]."""
    scene, times = load_scene(name), np.arange(round(200 * DURATION.get(name, 0.3)) + 1) / 200.0
    exact = by_device("exact", scene, times, 1e-12).samples[:, ::2]
    return [np.abs(positions(scene, times, step) - exact).max() for step in steps]


@pytest.mark.parametrize("name", [name for name in SCENES if name != "machine"])
def test_it_tends_to_the_exact_solution(name):
    """Steps that ignore events are of first order in body and contacts, with luck in where they fall: a step 20
    times shorter must leave less than a fifth of the error, and the headlines' step is right to 1 mm."""
    usual, shorter, shortest = errors(name, (1e-5, 5e-7, 2.5e-8 if name == "no_impact" else 1e-7))
    assert 1e-12 < shorter < usual / 5 < 1e-3 / 5
    assert shortest < usual / 25


def test_it_is_compiled():
    """Without compilation it would cost 200 times as much, which would flatter the other programs by that factor."""
    scene = load_scene("unilateral")
    positions(scene, np.arange(3) / 200.0, 1e-5)
    assert rk4_by_hand._integrate.signatures


def test_without_events_it_is_of_fourth_order():
    """Masses that swing freely on their ramping drives: halved steps leave a sixteenth of the error."""
    scene = load_scene("device").with_parameters({
        "effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.friction": "none",
        "motor.acceleration": 50.0})  # the ramp lasts longer than the run: its end would be an event
    times = np.arange(41) / 200.0
    exact = by_device("exact", scene, times, 1e-12).samples[:, 2]
    coarse, fine = (np.abs(positions(scene, times, step)[:, 1] - exact).max() for step in (1e-3, 5e-4))
    assert 14.0 < coarse / fine < 18.0


@pytest.mark.parametrize(("changes", "lacking"), [
    ({"effects.upper_mass": False}, "upper_mass: false"), ({"effects.motor": "lag"}, "motor: 'lag'"),
    ({"effects.friction": "static", "ground.static_friction": 0.5}, "friction: 'static'"),
    ({"effects.friction": "stribeck", "effects.reaction": False, "effects.normal_force": "unilateral"},
     "friction: 'stribeck'"),
    ({"effects.upper_contact": "restitution", "effects.normal_force": "unilateral"},
     "reaction: True is not simulated by rk4_by_hand with rigid plates"),
    ({"effects.upper_contact": "restitution", "effects.reaction": False},
     "normal_force: 'hop' is not simulated by rk4_by_hand with rigid plates")])
def test_effects_that_it_lacks_are_refused(changes, lacking):
    with pytest.raises(UnableError, match=f"effects.{lacking}"):
        positions(load_scene("device").with_parameters(changes), np.arange(11) / 100.0, 1e-5)
