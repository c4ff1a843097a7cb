"""The exact solver against a second robot: heyoka's Taylor method with terminal events, written from the equations.

Every effect alone, then scenes drawn at random. Both round: over 0.2 s, with up to 1e2 impacts, that grows to at most
1e-13 m where nothing is lost; 1e-11 m leaves room for another machine's arithmetic, and is 1e7 times less than the
least effect compared here changes. Contacts: 1e-11 s, within which a mass of 5 m/s moves 5e-11 m.
"""

import random
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model.parameters import BY_NAME, SCENE_PARAMETERS

pytest.importorskip("heyoka", reason="heyoka, the extra `bench`, has no wheel for Python 3.10")

import peer_agreement
from peer_agreement import POSITION, assert_agreement, simulated

from vibro_ros.peer import COLUMNS, Peer

sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))
from random_scenes import draw

WITHOUT_FRICTION_AND_PLATES = {
    "effects.friction": "none", "effects.upper_contact": "none", "effects.inclined_contact": "none",
}
DAMPERS = {f"{side}.{part}.damping": value for side in ("upper", "inclined")
           for part, value in (("spring", 2.0), ("plate", 100.0))}
RIGID = {"effects.upper_contact": "restitution", "effects.inclined_contact": "restitution"}
DYING = {"upper.plate.restitution": 0.2, "inclined.plate.restitution": 0.4}
UNILATERAL = {"effects.normal_force": "unilateral"}
STRIBECK = {"effects.friction": "stribeck", "ground.static_friction": 0.35}
HOP = {"effects.normal_force": "hop"}
#: A soft plate: on a stiff one the misprint's force of 1e5 N makes 1e-8 m/s of what rounding leaves of an instant.
MISPRINT = {"effects.misprint": True, "inclined.plate.stiffness": 1e4}
HEAVY = {"effects.reaction": True, "effects.mass_weight": True}
SPEED_UP = ((0.03, {"motor_speed": 140.0}), (0.11, {"motor_speed": 60.0}))
GAPS = ((0.02, {"upper_gap": 0.0004, "inclined_gap": -0.0003}), (0.1, {"upper_gap": 0.0}))
THROWN = {"start.state": "given", "start.crank_angle": 20.0, "start.body_position": 0.3, "start.body_velocity": 0.2,
          "start.upper_position": 0.0601, "start.upper_velocity": 0.5, "start.inclined_position": 0.05,
          "start.inclined_velocity": -1.0}

