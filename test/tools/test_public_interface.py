"""The Python interface keeps what the last release promised, until the major version rises."""

import pytest

from tools.public_interface import FILE, HEAD, complaints, interface, main

CODE = interface()
RELEASED = f"{HEAD.format('2.0.0')}\n{CODE}"


def test_the_code_has_all_of_the_last_release(capsys):
    assert main(["--check"]) == 0, capsys.readouterr().err
    assert "class Simulator:" in FILE.read_text() and "def simulate(" in FILE.read_text()


@pytest.mark.parametrize(("old", "new", "words"), [
    ("def load_scene(", "def load(", "load_scene"),
    ("class Simulator:", "class Device:", "Simulator"),
    ("    def push(", "    def shove(", "Simulator.push"),
    ("duration: float | None = None, rate", "rate: float | None = None, duration", "simulate"),
    ("name_or_path: str | Path, node", "name_or_path: str | Path, more: int, node", "load_scene(more)")])
def test_a_name_or_place_that_a_program_relies_on_needs_a_new_major_version(old, new, words):
    assert complaints(RELEASED, CODE, "2.0.0") == []
    changed = CODE.replace(old, new)
    lost = complaints(RELEASED, changed, "2.1.0")
    assert any(words in line and "CHANGELOG" in line and "version 2.0.0 has it" in line for line in lost), lost
    assert complaints(RELEASED, changed, "3.0.0") == []


def test_a_new_name_and_a_parameter_behind_the_others_break_nothing():
    changed = CODE.replace("name_or_path: str | Path, node: str | None = None",
                           "name_or_path: str | Path, node: str | None = None, more: int = 0")
    assert changed != CODE
    assert complaints(RELEASED, f"{changed}def new() -> None: ...\n", "2.0.0") == []
