"""Common style of all studies' figures: white, without a window, with a light grid, and with units on the axes."""

import io

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vibro_lab.study.variation import parameter_names
from vibro_ros import PARAMETERS

GRID, BLACK = "#e8e8e8", "#000000"
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, YELLOW = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
"""Okabe and Ito's colours, which colour-blind readers can distinguish."""


def new_figure(width: float, height: float, dpi: int = 110) -> Figure:
    """Return an empty figure; width and height in inches."""
    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """Return the contents of a PNG file of the figure."""
    sink = io.BytesIO()
    figure.savefig(sink, format="png", metadata={"Software": None})
    return sink.getvalue()


def with_unit(name: str, unit: str) -> str:
    """Label of an axis with its unit; pure numbers have none."""
    return f"{name} [{unit}]" if unit not in ("", "1") else name


def of_parameter(name: str) -> str:
    """Label of an axis over a parameter, or over linked ones, which have the same unit."""
    return with_unit(name, PARAMETERS[parameter_names(name)[0]].unit)


def style_axes(axes: Axes) -> None:
    """Set the grid and hide the upper and right spines."""
    axes.grid(color=GRID, lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
