"""What a simulator with equations of its own does not have is refused, numbers as well as choices."""

from dataclasses import replace

import pytest

import vibro_ros
from vibro_ros.model.parameters import BY_NAME, SCENE_PARAMETERS
from vibro_ros.model.support import ANY, SIMULATORS, SUPPORT, unsupported


def test_every_parameter_of_the_equations_has_a_row():
    """Who adds a parameter says here whether moreau, peer and baseline have it."""
    assert set(SUPPORT) == {one.name for one in SCENE_PARAMETERS if not one.name.startswith("solver.")}
    for name, known in SUPPORT.items():
        assert len(known) == len(SIMULATORS) and all(ANY in (values,) or BY_NAME[name].default in values
                                                     for values in known)


@pytest.mark.parametrize("simulator", SIMULATORS)
def test_a_new_number_is_refused_when_it_has_an_effect(simulator, monkeypatch):
    monkeypatch.setitem(BY_NAME, "ground.wind", replace(BY_NAME["ground.friction"], name="ground.wind", default=0.0))
    scene = vibro_ros.load_scene("paper")
    for value, fault in ((0.0, ""), (0.3, f"ground.wind: 0.3 is not simulated by {simulator}; give 0.0")):
        object.__setattr__(scene, "parameters", {**scene.parameters, "ground.wind": value})
        assert unsupported(scene, simulator) == fault
