"""Pictures that are the same whatever the user's matplotlib settings are: the only importer of matplotlib.

A function that draws has the decorator `default_settings()`, begins with `new_figure`, and ends with `png`, or returns
the figure, which its caller gives to `png`.
"""

import contextlib
import io
import math
import os
import sys
import textwrap
import warnings
from collections.abc import Iterator

try:
    import matplotlib
except Exception:  # settings that matplotlib refuses, such as MPLBACKEND of a notebook whose backend is missing here
    hidden = {name: os.environ.pop(name, None) for name in ("MPLBACKEND", "MATPLOTLIBRC")}
    os.environ["MATPLOTLIBRC"] = os.devnull
    for name in [name for name in sys.modules if name.startswith("matplotlib.")]:
        del sys.modules[name]  # else they would be missing as attributes of the new module
    try:
        with contextlib.chdir("/"):  # matplotlib reads a file `matplotlibrc` of the working directory first
            import matplotlib
    finally:
        del os.environ["MATPLOTLIBRC"]
        os.environ.update({name: value for name, value in hidden.items() if value is not None})

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text

__all__ = ["Axes", "Figure", "default_settings", "new_figure", "png", "set_heading", "to_rgb"]

MOST_PIXELS = 2**24
"""Most pixels of a picture, which takes 64 MiB of memory; a picture that would have more gets fewer dots per inch."""
LONGEST_SIDE = 2**15  # most pixels along a side of a picture; the renderer refuses 2**16
_EDGE = 0.1  # in, between a heading and the edges of its picture


@contextlib.contextmanager
def default_settings() -> Iterator[None]:
    """Use matplotlib's own default settings within this context; as a decorator, within a function.

    The user's settings come from matplotlibrc, style files and the program that calls. Matplotlib reads them when
    something is added to a figure, and again when it renders the figure. The backend stays, because no window opens.
    """
    defaults = {name: value for name, value in matplotlib.rcParamsDefault.items() if not name.startswith("backend")}
    with warnings.catch_warnings(), matplotlib.rc_context():
        warnings.simplefilter("ignore", matplotlib.MatplotlibDeprecationWarning)  # of settings that nobody has chosen
        matplotlib.rcParams.update(defaults)
        yield


def new_figure(width: float, height: float, dpi: float = 110.0, layout: str | None = "constrained") -> Figure:
    """Return an empty white figure without a window; width and height in inches."""
    figure = Figure(figsize=(width, height), dpi=dpi, layout=layout, facecolor="white")  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    return figure


def set_heading(figure: Figure, text: str, size: float = 11.0, **style: str) -> Text:
    """Set the title of a figure, broken into lines that are no wider than the figure, and return it.

    The text is shown as it is: a `$` begins no formula. `size` is that of the font [pt], `style` is for
    `Figure.suptitle`.
    """
    heading = figure.suptitle("", fontsize=size, parse_math=False, **style)
    widest = figure.bbox.width - 2.0 * _EDGE * figure.dpi

    def is_too_wide(line: str) -> bool:
        heading.set_text(line)
        return heading.get_window_extent().width > widest

    lines = []
    for line in text.splitlines():
        most = len(line)
        while any(map(is_too_wide, pieces := textwrap.wrap(line, most, break_on_hyphens=False))):
            most = math.ceil(0.95 * most) - 1
        lines += pieces
    heading.set_text("\n".join(lines))
    return heading


@default_settings()
def png(figure: Figure) -> bytes:
    """Return the contents of a PNG file of the figure, of at most `MOST_PIXELS`."""
    sink, (width, height) = io.BytesIO(), figure.get_size_inches()
    dpi = min(figure.dpi, math.sqrt(MOST_PIXELS / (width * height)), LONGEST_SIDE / max(width, height))
    figure.savefig(sink, format="png", dpi=dpi, metadata={"Software": None})
    return sink.getvalue()
