"""The picture of a recording: the whole run, and beside it a moment in which every swing can be seen."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from vibro_ros.bag.reader import Arrays, Bag
from vibro_ros.study.summary import GAP, impacts_of

MOMENT = 0.3  # s, the close-up; about five crank turns at 100 rad/s
BINS = 120  # of a band over the whole run; in 10 s each holds a whole swing
POINTS = 2000  # blocks of a line of many samples; more than the picture has pixels across
MM = 1e3  # mm/m

_BODY, _MOTOR, _POWER, _COMMAND = "#222222", "#2b8a5b", "#8b3fa0", "#222222"
_GUIDE_COLOURS = {"upper": "#1f6fb4", "inclined": "#d1671b"}
_PLATE_DASHES = {"upper": (0, (4, 4)), "inclined": (4, (4, 4))}  # plates at one height stay both visible
_GRID, _FRAME, _TEXT, _HIGHLIGHT = "#e8e8e8", "#b0b0b0", "#404040", "#f3d36b"

Span = tuple[float, float]


def plot_run(bag: Bag, caption: str = "") -> Figure:
    """Body displacement, masses, motor speed and power over time.

    Parameters
    ----------
    bag : Bag
        A recording with odometry, joint states, impacts and motor power.
    caption : str
        One line under the title.

    Returns
    -------
    Figure
        Four rows that share time [s]; left the whole run, right `MOMENT` seconds of it.
    """
    whole, moment = (0.0, max(bag.duration, 1e-3)), _moment(bag)
    figure = Figure(figsize=(15.0, 10.5), dpi=120, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(4, 2, sharex="col", width_ratios=(3, 2))
    for row, draw in enumerate((_draw_body, _draw_masses, _draw_motor, _draw_power)):
        for axis, span in zip(axes[row], (whole, moment), strict=True):
            draw(axis, bag, span)
            _tidy(axis, span)
        axes[row, 0].axvspan(*moment, color=_HIGHLIGHT, alpha=0.6, lw=0, zorder=0)
        _legend_above(axes[row, 0])
    for axis in axes[-1]:
        axis.set_xlabel("time from start of recording [s]", color=_TEXT)
    _legend_above(axes[1, 1], "impact")
    axes[0, 1].set_title(f"the {moment[1] - moment[0]:.2g} s marked on the left", fontsize=10, color=_TEXT, loc="left")
    figure.suptitle("\n".join(filter(None, (bag.path.name, caption))), fontsize=12, color=_TEXT)
    figure.align_ylabels(axes)
    return figure


def _moment(bag: Bag) -> Span:
    """A window in mid-run: around the median of the impacts while the motor is fast."""
    joints, impacts = bag["joint_states"], bag["impacts"]["stamp"]
    speed = np.abs(joints["crank.velocity"])
    fast = impacts[np.interp(impacts, joints["time"], speed) >= 0.9 * speed.max()]
    centre = np.median(fast) if len(fast) else joints["time"][np.argmax(speed)]
    begin = float(np.clip(centre - MOMENT / 2, 0.0, max(bag.duration - MOMENT, 0.0)))
    return begin, begin + min(MOMENT, max(bag.duration, 1e-3))


def _draw_body(axes: Axes, bag: Bag, span: Span) -> None:
    body = bag["odom"]
    x = body["position"][:, 0]
    _line(axes, body["time"], (x - x[0]) * MM, span, color=_BODY)
    axes.set_ylabel("body displacement [mm]")


def _draw_masses(axes: Axes, bag: Bag, span: Span) -> None:
    joints = bag["joint_states"]
    for guide, colour in _guides_with(joints, "mass"):
        _swings(axes, joints["time"], joints[f"{guide}_mass.position"] * MM, span, colour, f"{guide} mass")
    for guide, colour in _guides_with(joints, "plate"):
        _line(axes, joints["time"], joints[f"{guide}_plate.position"] * MM, span,
              color=colour, ls=_PLATE_DASHES[guide], label=f"{guide} plate")
        if _is_moment(span):  # over a whole run they would be one smear
            _mark_impacts(axes, bag, guide, span)
    axes.margins(y=0.1)
    axes.set_ylabel("position on guide [mm]")


def _guides_with(joints: Arrays, part: str) -> list[tuple[str, str]]:
    """Guide and colour of each guide whose mass or plate the recording has."""
    return [item for item in _GUIDE_COLOURS.items() if f"{item[0]}_{part}.position" in joints]


def _mark_impacts(axes: Axes, bag: Bag, guide: str, span: Span) -> None:
    """Triangles on the plate at the instants of contact."""
    joints, times = bag["joint_states"], bag["impacts"]["stamp"][impacts_of(bag, guide)]
    times = times[(times >= span[0]) & (times <= span[1])]
    plate = np.interp(times, joints["time"], joints[f"{guide}_plate.position"]) * MM
    axes.plot(times, plate, "v", color=_GUIDE_COLOURS[guide], ms=8, mec="white", mew=0.8,
              label=f"{guide} impact", zorder=4)


def _draw_motor(axes: Axes, bag: Bag, span: Span) -> None:
    joints = bag["joint_states"]
    _line(axes, joints["time"], joints["crank.velocity"], span, color=_MOTOR, lw=2.0, label="motor")
    if "motor_speed" in bag and len(times := bag["motor_speed"]["time"]):
        values = bag["motor_speed"]["value"]
        axes.step([*times, bag.duration], [*values, values[-1]], where="post", color=_COMMAND,
                  ls=(0, (3, 3)), lw=1.0, label="command")
    axes.set_ylabel("motor speed [rad/s]")


def _draw_power(axes: Axes, bag: Bag, span: Span) -> None:
    power = bag["motor_power"]
    _swings(axes, power["time"], power["value"], span, _POWER, "power")
    axes.axhline(0.0, color=_FRAME, lw=0.8, zorder=1)
    axes.set_ylabel("motor power [W]")


def _line(axes: Axes, time: np.ndarray, values: np.ndarray, span: Span, **style: object) -> None:
    """The samples of `span`, broken at gaps in the stream."""
    shown = np.flatnonzero((time >= span[0]) & (time <= span[1]))
    drawn = [_visible(piece, values) for piece in np.split(shown, _gaps(time[shown]))]
    broken = [np.concatenate([column for piece in drawn for column in (of[piece], [np.nan])])[:-1]
              for of in (time, values)]
    axes.plot(*broken, **{"lw": 1.3} | style)


def _visible(samples: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Of the indices `samples`, those that a line can show: of each of `POINTS` blocks its ends and its extremes."""
    size = len(samples) // POINTS
    if size < 8:
        return samples
    blocks = samples[:len(samples) // size * size].reshape(-1, size)
    rows = np.arange(len(blocks))
    extremes = [blocks[rows, pick(values[blocks], axis=1)] for pick in (np.argmin, np.argmax)]
    return np.unique(np.concatenate([blocks[:, 0], blocks[:, -1], *extremes, samples[blocks.size:]]))


def _swings(axes: Axes, time: np.ndarray, values: np.ndarray, span: Span, colour: str, label: str) -> None:
    """A quick oscillation: over a moment its samples, over a long run the band it fills and its mean."""
    if span[1] - span[0] <= 10 * MOMENT:
        dots = {"marker": ".", "ms": 4} if _is_moment(span) else {}
        _line(axes, time, values, span, color=colour, label=label, **dots)
        return
    middle, mean, low, high = _band(time, values, span)
    axes.fill_between(middle, low, high, color=colour, alpha=0.22, lw=0)
    axes.plot(middle, mean, color=colour, lw=1.6, label=f"{label} (mean, range)")


def _band(time: np.ndarray, values: np.ndarray, span: Span) -> tuple[np.ndarray, ...]:
    """Mean time, mean, minimum and maximum of each bin, with NaN at gaps in the stream."""
    slots = np.minimum((time - span[0]) / (span[1] - span[0]) * BINS, BINS - 1).astype(int)
    firsts = np.flatnonzero(np.diff(slots, prepend=-1))
    counts = np.diff(firsts, append=len(time))
    columns = (np.add.reduceat(time, firsts) / counts, np.add.reduceat(values, firsts) / counts,
               np.minimum.reduceat(values, firsts), np.maximum.reduceat(values, firsts))
    full = counts > 0.5 * np.median(counts)  # the few samples at the edge of a gap have no mean worth showing
    gaps = _gaps(columns[0][full], 1.5)
    return tuple(np.insert(column[full], gaps, np.nan) for column in columns)


def _gaps(time: np.ndarray, periods: float = GAP) -> np.ndarray:
    """Indices of the samples that follow a pause of more than so many periods."""
    pauses = np.diff(time)
    return np.flatnonzero(pauses > periods * np.median(pauses)) + 1 if len(pauses) else np.array([], dtype=int)


def _is_moment(span: Span) -> bool:
    return span[1] - span[0] < 1.5 * MOMENT


def _legend_above(axes: Axes, only: str = "") -> None:
    handles, labels = axes.get_legend_handles_labels()
    chosen = [(handle, label) for handle, label in zip(handles, labels, strict=True) if only in label]
    if chosen:
        axes.legend(*zip(*chosen, strict=True), loc="lower left", bbox_to_anchor=(0.0, 0.97), ncols=len(chosen),
                    frameon=False, fontsize=9, labelcolor=_TEXT, borderaxespad=0.0, columnspacing=1.4)


def _tidy(axes: Axes, span: Span) -> None:
    axes.set_xlim(*span)
    axes.grid(color=_GRID, lw=0.8)
    axes.set_axisbelow(True)
    axes.ticklabel_format(useOffset=False)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(_FRAME)
    axes.tick_params(color=_FRAME, labelcolor=_TEXT)
    axes.yaxis.label.set_color(_TEXT)
