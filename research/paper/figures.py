"""The paper's Figs. 2(a), 2(b), 3(a) and 3(b), in its layout, under a reading."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from research.paper.readings import SERIES, UNITS, Point, Reading, exact_readings
from research.paper.tables import EQUATIONS_IN_WORDS
from vibro_ros.simulation.simulator import Simulator

#: Time that the figures show [s], and samples in it.
DURATION, SAMPLES = 1.0, 2001
#: Time of the masses' figure [s]: some turns of the crank.
MASSES_DURATION = 0.4
_TITLES = {"angle": "2(b)  body, by angle φ", "mass": "3(a)  body at φ = 80°, by mass m3",
           "crank": "3(b)  body at φ = 80°, m3 = 0.02 kg, by crank l"}
#: Angles of the paper's Fig. 2(b) [°]; the other series are drawn whole.
_DRAWN = SERIES | {"angle": (40.0, 50.0, 60.0, 70.0, 80.0, 90.0)}
#: The paper's first robot.
_FIRST = Point("angle", 50.0)


def file_name(reading: Reading) -> str:
    """Name of the picture of a reading."""
    return f"{reading.equations}_{reading.normal_force}_{reading.start}.png"


def draw_figures(folder: Path) -> Iterator[Path]:
    """Draw a picture into `folder` for every reading by `exact` whose start the paper might have had; yields each."""
    for reading in exact_readings():
        if reading.start != "phase":
            yield draw_reading(reading, folder)


def draw_reading(reading: Reading, folder: Path) -> Path:
    """Draw the four figures under a reading by `exact`; returns the file.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    OSError
        If the file cannot be written.
    """
    with mpl.rc_context({"font.size": 8, "savefig.dpi": 110, "lines.linewidth": 0.8}):
        figure = Figure(figsize=(9.0, 6.4), layout="constrained")
        (masses, angles), (heavier, longer) = figure.subplots(2, 2)
        _draw_masses(reading, masses)
        for series, axes in (("angle", angles), ("mass", heavier), ("crank", longer)):
            _draw_body(reading, series, axes)
        figure.suptitle(f"The paper's figures: {EQUATIONS_IN_WORDS[reading.equations].lower()}, normal force "
                        f"{reading.normal_force}, start {reading.start}")
        path = folder / file_name(reading)
        figure.savefig(path, metadata={"Software": None})
    return path


def _draw_masses(reading: Reading, axes: Axes) -> None:
    times = np.linspace(0.0, MASSES_DURATION, SAMPLES)
    run = Simulator(reading.scene(_FIRST)).sample(times)
    axes.plot(times, 1e3 * run.upper_position, label="upper mass, ζ2")
    axes.plot(times, 1e3 * run.inclined_position, label="inclined mass, ξ3")
    axes.set(title="2(a)  masses, φ = 50°", xlabel="time [s]", ylabel="displacement [mm]")
    axes.legend(loc="lower right")


def _draw_body(reading: Reading, series: str, axes: Axes) -> None:
    times = np.linspace(0.0, DURATION, SAMPLES)
    for value in _DRAWN[series]:
        run = Simulator(reading.scene(Point(series, value))).sample(times)
        unit = UNITS[series]
        axes.plot(times, run.body_position, label=f"{value:g}{'' if unit == '°' else ' '}{unit}")
    axes.set(title=_TITLES[series], xlabel="time [s]", ylabel="displacement [m]")
    axes.legend(loc="best", ncols=2)
