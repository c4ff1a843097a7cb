"""Each notebook prints the output that it shows; the tutorial's has the tutorial's numbers."""

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = {path.stem: json.loads(path.read_text(encoding="utf-8"))
             for path in (ROOT / "examples" / "notebooks").glob("*.ipynb")}


def code_cells(name: str) -> list[dict]:
    return [cell for cell in NOTEBOOKS[name]["cells"] if cell["cell_type"] == "code"]


def shown(cell: dict) -> str:
    """Return the text of a cell's outputs; pictures are not compared."""
    return "".join("".join(output.get("text", [])) for output in cell["outputs"])


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_prints_what_it_shows(name, monkeypatch, capsys):
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, object] = {}
    for cell in code_cells(name):
        exec("".join(cell["source"]), names)
        assert capsys.readouterr().out == shown(cell)


def test_the_last_cells_of_the_tutorials_notebook_are_the_tutorials():
    tutorial = (ROOT / "docs" / "guide" / "begin.md").read_text(encoding="utf-8")
    for cell in code_cells("tutorial")[-2:]:  # the search for the best speed, and the start from standstill
        assert shown(cell) and shown(cell) in tutorial
