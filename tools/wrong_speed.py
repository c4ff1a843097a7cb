"""A picture of what a fixed step does to the body's way: smooth curves, of which some lead the wrong way."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vibro_ros.accuracy.diagram import style
from vibro_ros.accuracy.figures import new_figure, tidy
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.starts import STARTING, started_at_share

_STARTS, _END, _PER_SECOND = 8, 10.0, 200.0


def draw_ways(scene: Scene, steps: Sequence[float]) -> Figure:
    """Draw where the body is from 1 s to 10 s, from several starts, by the method exact and by rk4 with each step [s].

    Raises
    ------
    SimulationError
        If rk4 cannot go on with one of the steps.
    """
    figure = new_figure(3.0 * (len(steps) + 1), 3.6)
    panels = figure.subplots(1, len(steps) + 1, sharey=True)
    for axes, step in zip(panels[:-1], steps, strict=True):
        _draw(axes, scene.with_parameters({"solver.method": "rk4", "solver.step": step}), f"rk4, step {step:g} s")
    _draw(panels[-1], scene, "exact")
    panels[0].set_ylabel("way of the body since 1 s [m]")
    figure.suptitle(f"{scene.name}: the same {_STARTS} starts", fontsize=11)
    return figure


def _draw(axes: Axes, scene: Scene, title: str) -> None:
    times = np.arange(round(STARTING * _PER_SECOND), round(_END * _PER_SECOND) + 1) / _PER_SECOND
    colour = style(scene["solver.method"])["color"]
    for k in range(_STARTS):
        way = started_at_share(scene, k / _STARTS, scene["motor.speed"]).sample(times).body_position
        axes.plot(times, way - way[0], color=colour, lw=1.0, alpha=0.7)
    axes.axhline(0.0, color="#777777", lw=0.8, ls=":")
    axes.set_title(title, fontsize=10, loc="left")
    axes.set_xlabel("time [s]")
    tidy(axes)
