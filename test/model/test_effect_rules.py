"""The rules for a new effect name files, functions and parameters that exist."""

import re
from pathlib import Path

import pytest

import vibro_ros.model.modes

ROOT = Path(__file__).resolve().parents[2]
RULES = vibro_ros.model.modes.__doc__.partition("Rules for a new effect")[2]
SOURCES = "\n".join(path.read_text(encoding="utf-8") for folder in ("vibro_ros", "test")
                    for path in (ROOT / folder).rglob("*.py") if path != Path(__file__)).replace(RULES, "")


def test_rules_are_numbered_from_one():
    numbers = [int(number) for number in re.findall(r"^(\d+)\. ", RULES, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1)) and len(numbers) > 8


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([\w/]+\.py)`", RULES))))
def test_files_of_the_rules_exist(name):
    own = [path for folder in ("vibro_ros", "vibro_ros/model") if (path := ROOT / folder / name).is_file()]
    assert own or list((ROOT / "test").rglob(name))


@pytest.mark.parametrize("name", sorted(set(re.findall(r"`([A-Za-z_][\w.]*)(?:\(\))?`", RULES))
                                        - set(re.findall(r"`(\w+\.py)`", RULES))))
def test_names_of_the_rules_are_in_the_code(name):
    """Of `Class.method` both; `effects.` is the beginning of names."""
    for part in filter(None, name.split(".")):
        assert re.search(rf"\b{part}\b|[\"']{part}\.", SOURCES), part