EFFECTS = {
    "no plates, no friction": (WITHOUT_FRICTION_AND_PLATES, ()),
    "upper mass absent": (UNILATERAL | {"effects.upper_mass": False}, ()),
    "inclined mass absent": ({"effects.inclined_mass": False}, ()),
    "compliant plates without friction": ({"effects.friction": "none"}, ()),
    "Coulomb friction by weight": ({"effects.normal_force": "weight"}, ()),
    "Coulomb friction as printed": ({}, ()),
    "Coulomb friction on a ground that cannot pull": (UNILATERAL, ()),
    "static friction": (UNILATERAL | {"effects.friction": "static", "ground.static_friction": 0.35}, ()),
    "static friction that vanishes when the body slips": (
        UNILATERAL | {"effects.friction": "static", "ground.friction": 0.0}, ()),
    "Stribeck friction": (UNILATERAL | STRIBECK, ()),
    "Stribeck friction by weight": ({"effects.normal_force": "weight"} | STRIBECK, ()),
    "Stribeck friction as printed": (STRIBECK, ()),
    "Stribeck friction that vanishes at high speed": (UNILATERAL | STRIBECK | {"ground.friction": 0.0}, ()),
    "Stribeck friction that falls at once": (UNILATERAL | STRIBECK | DAMPERS | {"ground.stribeck_speed": 1e-6}, ()),
    "Stribeck friction that falls over all speeds": (UNILATERAL | STRIBECK | {"ground.stribeck_speed": 0.3}, ()),
    "Stribeck friction, rigid plates and a lag motor": (
        UNILATERAL | STRIBECK | RIGID | {"effects.motor": "lag", "motor.time_constant": 0.03}, SPEED_UP),
    "start at zero": (UNILATERAL | {"start.state": "zero"}, ()),
    "given start with a mass in its plate, backwards": (UNILATERAL | THROWN | {"start.body_velocity": -0.2}, ()),
    "given start in the air": (HOP | DAMPERS | HEAVY | THROWN | {
        "start.body_height": 0.01, "start.body_vertical_velocity": 0.3}, ()),
    "given start of a crank as long as the rods": (
        UNILATERAL | DAMPERS | THROWN | {"crank.radius": 0.06, "start.crank_angle": 2.0}, ()),
    "given start before rigid plates": (UNILATERAL | RIGID | THROWN | {"start.upper_position": 0.055}, SPEED_UP),
    "dampers and adhesion": (UNILATERAL | DAMPERS, ()),
    "dampers without tension": (UNILATERAL | DAMPERS | {"effects.adhesion": False}, ()),
    "rigid plates": (UNILATERAL | RIGID, ()),
    "rigid plates, reaction and weight": (
        UNILATERAL | RIGID | HEAVY, ()),
    "bounces that die out": (
        UNILATERAL | RIGID | DYING, ()),
    "bounces that die out at once": (
        UNILATERAL | RIGID | HEAVY | {"upper.plate.restitution": 0.001, "inclined.plate.restitution": 0.02}, GAPS),
    "reaction": (UNILATERAL | {"effects.reaction": True}, ()),
    "the paper's misprint": (MISPRINT, ()),
    "the paper's misprint on a ground that cannot pull": (
        MISPRINT | UNILATERAL | DAMPERS | {"effects.adhesion": False}, GAPS),
    "the paper's misprint by weight, upper plate rigid": (
        MISPRINT | {"effects.normal_force": "weight", "effects.upper_contact": "restitution"}, ()),
    "the paper's misprint, hop": (MISPRINT | HOP | DAMPERS, ()),
    "weight of the masses": (UNILATERAL | {"effects.mass_weight": True}, ()),
    "hop": (HOP | DAMPERS, ()),
    "hop without loss": (HOP, ()),
    "hop, reaction and weight": (HOP | DAMPERS | HEAVY, ()),
    "hop, reaction, static friction and no tension": (
        HOP | DAMPERS | HEAVY | {"effects.friction": "static", "ground.static_friction": 0.35,
                                 "effects.adhesion": False}, ()),
    "hop on ice": (HOP | DAMPERS | HEAVY | {"effects.friction": "none", "guide.angle": 2.2}, ()),
    "hop on a ground so smooth that a landing turns the body round": (
        HOP | DAMPERS | HEAVY | {"ground.friction": 0.005, "guide.angle": 0.8, "mass.inclined": 0.4,
                                 "upper.plate.damping": 20.0, "inclined.plate.damping": 20.0}, ()),
    "hop straight up": (HOP | DAMPERS | HEAVY | {"effects.inclined_mass": False}, ()),
    "hop with a lag motor": (
        HOP | DAMPERS | HEAVY | {"effects.motor": "lag", "motor.time_constant": 0.03}, SPEED_UP),
    "hop with moving plates": (HOP | DAMPERS, GAPS),
    "a blow throws the body up": (HOP | RIGID, ()),
    "a blow throws the body up, reaction": (HOP | RIGID | {"effects.reaction": True}, ()),
    "a blow throws the body up, reaction and weight": (HOP | RIGID | HEAVY, ()),
    "a blow throws the body up from ice": (HOP | RIGID | HEAVY | {"effects.friction": "none"}, ()),
    "a blow throws the body up, static friction": (
        HOP | RIGID | HEAVY | {"effects.friction": "static", "ground.static_friction": 0.35, "guide.angle": 1.3}, ()),
    "blows that die out on a body in flight": (HOP | RIGID | HEAVY | DYING, GAPS),
    "blows without rebound on a body that hops": (
        HOP | RIGID | HEAVY | {"upper.plate.restitution": 0.0, "inclined.plate.restitution": 0.0}, GAPS),
    "a mass that rests on its plate parts from a body that lands or is struck": (
        HOP | RIGID | HEAVY | {"inclined.gap": -0.004, "inclined.plate.restitution": 0.0, "upper.gap": 0.004,
                               "inclined.spring.stiffness": 5e3}, ()),
    "a landing drives a mass that rests on its plate against it": (
        HOP | RIGID | HEAVY | {
            "inclined.gap": -0.019, "inclined.plate.restitution": 0.0, "inclined.spring.stiffness": 21e3,
            "upper.gap": 0.0075, "upper.plate.restitution": 0.0, "mass.upper": 0.47, "upper.spring.stiffness": 190.0,
            "mass.body": 0.76, "ground.friction": 0.77, "guide.angle": 1.15}, ()),
    "masses that rest on their plates fly with the body": (
        HOP | RIGID | DYING | {"upper.gap": -0.004, "inclined.gap": -0.004}, ()),
    "one plate rigid, one with a damper that cannot pull": (
        HOP | DAMPERS | HEAVY | {"effects.upper_contact": "restitution", "effects.adhesion": False}, ()),
    "a body that stops no longer presses its plate on a mass at rest": (
        HOP | RIGID | {
            "effects.reaction": True, "guide.angle": 1.0554, "ground.friction": 0.3717,
            "inclined.plate.restitution": 0.0, "inclined.gap": -0.0152, "upper.gap": -0.0117, "mass.inclined": 0.4716,
            "mass.upper": 0.4185, "inclined.spring.stiffness": 358.9158, "motor.speed": 76.2974}, ()),
    "a rigid plate throws up a body that only jumps": (HOP | RIGID | HEAVY | {"effects.inclined_mass": False}, ()),
    "ideal motor": (UNILATERAL, SPEED_UP),
    "ramp motor": (UNILATERAL | {"effects.motor": "ramp", "motor.acceleration": 800.0}, SPEED_UP),
    "lag motor": (UNILATERAL | {"effects.motor": "lag", "motor.time_constant": 0.03}, SPEED_UP),
    "moving plates": (UNILATERAL, GAPS),
    "moving rigid plates": (UNILATERAL | RIGID, GAPS),
    "an inclined guide that points down, the upper plate rigid": (
        UNILATERAL | RIGID | {"effects.inclined_contact": "compliant", "guide.angle": 2.0}, ()),
    "crank as long as the rods": (UNILATERAL | DAMPERS | {"crank.radius": 0.06}, ()),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_agrees_with_the_peer(name):
    """A40. Each effect alone and with those that meet it, with and without commands."""
    changes, commands = EFFECTS[name]
    duration = 0.3 if name.startswith("a body that stops") else 0.2
    assert_agreement(vibro_ros.load_scene("paper").with_parameters(changes), duration, commands)


def test_a_blow_without_rebound_moves_the_body():
    changes = UNILATERAL | RIGID | {"upper.plate.restitution": 0.2, "inclined.plate.restitution": 0.0}
    assert_agreement(vibro_ros.load_scene("paper").with_parameters(changes), 0.2)


def test_a_body_lifts_off_in_an_impact_and_lands_slipping_sticking_or_turned_round():
    """What the scenes with the rule `hop` compare, besides the motion: every kind of lift-off and landing occurs."""
    landings = []
    for name in ("hop", "hop on a ground so smooth that a landing turns the body round"):
        peer = Peer(vibro_ros.load_scene("paper").with_parameters(EFFECTS[name][0]))
        events = peer.run(0.2, 200.0).events
        kinds = events["kind"]
        lift_off, impacts = events["time"][kinds == "lift_off"], events[kinds == "upper_contact"]
        ends = impacts["time"] + impacts["duration"]
        assert np.any((lift_off[:, None] > impacts["time"]) & (lift_off[:, None] < ends)), name
        instants = events["time"][kinds == "landing"]
        around = peer.integrate(np.ravel(np.column_stack((instants - 1e-9, instants + 1e-9)))).samples
        landings.append(np.stack((around[::2], around[1::2])))
    before, after = np.concatenate(landings, axis=1)
    speed, height, climb = (COLUMNS.index(f"body_{column}") for column in ("velocity", "height", "vertical_velocity"))
    assert np.all(before[:, climb] < 0.0)
    assert np.any(before[:, speed] * after[:, speed] > 0.0)
    assert np.any(after[:, speed] == 0.0)
    assert np.any(before[:, speed] * after[:, speed] < 0.0)
    grounded = after[:, height] == 0.0  # the others lifted off again in the same instant
    assert np.count_nonzero(grounded) > 5
    assert np.all(after[grounded, climb] == 0.0)


def test_a_mass_at_rest_parts_from_a_body_that_lands_or_is_struck_or_is_driven_against_it():
    """What the scenes with the rule `hop` and rigid plates compare: every shock that a mass at rest can feel occurs."""
    parted, struck, driven = 0, 0, 0
    for name in ("a mass that rests on its plate parts from a body that lands or is struck",
                 "a landing drives a mass that rests on its plate against it"):
        events = Peer(vibro_ros.load_scene("paper").with_parameters(EFFECTS[name][0])).run(0.2, 200.0).events
        falls = events["time"][events["kind"] == "landing"]
        upper, inclined = (events[events["kind"] == f"{side}_contact"] for side in ("upper", "inclined"))
        rests = inclined[inclined["duration"] > 1e-5]
        ends = rests["time"] + rests["duration"]
        blows = inclined["time"][inclined["speed"] > 1e-3]
        parted += np.isclose(ends[:, None], falls, rtol=0.0, atol=1e-13).sum()
        struck += np.isclose(ends[:, None], upper["time"], rtol=0.0, atol=1e-13).sum()
        driven += np.isin(falls, blows).sum()
    assert parted > driven > 0
    assert struck > 0


def test_the_damped_device_agrees_for_longer_than_chaos_would_let_it():
    """2 s; the motion contracts, so that the limits of 0.2 s hold. The plate arrives between two samples: at one, the
    rounding of the instant would decide whether it still moves."""
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0, "solver.audit": False})
    peer = assert_agreement(scene, 2.0, ((0.5, {"motor_speed": 120.0, "upper_gap": 0.00052}),))
    assert np.count_nonzero(peer.events["kind"] == "upper_contact") > 20


