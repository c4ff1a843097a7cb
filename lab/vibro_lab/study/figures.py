"""Common style of all studies' figures: white, without a window, with a light grid, and with units on the axes."""

from vibro_lab.study.variation import parameter_names
from vibro_ros import PARAMETERS, default_settings, new_figure, png, set_heading

# isort: split
# After `new_figure`, whose room imports matplotlib even if the user's settings would end the import.
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

__all__ = ["BLACK", "BLUE", "GREEN", "GRID", "ORANGE", "PURPLE", "SKY", "VERMILION", "YELLOW", "Axes", "BoundaryNorm",
           "Figure", "Line2D", "ListedColormap", "Patch", "default_settings", "new_figure", "of_parameter", "png",
           "set_heading", "style_axes", "with_unit"]

GRID, BLACK = "#e8e8e8", "#000000"
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, YELLOW = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
"""Okabe and Ito's colours, which colour-blind readers can distinguish."""


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
