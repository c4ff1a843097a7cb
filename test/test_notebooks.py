"""The tutorial's notebook prints the output that it shows, with the tutorial's numbers."""

import json
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_the_notebook_prints_what_it_shows_and_what_the_tutorial_says(monkeypatch, capsys):
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = json.loads((ROOT / "examples" / "notebooks" / "tutorial.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    names: dict[str, object] = {}
    for cell in cells:
        exec("".join(cell["source"]), names)
        assert capsys.readouterr().out == "".join("".join(output["text"]) for output in cell["outputs"])
    tutorial = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    for cell in cells[-2:]:  # the search for the best speed, and the start from standstill
        (output,) = cell["outputs"]
        assert "".join(output["text"]) in tutorial