@pytest.mark.parametrize("seed", [*range(200, 217), *range(218, 224)])
def test_a_random_scene_agrees_with_the_peer(seed):
    """Over 0.1 s; 1e-10 m, for stiff plates that a mass chatters on. In scene 217, left out, a body hops while a mass
    bounces on it until the order of both is lost in rounding, at 1e-6 m/s: no arithmetic decides the number of bounces.
    """
    changes, commands = draw(seed)
    changes |= random_extras(random.Random(seed), changes)
    scene = vibro_ros.load_scene("paper").with_parameters(changes)
    assert_agreement(scene, 0.1, [(float(time), change) for time, change in commands], position=1e-10)


def random_extras(pick, changes):
    """Effects that `draw` does not know: a motor with lag, a body that hops, rigid plates and Stribeck friction where
    the scene may have them."""
    rule = changes["effects.normal_force"]
    if rule == "unilateral":
        rule = pick.choice([rule, "hop"])
    extras = {"effects.motor": pick.choice([changes["effects.motor"], "lag"]), "effects.normal_force": rule}
    if rule == "weight" or (rule in ("unilateral", "hop") and changes["guide.angle"] < 1.57):
        extras |= {f"effects.{side}_contact": pick.choice(["compliant", "restitution"])
                   for side in ("upper", "inclined")}
    may_decay = changes["effects.friction"] != "none" and rule != "hop" and not changes["effects.reaction"]
    if may_decay and pick.random() < 0.5:
        extras |= {"effects.friction": "stribeck", "ground.stribeck_speed": 10.0 ** pick.uniform(-5.0, 0.0),
                   "ground.static_friction": changes["ground.friction"] * pick.uniform(1.0, 2.5)}
    return extras


