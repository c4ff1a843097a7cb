"""Figures of all studies: their common style, with a light grid and units on the axes, and fields of cells.

A study draws with `figures.new_figure`, colours and functions of this module; nothing else of matplotlib is imported.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibro_lab.study.variation import parameter_names
from vibro_ros import PARAMETERS, default_settings, new_figure, png, set_heading

# isort: split
# After `new_figure`, whose room imports matplotlib even if the user's settings would end the import.
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

__all__ = ["Axes", "Figure", "Line2D", "Patch", "default_settings", "draw_cells", "draw_classes", "new_figure",
           "of_parameter", "png", "set_heading", "style_axes", "with_unit"]

GRID, BLACK = "#e8e8e8", "#000000"
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, YELLOW = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#f0e442")
"""Okabe and Ito's colours, which colour-blind readers can distinguish."""
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, YELLOW, BLACK)
"""Colours of numbered motions; further ones share the last."""
LINES = ((BLUE, "o"), (VERMILION, "^"), (GREEN, "s"), (PURPLE, "v"), (BLACK, "D"), (ORANGE, "x"))
"""Colours of lines, and markers for readers who cannot distinguish them."""


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


def draw_cells(axes: Axes, across: np.ndarray, up: np.ndarray, cells: np.ndarray, label: str, colours: str = "viridis",
               limits: tuple[float | None, float | None] = (None, None)) -> None:
    """Draw a number in each cell, shape (up, across), as a colour, with a colour bar of this label; NaN is left out."""
    mesh = axes.pcolormesh(across, up, cells, shading="nearest", cmap=colours, vmin=limits[0], vmax=limits[1],
                           rasterized=True)
    axes.figure.colorbar(mesh, ax=axes, label=label, pad=0.01)


def draw_classes(axes: Axes, across: np.ndarray, up: np.ndarray, classes: np.ndarray, colours: Sequence[str]) -> Any:
    """Draw the class in each cell, shape (up, across), from 0, in its colour; returns the mesh for a colour bar."""
    return axes.pcolormesh(across, up, classes, shading="nearest", cmap=ListedColormap(colours), rasterized=True,
                           norm=BoundaryNorm(np.arange(-0.5, len(colours)), len(colours)))
