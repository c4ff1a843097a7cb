"""The drawing of docs/robot.md is to scale, names every part, and is the one that the code draws."""

import re
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import vibro_ros
from tools import drawing

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCENE = vibro_ros.load_scene("device").with_parameters({"upper.gap": 0.003, "guide.angle": 0.9})


def texts(figure: Figure) -> list[str]:
    """Return all texts of a picture except the empty texts of arrows."""
    return [text.get_text() for axes in figure.axes for text in axes.texts if text.get_text()]


def test_the_committed_drawing_is_the_one_that_the_code_makes(tmp_path):
    """matplotlib writes each text as a comment beside its outlines."""
    drawn = drawing.Drawing(vibro_ros.load_scene("device"))
    committed = (DOCS / "robot.svg").read_text(encoding="utf-8")
    assert sorted(re.findall(r"<!-- (.*) -->", committed)) == sorted(texts(drawn.figure)), "run `make picture`"
    drawn.write(tmp_path / "one.svg")
    lengths = [np.array(re.findall(r"-?\d+\.\d+", text), dtype=float) for text in (
        committed, (tmp_path / "one.svg").read_text(encoding="utf-8"))]
    np.testing.assert_allclose(*lengths, rtol=0, atol=1e-3, err_msg="run `make picture`")  # of a pixel
    drawing.Drawing(vibro_ros.load_scene("device")).write(tmp_path / "two.svg")
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()
    assert (DOCS / "robot.svg").stat().st_size < 2e5


def test_every_symbol_of_the_page_that_can_be_seen_is_in_the_drawing():
    page = (DOCS / "robot.md").read_text(encoding="utf-8")
    table = page.partition("## Names and signs")[2].partition("\n\nThe *gap*")[0]
    symbols = {symbol for cell in re.findall(r"^\| ([^|]+) \|", table, re.MULTILINE)[1:] for symbol in cell.split(", ")}
    written = " ".join(texts(drawing.Drawing(SCENE).figure)).replace("$", "").replace("_", "")
    seen = set(re.findall(r"[^\W\d]+\d?", written))
    assert len(symbols) > 20
    assert {symbol.replace("_", "") for symbol in symbols} - seen == {"μs", "vs", "α", "cv", "F0"}
