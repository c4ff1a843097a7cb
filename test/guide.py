"""What the tables of docs/guide say, for the tests that hold them against the code and a running robot."""

import re
from pathlib import Path

PAGES = {path.name: path.read_text(encoding="utf-8")
         for path in (Path(__file__).resolve().parents[1] / "docs" / "guide").glob("*.md")}


def names(cell: str) -> list[str]:
    """Everything in backticks."""
    return re.findall(r"`([^`]+)`", cell)


def table(*heads: str) -> list[list[str]]:
    """Cells of the rows below the one table of the guide with these heads."""
    head = f"| {' | '.join(heads)} |\n"
    pages = [text for text in PAGES.values() for _ in range(text.count(head))]
    assert len(pages) == 1, f"{len(pages)} tables in docs/guide begin with {head}"
    rows = pages[0].partition(head)[2].partition("\n\n")[0].splitlines()[1:]
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows if row.startswith("|")]


def first_column(*heads: str) -> list[str]:
    """Names in the first column of the one table with these heads."""
    return [name for row in table(*heads) for name in names(row[0])]


def diagnostics() -> dict[str, set[str]]:
    """Keys of each status of `/diagnostics`."""
    keys: dict[str, set[str]] = {}
    for status, cell, _ in table("status", "key", "value"):
        assert not keys.get(status, set()) & set(names(cell)), f"{cell}: is told twice"
        keys.setdefault(status, set()).update(names(cell))
    return keys


def custom_data() -> set[str]:
    """Keys of a bag's custom data, of a bag that is neither limited nor a replay."""
    return set(first_column("key of the custom data", "value"))
