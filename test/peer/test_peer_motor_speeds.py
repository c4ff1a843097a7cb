"""The exact solver against the peer at the motor's extremes, with plates and friction (see `test_peer.py`)."""

import math

import numpy as np
import pytest

import vibro_ros

pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, has no wheel for Python 3.10")

from peer_agreement import assert_agreement

PAPER = vibro_ros.load_scene("paper")
DAMPERS = {f"{side}.{part}.damping": value for side in ("upper", "inclined")
           for part, value in (("spring", 2.0), ("plate", 100.0))}
RIGID = {f"effects.{side}_contact": "restitution" for side in ("upper", "inclined")}
HEAVY = {"effects.reaction": True, "effects.mass_weight": True}
SCENES = {
    "as printed": DAMPERS,
    "unilateral": DAMPERS | {"effects.normal_force": "unilateral"},
    "rigid": DAMPERS | RIGID | {"effects.normal_force": "unilateral"},
    "hop": DAMPERS | HEAVY | {"effects.normal_force": "hop", "effects.adhesion": False},
    "rigid and hop": DAMPERS | RIGID | HEAVY | {"effects.normal_force": "hop"},
}


def count(run, *kinds):
    return np.count_nonzero(np.isin(run.events["kind"], kinds))


@pytest.mark.parametrize("name", SCENES)
def test_the_fastest_motor_agrees_with_the_peer(name):
    """A41. 1e4 rad/s, the highest that may be allowed: 80 turns, in which the masses reach their plates from 0."""
    scene = PAPER.with_parameters(SCENES[name] | {
        "motor.max_speed": 1e4, "motor.speed": 1e4, "start.state": "zero"})
    run = assert_agreement(scene, 0.05)
    assert count(run, "upper_contact", "inclined_contact") >= 3
    assert count(run, "slip_forward", "slip_backward") >= 1


LEAN = PAPER["guide.angle"]
SLIDER = 0.02 * math.cos(LEAN) + math.sqrt(0.06**2 - (0.02 * math.sin(LEAN)) ** 2)  # the inclined one, at first


# Not where rigid plates throw up a body: bounces that die out, at 1e-9 m/s, decide there when it sticks.
@pytest.mark.parametrize("name", [name for name in SCENES if name != "rigid and hop"])
def test_a_very_slow_motor_agrees_with_the_peer(name):
    """A41. 0.01 rad/s for 5 s: the masses bounce and come to rest, the upper one on its plate, off which its slider
    draws it at last, the inclined one on its slider, which carries it to its plate.

    A mass may be off by 1e-14 m, and one that passes its plate at 1e-9 m/s does so at another instant.
    """
    sag = 0.1 * 9.81 / 1e3 if SCENES[name].get("effects.mass_weight") else 0.0
    run = assert_agreement(PAPER.with_parameters(SCENES[name] | {
        "motor.speed": 0.01, "start.state": "zero", "upper.gap": 0.01999 - sag, "inclined.gap": SLIDER - 0.06 + 3e-4}),
        5.0, place=1e-14)
    events = {side: run.events[run.events["kind"] == f"{side}_contact"] for side in ("upper", "inclined")}
    assert count(run, "upper_contact", "inclined_contact") >= 30
    assert count(run, "stick") >= 1
    assert np.any((events["upper"]["duration"] > 1.0) & np.isfinite(events["upper"]["duration"]))
    assert np.any(events["inclined"]["time"] > 1.5) and np.isinf(events["inclined"]["duration"][-1])


@pytest.mark.parametrize("name", ["as printed", "unilateral", "hop"])
def test_masses_that_follow_a_slow_crank_on_their_plates_agree_with_the_peer(name):
    """In segments that a stiff plate does not cut short, until a plate moves, and again after it has stopped."""
    scene = PAPER.with_parameters(SCENES[name] | {
        "motor.speed": 8.0, "start.state": "rest", "upper.gap": -0.01, "inclined.gap": -0.01, "ground.friction": 2.0})
    commands = ((0.15, {"upper_gap": -0.012}), (0.3, {"inclined_gap": -0.008}))
    assert_agreement(scene, 0.5, commands)
    device = vibro_ros.Simulator(scene)
    device.advance_to(0.1)
    before = device.statistics["steps"]
    device.advance_to(0.15)
    assert device.statistics["steps"] - before < 20  # those that vibrate: 170
