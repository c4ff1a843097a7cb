"""Pictures depend on nothing that a user has set for matplotlib, and are bounded."""

import os
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from known_recording import known_run  # noqa: F401
from PIL import Image

from vibro_ros.bag.reader import read_bag
from vibro_ros.process.pictures import MOST_PIXELS, default_settings, new_figure, png, set_heading
from vibro_ros.recordings.report import plot_run

PACKAGE = Path(__file__).resolve().parents[2] / "vibro_ros"
STYLE = """text.usetex: True
figure.dpi: 900
savefig.dpi: 900
savefig.bbox: tight
axes.facecolor: black
lines.linewidth: 9
font.size: 30
"""


def run(*words: str, folder: Path, **environment: str) -> str:
    """Run Python in a folder; returns what it printed."""
    ended = subprocess.run([sys.executable, *words], cwd=folder, env={**os.environ, **environment}, text=True,
                           capture_output=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def drawn(bag: Path, folder: Path, **environment: str) -> bytes:
    """Return the picture of a report that is made in this folder."""
    run("-m", "vibro_ros.recordings.report", str(bag), "--output", ".", folder=folder, **environment)
    return (folder / "report.png").read_bytes()


@pytest.fixture(scope="module")
def plain(known_run, tmp_path_factory):  # noqa: F811
    return drawn(known_run(), tmp_path_factory.mktemp("plain"))


@pytest.mark.process
@pytest.mark.parametrize(("settings", "environment"), [
    (STYLE.encode(), {}), (b"\xff\xfe is not UTF-8", {"MPLBACKEND": "module://matplotlib_inline.backend_inline"})],
    ids=["style", "refused"])
def test_settings_of_the_user_change_no_byte_of_a_picture(known_run, plain, tmp_path, settings,  # noqa: F811
                                                          environment):
    """Before all other files, matplotlib reads `matplotlibrc` of the working directory."""
    (tmp_path / "matplotlibrc").write_bytes(settings)
    assert drawn(known_run(), tmp_path, **environment) == plain


def test_one_module_imports_matplotlib():
    importers = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py")
                 if "import matplotlib" in (text := path.read_text(encoding="utf-8")) or "from matplotlib" in text}
    assert importers == {"process/pictures.py"}


def test_settings_of_the_program_come_back():
    with matplotlib.rc_context({"figure.dpi": 900.0}):
        with default_settings():
            assert matplotlib.rcParams["figure.dpi"] == matplotlib.rcParamsDefault["figure.dpi"]
        assert matplotlib.rcParams["figure.dpi"] == 900.0


@pytest.mark.parametrize("size", [(13.0, 13.0, 110.0), (13.0, 500.0, 110.0), (13.0, 13.0, 1e4), (2e3, 2.0, 300.0)])
def test_a_picture_is_bounded_in_pixels(size, tmp_path):
    (tmp_path / "picture.png").write_bytes(png(new_figure(*size, layout=None)))
    width, height = Image.open(tmp_path / "picture.png").size
    assert width * height <= MOST_PIXELS * 1.001  # each side is a whole number of pixels
    if size[:2] == (13.0, 13.0) and size[2] == 110.0:
        assert (width, height) == (1430, 1430)


def edges(figure) -> np.ndarray:
    """Return how far the heading reaches beyond each edge of the picture [px]; negative inside."""
    box = figure._suptitle.get_window_extent()
    return np.array([-box.x0, -box.y0, box.x1 - figure.bbox.width, box.y1 - figure.bbox.height])


@pytest.mark.parametrize("name", ["W" * 200, "a word " * 30, "$x$ of \\bad{ $y", "_" + "a-b-" * 60])
def test_a_heading_is_whole_and_above_everything_else(known_run, name):  # noqa: F811
    bag = read_bag(known_run(name=name))
    caption = "  ·  ".join(f"mean of quantity {number} 12.345 W" for number in range(6))
    figure = plot_run(bag, caption)
    png(figure)
    assert edges(figure).max() < 0.0
    shown = "".join(figure._suptitle.get_text().split())
    assert "".join(name.split()) in shown and "$" not in name or "$x$of" in shown
    highest = max(axes.get_tightbbox().y1 for axes in figure.axes)
    assert figure._suptitle.get_window_extent().y0 > highest


def test_a_heading_keeps_its_lines():
    heading = set_heading(new_figure(5.0, 3.0), "one\ntwo")
    assert heading.get_text() == "one\ntwo"
