"""The `report` executable: summarises a recording in words, numbers and a picture.

The picture has the whole run, and beside it a close-up in which every oscillation can be seen. All samples are drawn,
so that no peak is lost however long the recording is; gaps in the stream stay gaps.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    from vibro_ros.process.entry_point import enter

    raise SystemExit(enter("report"))

import json
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from vibro_ros.bag.reader import Arrays, Bag
from vibro_ros.bag.stream import BagError, bag_errors
from vibro_ros.process.entry_point import Parser, exit_code
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.files import one_line, user_path
from vibro_ros.process.pictures import Axes, Figure, default_settings, new_figure, png, set_heading, to_rgb
from vibro_ros.recordings.energy import energy_of
from vibro_ros.recordings.summary import as_caption, as_text, impacts_of, load_samples, summarise
from vibro_ros.simulation.validity import GAP


def write_report(bag_folder: Path, output: Path | None = None) -> tuple[str, tuple[Path, ...]]:
    """Write summary.txt, summary.json and report.png about a recording.

    They go into the folder `output`, which is made if missing, by default ``<bag folder>_report`` beside the recording.
    Nothing is ever written into a recording. Returns the summary as text, and the files written. BagError when the
    recording cannot be read or `output` lies inside it; OSError when `output` cannot be written.
    """
    folder = user_path(bag_folder).resolve()
    output = user_path(output).resolve() if output else folder.with_name(f"{folder.name}_report")
    if output.is_relative_to(folder):
        raise BagError(f"{output}: lies inside the recording, which is never written to; give another --output")
    bag = load_samples(folder)
    summary = summarise(bag) | {"energy": energy_of(bag)}
    text, figure = as_text(summary), plot_run(bag, as_caption(summary))
    output.mkdir(parents=True, exist_ok=True)
    files = tuple(output / name for name in ("summary.txt", "summary.json", "report.png"))
    files[0].write_text(text, encoding="utf-8")
    files[1].write_text(f"{json.dumps(summary, indent=2, ensure_ascii=False)}\n", encoding="utf-8")
    files[2].write_bytes(png(figure))
    return text, files


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code, 2 when the recording cannot be reported on."""
    return exit_code("report", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    with bag_errors(options.bag):
        try:
            text, files = write_report(options.bag, options.output)
        except OSError as error:
            where = error.filename or options.output or f"{options.bag}_report"
            raise BagError(f"{where}: cannot write: {error.strerror or error}; give a writable --output") from error
    print(text)
    print("\n".join(map(one_line, files)))
    return 0


def _parser() -> Parser:
    parser = Parser(prog="report", description=f"{EXECUTABLES['report'].does} Distance, speed, impacts, power and gaps "
                    "in the stream are summed up.",
                    epilog="Exit code 0: written; 2: no readable recording, or nowhere to write; 129, 130, 143: "
                    "stopped by SIGHUP, SIGINT, SIGTERM.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of the recording")
    parser.add_argument("--output", type=Path, metavar="DIR", help="where to write (default: BAG_FOLDER_report)")
    return parser


CLOSE_UP = 0.3  # s, length of the close-up; about five crank turns at 100 rad/s
MOST_MARKS = 3000  # most impacts drawn as marks over the whole run; each of more impacts is a pixel
LEAST_IN_METRES = 10.0  # m, displacement from which the axis is in metres
LOGARITHMIC_FROM = 8.0
"""Peak force over the 95 % quantile from which the scale is logarithmic: a linear one would hide most forces."""
MM_PER_M = 1e3  # mm/m
MOST_MEANS = 240  # most means over whole turns of the crank
TINT = 0.3  # share of a colour in a pale one, which is opaque, so that it does not mix with what lies below

# Okabe and Ito's palette, which the colour-blind can distinguish
_BODY, _MOTOR, _POWER, _FORCE, _HEIGHT = "#000000", "#009e73", "#aa4499", "#7a5c00", "#56788f"
_GUIDE_COLOURS = {"upper": "#0072b2", "inclined": "#d55e00"}
_GUIDE_MARKS = {"upper": "v", "inclined": "^"}
_GRID, _FRAME, _TEXT, _CLOSE_UP, _AIR = "#e8e8e8", "#b0b0b0", "#404040", "#ececec", "#dcebf5"

_NONE = "N \N{LESS-THAN OR EQUAL TO} 0"

Span = tuple[float, float]
Panel = Callable[[Axes, Bag, Span], None]


@default_settings()
def plot_run(bag: Bag, caption: str = "") -> Figure:
    """Plot body, masses, impacts, ground, motor and power over time [s]; panels without data are left out.

    The whole run is on the left, `CLOSE_UP` seconds of it on the right; `caption` is a line under the title.
    """
    whole, close_up, panels = (0.0, max(bag.duration, 1e-3)), _close_up(bag), list(_panels(bag))
    height = 1.3 + 1.75 * len(panels)
    figure = new_figure(13.0, height, 120, layout=None)
    heading = set_heading(figure, f"{bag.path.name}\n{caption}", 10, color=_TEXT)
    # Margins [in] are given, because a layout engine would draw everything twice more to find them.
    height += heading.get_window_extent().height / figure.dpi
    figure.set_figheight(height)
    heading.set_y(1.0 - 0.2 / height)
    figure.subplots_adjust(left=0.07, right=0.985, bottom=0.55 / height,
                           top=(0.55 + 1.75 * len(panels)) / height, wspace=0.24, hspace=0.42)
    axes = figure.subplots(len(panels), 2, sharex="col", width_ratios=(3, 2), squeeze=False)
    for row, draw in zip(axes, panels, strict=True):
        for axis, span in zip(row, (whole, close_up), strict=True):
            draw(axis, bag, span)
            _style(axis, span)
        row[0].axvspan(*close_up, color=_CLOSE_UP, lw=0, zorder=0)
        for edge in close_up:
            row[0].axvline(edge, color=_TEXT, lw=0.6, ls=(0, (2, 2)), zorder=3)
    for axis in axes[-1]:
        axis.set_xlabel("time from start of recording [s]", color=_TEXT)
    for axis, title in zip(axes[0], ("the whole recording", f"the {np.ptp(close_up):.2g} s marked on the left"),
                           strict=True):
        axis.set_title(title, fontsize=10, color=_TEXT, loc="right")
    figure.align_ylabels(axes)
    return figure


def _panels(bag: Bag) -> Iterator[Panel]:
    """Yield the panels for which the recording has data, from top to bottom."""
    yield _draw_body
    if np.any(bag["odom"]["position"][:, 2]):
        yield _draw_height
    for guide in _GUIDE_COLOURS:
        if f"{guide}_mass.position" in bag["joint_states"]:
            yield partial(_draw_mass, guide)
    if len(_impacts(bag)["time"]):
        yield _draw_blows
    if "ground_contact" in bag and len(bag["ground_contact"]["time"]):
        yield _draw_ground
    yield _draw_motor
    if "motor_power" in bag and len(bag["motor_power"]["time"]):
        yield _draw_power


def _impacts(bag: Bag) -> Arrays:
    empty = np.array([])
    none = {"time": empty, "stamp": empty, "frame": np.array([], dtype=str), "force": empty.reshape(0, 3)}
    return bag["impacts"] if "impacts" in bag else none


def _close_up(bag: Bag) -> Span:
    """Return the span of the close-up: around the median of the impacts while the motor is fast."""
    joints, impacts = bag["joint_states"], _impacts(bag)["stamp"]
    speed = np.abs(joints["crank.velocity"])
    fast = impacts[np.interp(impacts, joints["time"], speed) >= 0.9 * speed.max()]
    centre = np.median(fast) if len(fast) else joints["time"][np.argmax(speed)]
    begin = float(np.clip(centre - CLOSE_UP / 2, 0.0, max(bag.duration - CLOSE_UP, 0.0)))
    return begin, begin + min(CLOSE_UP, max(bag.duration, 1e-3))


def _draw_body(axes: Axes, bag: Bag, span: Span) -> None:
    body = bag["odom"]
    x = body["position"][:, 0]
    unit, scale = ("mm", MM_PER_M) if np.ptp(x) < LEAST_IN_METRES else ("m", 1.0)
    line(axes, body["time"], (x - x[0]) * scale, span, color=_BODY)
    axes.set_ylabel(f"body displacement [{unit}]")


def _draw_height(axes: Axes, bag: Bag, span: Span) -> None:
    body = bag["odom"]
    _draw_oscillation(axes, body["time"], body["position"][:, 2] * MM_PER_M, span, _HEIGHT, "height")
    _shade_air(axes, bag, span)
    axes.set_ylabel("body height [mm]")


def _draw_mass(guide: str, axes: Axes, bag: Bag, span: Span) -> None:
    """Draw the position of one mass with its contacts, and its plate.

    At a contact the mass is at the plate; these points are added, because samples alone would miss part of its travel.
    """
    joints, impacts, colour = bag["joint_states"], _impacts(bag), _GUIDE_COLOURS[guide]
    contacts = contact_positions = np.array([])
    if f"{guide}_plate.position" in joints:
        plate = joints[f"{guide}_plate.position"]
        line(axes, joints["time"], plate * MM_PER_M, span, color=_BODY, lw=1.0, ls=(0, (4, 2)), label="its plate")
        if len(impacts["stamp"]):
            contacts = impacts["stamp"][impacts_of(bag, guide)]
            contact_positions = np.interp(contacts, joints["time"], plate)
    time = np.concatenate([joints["time"], contacts])
    order = np.argsort(time, kind="stable")
    position = np.concatenate([joints[f"{guide}_mass.position"], contact_positions])[order] * MM_PER_M
    _draw_oscillation(axes, time[order], position, span, colour, f"{guide} mass")
    if _is_close_up(span) and len(contacts):
        shown = (contacts >= span[0]) & (contacts <= span[1])
        axes.plot(contacts[shown], contact_positions[shown] * MM_PER_M, _GUIDE_MARKS[guide], color=colour, ms=7,
                  mec="white", mew=0.7, label="impact, at the plate", zorder=4)
    axes.margins(y=0.12)
    axes.set_ylabel(f"{guide} mass [mm]")


def _draw_blows(axes: Axes, bag: Bag, span: Span) -> None:
    impacts = _impacts(bag)
    shown = (impacts["stamp"] >= span[0]) & (impacts["stamp"] <= span[1])
    size, edge_width = (7, 0.7) if _is_close_up(span) else (3, 0.0)
    for guide, colour in _GUIDE_COLOURS.items():
        of_guide = shown & impacts_of(bag, guide)
        time, force = impacts["stamp"][of_guide], impacts["force"][of_guide, 2]
        if len(time):
            marked = len(time) <= MOST_MARKS  # more marks would hide those of the other guide
            axes.plot(time, force, _GUIDE_MARKS[guide] if marked else ",", color=colour, ms=size, mew=edge_width,
                      mec="white" if marked else colour, label=f"{guide} impacts", zorder=3)
    axes.set_ylim(0.0, 1.12 * max(1.0, impacts["force"][:, 2].max()))
    axes.set_ylabel("peak force [N]")


def _draw_ground(axes: Axes, bag: Bag, span: Span) -> None:
    time, force = bag["ground_contact"]["time"], bag["ground_contact"]["force"][:, 2]
    _draw_oscillation(axes, time, force, span, _FORCE, "N")
    usual = float(np.percentile(np.abs(force), 95))
    if usual > 0.0 and np.abs(force).max() > LOGARITHMIC_FROM * usual:  # logarithmic beyond the 95 % quantile
        axes.set_yscale("symlog", linthresh=usual)
        powers = 10.0 ** np.arange(np.ceil(np.log10(usual)), 1 + np.ceil(np.log10(np.abs(force).max())))
        axes.set_yticks([*-powers[::-1], 0.0, *powers])
        axes.minorticks_off()
    _shade_air(axes, bag, span)
    axes.set_ylabel("ground force N [N]")


def _shade_air(axes: Axes, bag: Bag, span: Span) -> None:
    """Shade the times at which the normal force is not above 0, if the span is short enough to see them."""
    if not _is_short(span) or "ground_contact" not in bag:
        return
    time, force = bag["ground_contact"]["time"], bag["ground_contact"]["force"][:, 2]
    shown = (time >= span[0]) & (time <= span[1])
    axes.fill_between(time[shown], 0.0, 1.0, where=force[shown] <= 0.0, transform=axes.get_xaxis_transform(),
                      color=_AIR, lw=0, zorder=0.5, label=f"the ground carries nothing, {_NONE}")


def _draw_motor(axes: Axes, bag: Bag, span: Span) -> None:
    joints = bag["joint_states"]
    line(axes, joints["time"], joints["crank.velocity"], span, color=_MOTOR, lw=2.0, label="motor")
    if "motor_speed" in bag and len(times := bag["motor_speed"]["time"]):
        values = np.where(np.isfinite(values := bag["motor_speed"]["value"]), values, np.nan)
        axes.step([*times, bag.duration], [*values, values[-1]], where="post", color=_BODY, ls=(0, (3, 3)), lw=1.0,
                  label="command")
    fastest = max(1.0, np.abs(joints["crank.velocity"]).max())
    asked = axes.dataLim.y1 if np.isfinite(axes.dataLim.y1) else fastest  # a refused command may be of any size
    axes.set_ylim(0.0, 1.08 * max(fastest, min(asked, 2.0 * fastest)))
    axes.set_ylabel("motor [rad/s]")


def _draw_power(axes: Axes, bag: Bag, span: Span) -> None:
    power, joints = bag["motor_power"], bag["joint_states"]
    _draw_oscillation(axes, power["time"], power["value"], span, _POWER, "power")
    if not _is_close_up(span):
        mean = mean_over_turns(power["time"], power["value"], joints["time"], joints["crank.position"])
        axes.plot(*mean, color=_BODY, lw=1.4, label="mean over whole turns", zorder=2)
    axes.axhline(0.0, color=_FRAME, lw=0.8, zorder=1)
    axes.set_ylabel("motor power [W]")


def _draw_oscillation(axes: Axes, time: np.ndarray, values: np.ndarray, span: Span, colour: str, label: str) -> None:
    """Draw a fast oscillation; over a long span its line fills the range of the oscillation, and is pale."""
    tinted = tuple(1.0 - TINT * (1.0 - part) for part in to_rgb(colour))
    style = {"marker": ".", "ms": 4} if _is_close_up(span) else {}
    line(axes, time, values, span, color=colour if _is_short(span) else tinted, label=label, zorder=1.5, **style)


def _is_short(span: Span) -> bool:
    return span[1] - span[0] <= 10 * CLOSE_UP


def _is_close_up(span: Span) -> bool:
    return span[1] - span[0] < 1.5 * CLOSE_UP


def _style(axes: Axes, span: Span) -> None:
    axes.set_xlim(*span)
    axes.grid(color=_GRID, lw=0.8)
    axes.set_axisbelow(True)
    if axes.get_yscale() == "linear":
        axes.ticklabel_format(useOffset=False)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(_FRAME)
    axes.tick_params(color=_FRAME, labelcolor=_TEXT)
    axes.yaxis.label.set_color(_TEXT)
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.0, 0.98), ncols=len(handles), frameon=False,
                    fontsize=8.5, labelcolor=_TEXT, borderaxespad=0.0, columnspacing=1.2, handletextpad=0.5)


