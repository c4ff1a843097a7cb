"""The table of effects: counts, costs and speeds of pairs of scenes."""

from pathlib import Path

import pytest

from tools import effects
from tools.effects import size
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.model.parameters import SCENE_PARAMETERS

DEVICE = load_scene("device")
EFFECTS = {effect.name: effect for effect in effects.EFFECTS}


def test_sizes_are_those_that_can_be_counted_by_hand():
    """Two masses, no plates, no friction, N = M g: the equations of u and w each contain their own spring and slider,
    and x follows w.
    """
    plain = DEVICE.with_parameters({
        "effects.upper_contact": "none", "effects.inclined_contact": "none", "effects.friction": "none",
        "effects.normal_force": "weight", "effects.reaction": False, "effects.mass_weight": False,
        "upper.spring.damping": 0.0, "inclined.spring.damping": 0.0})
    assert size(plain) == effects.Size(states=6, modes=1, terms=2 + 2 + 1, guards=0)
    plate = plain.with_parameters({"effects.upper_contact": "compliant", "effects.adhesion": True})
    # In contact u'' reads u, u', the slider, the plate's place and its speed.
    assert size(plate) == effects.Size(states=6, modes=2, terms=5 + 2 + 1, guards=1)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_each_effect_changes_its_own_parameters_and_nothing_else(effect):
    with_it, without = effect.scenes()
    changed = {name for name in with_it.parameters if with_it[name] != without[name]}
    assert changed == set(effect.without)


def test_every_choice_of_every_effect_is_compared_in_a_row():
    """A developer who adds a choice of an effect or a start learns here to add a row."""
    choosing = [parameter for parameter in SCENE_PARAMETERS if parameter.name.startswith("effects.")
                or parameter.name == "start.state"]
    compared = {parameter.name: {scene[parameter.name] for effect in effects.EFFECTS for scene in effect.scenes()
                                 if parameter.name in effect.without} for parameter in choosing}
    choices = {parameter.name: set(parameter.choices or (True, False)) for parameter in choosing}
    assert compared == choices


@pytest.mark.parametrize("name", ["upper mass", "slope of 0.05 rad", "reaction on the masses",
                                  "`printed`, not `unilateral`"])
def test_the_documents_motions_are_still_the_robots(name):
    document = (Path(__file__).resolve().parents[3] / "docs" / "robot.md").read_text(encoding="utf-8")
    [row] = [line for line in document.splitlines() if line.startswith(f"| {name} |")]
    cost = row.split(" | ")[5]
    assert row == effects.line(EFFECTS[name], cost)


def test_several_motions_are_no_mean():
    """At 100 rad/s `device` has a second motion, to which one of 32 random starts leads."""
    assert effects.motions(DEVICE) == "-73.6 (31 of 32), -61.0 (1 of 32)"
