"""The pictures of a search: how it went, the front of speed and cost of transport, and what the optimum depends on."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vibro_ros.study.optimise.front import FrontRobot
from vibro_ros.study.optimise.plan import Plan
from vibro_ros.study.optimise.result import Result
from vibro_ros.study.optimise.search import Candidates
from vibro_ros.study.optimise.sensitivity import Neighbourhood
from vibro_ros.study.optimise.verification import OPTIMUM, PERTURBATION, Verified

# Speed [m/s] below which a robot stands still for all that can be seen.
_SLOWEST = 1e-4
_COST = "cost of transport P / (M g V) [-]"
# Okabe and Ito's colours, which the colour-blind can tell apart
_ALL, _BEST, _OTHER, _THIRD, _GRID = "#56b4e9", "#000000", "#d55e00", "#009e73", "#e8e8e8"


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), dpi=110, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.grid(color=_GRID)
    axes.set_axisbelow(True)
    return figure, axes


def draw_convergence(plan: Plan, candidates: Candidates, title: str) -> Figure:
    """Score of every candidate in turn, and the best so far."""
    figure, axes = _figure(8.0, 4.5)
    scores = np.array([plan.score(values) for values in candidates.values])
    scores, turns = np.where(scores > 0.0, scores, np.nan), np.arange(1, len(scores) + 1)
    axes.plot(turns, scores, ".", ms=2.0, color=_ALL, label="a robot", rasterized=True)
    axes.plot(turns, np.fmax.accumulate(scores), color=_BEST, label="best so far")
    axes.set(xlabel="robots tried", ylabel=f"score [{plan.unit}]", title=title)
    axes.legend(frameon=False)
    return figure


def draw_front(result: Result, candidates: Candidates, title: str) -> Figure:
    """Cost of transport over speed: all candidates, the front from fresh starts, and the robots that were verified."""
    figure, axes = _figure(8.0, 5.5)
    plan = result.plan
    every = np.array([plan.speed_and_cost(point, values)
                      for point, values in zip(candidates.points, candidates.values, strict=True)])
    every = every[np.isfinite(every[:, 1]) & (every[:, 0] > _SLOWEST)]
    axes.plot(1e3 * every[:, 0], every[:, 1], ".", ms=2.0, color=_ALL, label="a robot of the search", rasterized=True)
    _draw_front_line(axes, result.front)
    for row, mark in zip(result.verified, "*sD", strict=False):
        if row.cost > 0.0:
            axes.errorbar(1e3 * row.speed.mean, row.cost, xerr=1e3 * row.speed.spread, fmt=mark, ms=8.0,
                          color=_OTHER if row.robot == OPTIMUM else _THIRD, label=row.robot)
    axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel=_COST, title=title)
    axes.legend(frameon=False)
    return figure


def draw_fronts(fronts: Mapping[str, Sequence[FrontRobot]], whole: Sequence[FrontRobot],
                rows: Sequence[Verified]) -> Figure:
    """The fronts that several searches found, the front of them all, and the robots of the paper.

    Parameters
    ----------
    fronts : mapping
        The front of each search by its name.
    whole : sequence of FrontRobot
        The front of them all.
    rows : sequence of Verified
        The robots of the paper, in the same scene.
    """
    figure, axes = _figure(8.0, 5.5)
    for name, front in fronts.items():
        axes.plot([1e3 * one.speed for one in front], [one.cost for one in front], "o", ms=4.0, label=name)
    _draw_front_line(axes, whole)
    for row, mark in zip(rows, "sD", strict=True):
        axes.plot(1e3 * row.speed.mean, row.cost, mark, ms=8.0, color=_THIRD, label=row.robot)
    axes.set(xscale="log", yscale="log", xlabel="mean speed [mm/s]", ylabel=_COST)
    axes.legend(frameon=False, fontsize=8)
    return figure


def _draw_front_line(axes: Axes, front: Sequence[FrontRobot]) -> None:
    axes.plot([1e3 * one.speed for one in front], [one.cost for one in front], "-o", ms=3.0, color=_BEST,
              label="front, from fresh starts")


def draw_sensitivity(around: Neighbourhood, title: str) -> Figure:
    """Sobol's indices of every parameter, the largest on top."""
    rows = sorted(around.sensitivities, key=lambda one: one.total)
    figure, axes = _figure(8.0, 1.5 + 0.3 * len(rows))
    places = np.arange(len(rows))
    axes.barh(places + 0.2, [one.total for one in rows], 0.4, xerr=[one.total_spread for one in rows], color=_OTHER,
              label="total")
    axes.barh(places - 0.2, [one.first for one in rows], 0.4, xerr=[one.first_spread for one in rows], color=_ALL,
              label="first order")
    axes.set_yticks(places, [one.name for one in rows])
    axes.set(xlabel=f"Sobol index within {100 * PERTURBATION:g} % of the optimum, 95 % intervals", title=title)
    axes.legend(frameon=False, loc="lower right")
    return figure
