"""The bench's opponent is a fair one: it tends to the exact solution of every scene as its step falls."""

import numpy as np
import pytest

from tools import baseline, bench
from vibro_ros import load_scene

DURATION = {"rigid": 0.2, "device": 0.6}  # s; the device's motor takes 0.5 s to its speed; 0.3 s for the others


def errors(name, steps):
    """Largest errors [m] of a mass and of the body, its height included, for each step [s]."""
    times = np.arange(round(200 * DURATION.get(name, 0.3)) + 1) / 200.0
    exact, _ = bench.run_exact(load_scene(name), times)
    places = np.array([exact.upper_position, exact.inclined_position, exact.body_position, exact.body_height]).T
    return [np.abs(bench.run_baseline(load_scene(name), times, step)[:, ::2] - places).max() for step in steps]


@pytest.mark.parametrize("name", bench.SCENES)
def test_the_baseline_tends_to_the_exact_solution(name):
    """Steps that ignore events are of first order in body and contacts, with luck in where they fall: a step 20
    times shorter must leave less than a fifth of the error, and the bench's step is right to 1 mm."""
    usual, shorter, shortest = errors(name, (1e-5, 5e-7, 2.5e-8 if name == "no_impact" else 1e-7))
    assert 1e-12 < shorter < usual / 5 < 1e-3 / 5
    assert shortest < usual / 25


def test_without_events_the_baseline_is_of_fourth_order():
    """Masses that swing freely on their ramping drives: halved steps leave a sixteenth of the error."""
    scene = load_scene("device").with_parameters({
        "effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.friction": "none",
        "motor.acceleration": 50.0})  # the ramp lasts longer than the run: its end would be an event
    times = np.arange(41) / 200.0
    exact, _ = bench.run_exact(scene, times)
    coarse, fine = (np.abs(bench.run_baseline(scene, times, step)[:, 2] - exact.inclined_position).max()
                    for step in (1e-3, 5e-4))
    assert 14.0 < coarse / fine < 18.0


@pytest.mark.parametrize(("changes", "lacking"), [
    ({"effects.upper_mass": False}, "upper_mass: false"), ({"effects.motor": "lag"}, "motor: 'lag'"),
    ({"effects.friction": "static", "ground.static_friction": 0.5}, "friction: 'static'"),
    ({"effects.friction": "stribeck", "effects.reaction": False, "effects.normal_force": "unilateral"},
     "friction: 'stribeck'"),
    ({"effects.upper_contact": "restitution", "effects.normal_force": "unilateral"},
     "reaction: True is not simulated by baseline with rigid plates"),
    ({"effects.upper_contact": "restitution", "effects.reaction": False},
     "normal_force: 'hop' is not simulated by baseline with rigid plates")])
def test_effects_that_it_lacks_are_refused(changes, lacking):
    with pytest.raises(ValueError, match=f"scene device: effects.{lacking}"):
        baseline.integrate_rk4(load_scene("device").with_parameters(changes), np.zeros(4), 0.1, 100.0)
