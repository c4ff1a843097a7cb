"""docs/public_names.md lists the public names of the code, and loses one only with a new major version."""

import pytest

from tools import public_names
from tools.generated_text import replaced
from tools.public_names import complaints, main

PAGE = public_names.PAGE.read_text(encoding="utf-8")
CODE = public_names.names_of_the_code()
OF_CODE = replaced(PAGE, public_names.BEGIN, public_names.END, public_names.tables(CODE))
"""The page as it should be."""


def with_topics(*topics):
    return {**CODE, "direction | topics": {**CODE["direction | topics"], "out": topics}}


def test_the_page_lists_the_public_names_of_the_code():
    wrong = complaints(PAGE)
    assert not wrong, "\n".join(wrong)
    assert public_names.major_of_the_page(PAGE) == public_names.major_of_the_package(), \
        "docs/public_names.md has the names of another major version; run `python -m tools.public_names`"


def test_every_table_has_names():
    assert all(any(rows.values()) for rows in CODE.values())
    assert all(found for head, rows in CODE.items() if not head.startswith(("function", "executable"))
               for found in rows.values())


@pytest.mark.parametrize("major", [1, 2])
def test_a_lost_name_needs_a_new_major_version(major, tmp_path, monkeypatch, capsys):
    page = tmp_path / "page.md"
    page.write_text(OF_CODE.replace(f"names of version {public_names.major_of_the_page(PAGE)}", "names of version 1"))
    before = page.read_text()
    monkeypatch.setattr(public_names, "PAGE", page)
    monkeypatch.setattr(public_names, "names_of_the_code", lambda: with_topics("odom", "new"))
    monkeypatch.setattr(public_names, "major_of_the_package", lambda: major)
    told = complaints(before)
    assert any(line.startswith("gone") and "topics of out: `impacts`" in line and "major version" in line
               for line in told)
    assert any(line.startswith("public") and "topics of out: `new`" in line and "CHANGELOG" in line for line in told)
    assert main() == (1 if major == 1 else 0)
    assert (page.read_text() == before) == (major == 1) == ("`impacts`" in capsys.readouterr().err)
    assert major == 1 or not complaints(page.read_text())
    assert f"names of version {major}" in page.read_text()


@pytest.mark.parametrize(("parameters", "lost"), [
    (("name_or_path", "node", "more"), 0), (("name_or_path", "more", "node"), 1)])
def test_a_parameter_behind_the_others_is_new_and_one_between_them_moves_another(parameters, lost, monkeypatch):
    changed = {**CODE, public_names.PYTHON: {**CODE[public_names.PYTHON], "`load_scene`": parameters}}
    monkeypatch.setattr(public_names, "names_of_the_code", lambda: changed)
    told = [line.partition(" ")[0] for line in complaints(OF_CODE)]
    assert told == lost * ["gone"] + (1 + lost) * ["public"]
