"""The tables of docs/guide, for tests that compare them with the code and with a running robot."""

import re
from pathlib import Path

PAGES = {path.name: path.read_text(encoding="utf-8")
         for path in (Path(__file__).resolve().parents[1] / "docs" / "guide").glob("*.md")}


def names(cell: str) -> list[str]:
    """Return everything in backticks."""
    return re.findall(r"`([^`]+)`", cell)


def table(*heads: str) -> list[list[str]]:
    """Return the cells of the rows of the only table of the guide with these column headings."""
    head = f"| {' | '.join(heads)} |\n"
    pages = [text for text in PAGES.values() for _ in range(text.count(head))]
    assert len(pages) == 1, f"{len(pages)} tables in docs/guide begin with {head}"
    rows = pages[0].partition(head)[2].partition("\n\n")[0].splitlines()[1:]
    return [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows if row.startswith("|")]


def first_column(*heads: str) -> list[str]:
    """Return the names in the first column of the only table with these column headings."""
    return [name for row in table(*heads) for name in names(row[0])]


def diagnostics() -> dict[str, set[str]]:
    """Return the keys of each status of `/diagnostics`."""
    keys: dict[str, set[str]] = {}
    for status, cell, _ in table("status", "key", "value"):
        assert not keys.get(status, set()) & set(names(cell)), f"{cell}: is told twice"
        keys.setdefault(status, set()).update(names(cell))
    return keys


def custom_data() -> set[str]:
    """Return the keys of the custom data of a bag that is neither limited in size nor made by a replay."""
    return set(first_column("key of the custom data", "value"))