def test_the_peer_notices_an_effect_left_out():
    """What the comparison would find, were a term missing in one of the two."""
    scene = vibro_ros.load_scene("damped")
    with pytest.raises(AssertionError, match="off by"):
        times = np.linspace(0.0, 0.2, 41)
        lighter = scene.with_parameters({"effects.reaction": True})
        peer, samples = Peer(scene).integrate(times).samples, simulated(lighter, times, ())[0]
        error = max(np.abs(peer[:, k] - samples[COLUMNS[k]]).max() for k in range(0, len(COLUMNS), 2))
        assert error <= 1e7 * POSITION, f"off by {error}"


@pytest.mark.parametrize("quantity", [
    "upper_drive_force", "inclined_drive_force", "upper_plate_force", "inclined_plate_force", "normal_force",
    "friction_force", "motor_torque", "motor_power", "peak_force"])
@pytest.mark.parametrize("name", ["hop, reaction and weight", "rigid plates, reaction and weight"])
def test_a_force_off_by_a_millionth_is_noticed(name, quantity, monkeypatch):
    def simulated_wrongly(*arguments):
        samples, events = simulated(*arguments)
        (events if quantity == "peak_force" else samples)[quantity] *= 1.0 + 1e-6
        return samples, events

    monkeypatch.setattr(peer_agreement, "simulated", simulated_wrongly)
    with pytest.raises(AssertionError, match="peak of" if quantity == "peak_force" else quantity):
        assert_agreement(vibro_ros.load_scene("paper").with_parameters(EFFECTS[name][0]), 0.2)


def test_a_choice_and_a_number_that_the_peer_does_not_have_are_refused(monkeypatch):
    """As a later version of the model may have them."""
    for name, value in (("effects.friction", "viscous"), ("ground.wind", 0.3)):
        monkeypatch.setitem(BY_NAME, name, replace(BY_NAME["effects.friction"], name=name, default=0.0))
        scene = vibro_ros.load_scene("paper")
        object.__setattr__(scene, "parameters", {**scene.parameters, name: value})
        with pytest.raises(ValueError, match=f"scene paper: {name}: {value!r} is not simulated by peer"):
            Peer(scene)


def test_every_effect_that_a_scene_may_have_is_compared():
    """By name and value: who adds one to the model is told here to add it to the peer and to `EFFECTS`."""
    default = vibro_ros.load_scene("paper")
    compared = {name: {default[name]} for name in default.parameters if name.startswith(("effects.", "start.state"))}
    for changes, _ in EFFECTS.values():
        for name in compared.keys() & changes.keys():
            compared[name].add(changes[name])
    choices = {parameter.name: set(parameter.choices or (True, False)) for parameter in SCENE_PARAMETERS
               if parameter.name in compared}
    assert compared == choices


def test_a_peer_runs_again_from_the_start():
    peer = Peer(vibro_ros.load_scene("unilateral"), tolerance=1e-9)
    first, second = (peer.run(duration=0.2, rate=200.0) for _ in range(2))
    assert len(first.samples) == 41
    np.testing.assert_array_equal(first.samples, second.samples)
