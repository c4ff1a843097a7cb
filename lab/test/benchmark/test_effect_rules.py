"""Rules for a new effect: the places that the head of `model/modes.py` names exist, and simulators without the effect
refuse it.
"""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import vibro_ros.model.modes
from benchmark.support import ANY, SIMULATORS, SUPPORT, unsupported
from vibro_ros.model.energy import ACCOUNTS
from vibro_ros.model.ground import GROUND_STATES
from vibro_ros.model.modes import MODE_EVENTS
from vibro_ros.model.parameter_values import GROUND_FORCES
from vibro_ros.model.parameters import BY_NAME, SCENE_PARAMETERS

ROOT = Path(__file__).resolve().parents[3]
PLACES = vibro_ros.model.modes.__doc__.partition("Places of a new effect")[2]
FILES = re.findall(r"`([\w/]+\.py)`", PLACES)


def test_the_places_exist():
    for name in FILES:
        assert any((ROOT / folder / name).is_file() for folder in (".", "vibro_ros", "vibro_ros/model")) or any(
            folder.rglob(name) for folder in (ROOT / "test", ROOT / "vibro_ros", ROOT / "lab")), name
    sources = "\n".join(path.read_text(encoding="utf-8") for folder in ("vibro_ros", "test", "tools", "lab")
                        for path in (ROOT / folder).rglob("*.py")).replace(PLACES, "")
    for name in set(re.findall(r"`([A-Za-z_][\w.]*)(?:\(\))?`", PLACES)) - set(FILES):
        for part in filter(None, name.split(".")):
            assert re.search(rf"\b{part}\b", sources), name


def test_every_force_of_the_ground_has_its_law_its_parameter_and_its_place_in_the_documents():
    text = (ROOT / "docs/robot.md").read_text(encoding="utf-8")
    for force in GROUND_FORCES:
        assert callable(force.law) and force.parameter in SUPPORT
        assert force.symbol in text and force.parameter in text and force.account in ("", *ACCOUNTS)


def test_every_event_of_a_state_is_a_kind_of_event():
    events = {event for state in GROUND_STATES.values() for event in (state.begins, state.ends) if event}
    assert events | {"crank_stops", "crank_turns"} == set(MODE_EVENTS)


def test_every_parameter_of_the_equations_has_a_row():
    """A developer who adds a parameter states there whether heyoka's robot and Runge-Kutta by hand support it."""
    assert set(SUPPORT) == {parameter.name for parameter in SCENE_PARAMETERS
                            if not parameter.name.startswith(("solver.", "sensors."))}
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