def line(axes: Axes, time: np.ndarray, values: np.ndarray, span: Span, **style: object) -> None:
    """Draw the samples of `span` [s] as a line, broken at gaps; matplotlib leaves out points that cannot be seen."""
    shown = (time >= span[0]) & (time <= span[1])
    broken = gaps(time[shown])
    axes.plot(*(np.insert(column[shown].astype(float), broken, np.nan) for column in (time, values)),
              **{"lw": 1.3} | style)


def mean_over_turns(time: np.ndarray, values: np.ndarray, angle_time: np.ndarray,
                    angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return means over whole turns of the crank of a quantity that oscillates with it; NaN across gaps.

    Means over parts of a turn would oscillate themselves. `time` [s] and `values` are samples, `angle_time` and `angle`
    [rad] those of the crank. Returns the middle [s] of each interval of whole turns, and the means, at most
    `MOST_MEANS`.
    """
    turned = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(angle), 0.0))]) / math.tau  # without resets
    turns = np.arange(0.0, turned[-1] + 1e-9, max(1.0, np.ceil(turned[-1] / MOST_MEANS)))
    ends = np.unique(np.clip(np.interp(turns, turned, angle_time), time[0], time[-1]))
    by_trapezoids = np.cumsum(np.diff(time) * (values[1:] + values[:-1]) / 2.0)
    work = np.interp(ends, time, np.concatenate([[0.0], by_trapezoids]))
    means = np.diff(work) / np.diff(ends)
    for after in gaps(time):
        means[(ends[:-1] < time[after]) & (ends[1:] > time[after - 1])] = np.nan
    return (ends[1:] + ends[:-1]) / 2, means


def gaps(time: np.ndarray) -> np.ndarray:
    """Return the indices of the samples after a pause of more than `GAP` periods."""
    pauses = np.diff(time)
    return np.flatnonzero(pauses > GAP * np.median(pauses)) + 1 if len(pauses) else np.array([], dtype=int)
