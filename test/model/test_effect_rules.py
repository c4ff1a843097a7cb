"""A new effect has at most twelve places, which exist under the names that the head of `model/modes.py` gives them."""

import re
from pathlib import Path

import vibro_ros.model.modes
from vibro_ros.model.energy import ACCOUNTS
from vibro_ros.model.ground import GROUND_FORCES, GROUND_STATES, Ground
from vibro_ros.model.modes import MODE_EVENTS
from vibro_ros.model.support import SUPPORT

ROOT = Path(__file__).resolve().parents[2]
PLACES = vibro_ros.model.modes.__doc__.partition("Places of a new effect")[2]
FILES = re.findall(r"`([\w/]+\.py)`", PLACES)


def test_a_new_effect_has_at_most_twelve_places():
    numbers = [int(number) for number in re.findall(r"^(\d+)\. ", PLACES, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1)) and len(numbers) <= 12


def test_the_places_exist():
    for name in FILES:
        assert any((ROOT / folder / name).is_file() for folder in (".", "vibro_ros", "vibro_ros/model")) or any(
            folder.rglob(name) for folder in (ROOT / "test", ROOT / "vibro_ros")), name
    sources = "\n".join(path.read_text(encoding="utf-8") for folder in ("vibro_ros", "test", "tools")
                        for path in (ROOT / folder).rglob("*.py")).replace(PLACES, "")
    for name in set(re.findall(r"`([A-Za-z_][\w.]*)(?:\(\))?`", PLACES)) - set(FILES):
        for part in filter(None, name.split(".")):
            assert re.search(rf"\b{part}\b", sources), name


def test_every_force_of_the_ground_has_its_law_its_parameter_and_its_place_in_the_documents():
    text = (ROOT / "docs/robot.md").read_text(encoding="utf-8")
    for force in GROUND_FORCES:
        assert callable(getattr(Ground, force.name)) and force.parameter in SUPPORT
        assert force.symbol in text and force.parameter in text and force.account in ("", *ACCOUNTS)


def test_every_event_of_a_state_of_the_ground_is_a_kind_of_event():
    events = {event for state in GROUND_STATES.values() for event in (state.begins, state.ends) if event}
    assert events == set(MODE_EVENTS)
