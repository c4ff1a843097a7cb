"""docs/known_answers.md and the tests agree: each number has its tests, and each test cites its numbers."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "known_answers.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (A\d+) \|(.*)\|$", PAGE, re.MULTILINE)
NUMBER = re.compile(r"\bA\d+\b")


def docstrings(path: Path) -> dict[str, str]:
    """Return the docstrings of a file's tests by the names of the tests."""
    return {node.name: ast.get_docstring(node) or "" for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")}


def cited_numbers() -> dict[tuple[str, str], set[str]]:
    """Return the numbers in the docstring of each test of the repository, by file and test."""
    cited = {(path.name, test): set(NUMBER.findall(text)) for folder in ("test", "lab/test")
             for path in (ROOT / folder).rglob("test_*.py") for test, text in docstrings(path).items()}
    return {test: numbers for test, numbers in cited.items() if numbers}


def numbers_on_page() -> dict[tuple[str, str], set[str]]:
    """Return the numbers of each test on the page, by file and test."""
    on_page: dict[tuple[str, str], set[str]] = {}
    for number, row in ROWS:
        for test in re.findall(r"`(test_\w+\.py)::(test_\w+)`", row):
            on_page.setdefault(test, set()).add(number)
    return on_page


def test_numbers_run_from_one_without_a_gap():
    assert [number for number, _ in ROWS] == [f"A{k + 1}" for k in range(len(ROWS))] and len(ROWS) > 30


@pytest.mark.parametrize(("number", "row"), ROWS, ids=[number for number, _ in ROWS])
def test_every_known_answer_says_what_agrees_how_well_and_by_which_test(number, row):
    case, answer, tolerance, tests = (cell.strip() for cell in row.split(" | "))
    assert case and answer and tolerance
    assert re.fullmatch(r"`test_\w+\.py::test_\w+`(, `test_\w+\.py::test_\w+`)*", tests)


def test_the_tests_on_the_page_are_those_that_cite_its_numbers():
    assert numbers_on_page() == cited_numbers()
