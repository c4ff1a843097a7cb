"""The page of an identification: one HTML file with its pictures, which asks no other host for anything."""

import base64
import math
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from scipy.stats import chi2

from vibro_lab.identification.identify import Identification
from vibro_lab.identification.inference import LEVEL, REJECTED
from vibro_lab.identification.recording import Channel
from vibro_lab.study.figures import (
    BLACK,
    BLUE,
    VERMILION,
    Axes,
    Figure,
    default_settings,
    new_figure,
    png,
    style_axes,
    with_unit,
)
from vibro_ros import PARAMETERS

_UNITS = {"position": "m", "height": "m", "velocity": "m/s", "angle": "rad", "speed": "rad/s", "current": "A"}
_SPECIFIC_FORCE = "specific force", "m/s²"
_STRETCH = 1.5  # windows on either side of the middle of the one that fits worst
_SHADE = "#d55e0022"
_STYLE = """
body { margin: 0 auto; max-width: 1400px; padding: 12px; overflow-wrap: anywhere; font: 14px/1.4 sans-serif; }
p, ul { max-width: 50em; } figcaption { font-weight: 600; }
.pictures { display: grid; gap: 10px; grid-template-columns: repeat(auto-fit, minmax(min(100%, 520px), 1fr)); }
.small { grid-template-columns: repeat(auto-fill, minmax(min(100%, 260px), 1fr)); }
figure { margin: 0; } figure img { width: 100%; max-width: 720px; }
th, td { text-align: left; padding: 2px 12px 2px 0; }
"""


def identification_page(result: Identification, bag: str) -> str:
    """Return the page as HTML; `bag` is the name of the recording."""
    quantile = float(chi2.ppf(LEVEL, 1))
    parts = [
        f"<h1>{escape(result.verdict[0].upper() + result.verdict[1:])}</h1>",
        f"<p>The recording {escape(bag)}, {result.recording.duration:.4g} s, fitted by {result.passes} "
        "simulations.</p>",
        "<h2>The robot that was found</h2>", _table(
            ("parameter", "value", "95 % interval"),
            ((name, with_unit(f"{value:.6g}", PARAMETERS[name].unit),
              "{:.6g} to {:.6g}".format(*result.intervals[name]))
             for name, value in result.values.items())),
        "<h2>The sensors</h2>", _list(result.of_sensors()) if result.of_sensors() else "<p>They are as stated.</p>",
        "<h2>What the recording does not tell</h2>",
        _list(result.rank) if result.rank else "<p>It tells all free parameters apart.</p>",
        "<h2>Recording and twin</h2>",
        "<p>Above the whole recording, in the middle the time in which the twin fits worst, below what is left, in "
        "standard deviations of the noise. Windows that are left out are shaded.</p>",
        _pictures((_caption(result, channel), _overlay(result, channel)) for channel in result.recording.channels),
        "<h2>Mean square of the residuals by window</h2>", _pictures([("1 if model and noise are right",
                                                                       _by_window(result))]),
        "<h2>Profiles of the likelihood</h2>",
        f"<p>Growth of twice the negative logarithm of the likelihood, the other parameters fitted again. Dots: "
        f"computed; line: by the covariance; dashed: the 95 % interval, at which it has grown by {quantile:.3g}.</p>",
        _pictures(((name, _profile(result, name, quantile)) for name in result.values), "pictures small")]
    if result.alternatives:
        parts += [f"<h2>Other effects</h2><p>The same recording with one effect more; a p below {REJECTED:g} is "
                  "evidence for it.</p>", _table(("effect", "better by", "p"), (
                      (alternative.effect, f"{alternative.gain:.1f}", f"{alternative.p_value:.2g}")
                      for alternative in result.alternatives))]
    parts += ["<h2>What was read</h2>", _list(result.said)]
    # The policy: whatever the recording's names contain, the page loads nothing and runs nothing.
    return ('<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n'
            '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
            'style-src \'unsafe-inline\'">\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{escape(bag)}: the robot that was found</title>\n<style>{_STYLE}</style>\n"
            + "\n".join(parts) + "\n</html>\n")


def _list(sentences: Iterable[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(sentence)}</li>' for sentence in sentences)}</ul>"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    top = "".join(f'<th scope="col">{escape(heading)}</th>' for heading in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def _pictures(captioned: Iterable[tuple[str, Figure]], kind: str = "pictures") -> str:
    parts = [f'<figure><figcaption>{escape(caption)}</figcaption><img alt="{escape(caption)}" '
             f'src="data:image/png;base64,{base64.b64encode(png(figure)).decode()}"></figure>'
             for caption, figure in captioned]
    return f'<div class="{kind}">{"".join(parts)}</div>'


def _name(channel: Channel) -> str:
    return f"{channel.sensor}.{channel.field}"


def _caption(result: Identification, channel: Channel) -> str:
    return (f"{channel.sensor}: {channel.field.replace('_', ' ')}; mean square of the sensor's residuals "
            f"{result.chi_square[channel.sensor]:.3f}")


@default_settings()
def _overlay(result: Identification, channel: Channel) -> Figure:
    """Draw a channel as measured and as simulated, where it fits worst once more, and the residuals."""
    figure, windows = new_figure(6.4, 5.6), result.windows
    whole, part, below = figure.subplots(3, 1)
    residuals, simulated = result.residuals[_name(channel)], result.simulated[_name(channel)]
    worst = windows[np.argmax(windows["mean_square"])]
    middle, half = 0.5 * (worst["start"] + worst["end"]), _STRETCH * (worst["end"] - worst["start"])
    for axes, low, high in ((whole, 0.0, result.recording.duration), (part, middle - half, middle + half)):
        measured, twin = (times_values[(times_values[:, 0] >= low) & (times_values[:, 0] <= high)] for times_values in (
            np.column_stack([channel.times, channel.values]), simulated))
        axes.plot(*measured.T, ".", color=BLACK, ms=3.0, label="recording")
        axes.plot(*twin.T, color=BLUE, lw=1.0, label="twin")
        if len(outliers := result.outliers.get(_name(channel), np.empty((0, 2)))):
            axes.plot(*outliers.T, "x", color=VERMILION, ms=4.0, label="outlier")
        quantity = channel.field.rpartition("_")[2]
        axes.set_ylabel(with_unit(*((quantity, _UNITS[quantity]) if quantity in _UNITS else _SPECIFIC_FORCE)))
        axes.set_xlim(max(low, 0.0), min(high, result.recording.duration))
    part.legend(loc="upper right", fontsize="small")
    below.plot(*residuals.T, ".", color=BLUE, ms=2.0)
    below.set(xlabel="time [s]", ylabel="residual [σ]", xlim=whole.get_xlim())
    for axes in (whole, part, below):
        style_axes(axes)
        _shade(axes, result)
    return figure


def _shade(axes: Axes, result: Identification) -> None:
    """Shade the windows that are left out, as far as the axes reach."""
    low, high = axes.get_xlim()
    for window in result.windows[~result.windows["used"]]:
        if low < window["end"] and window["start"] < high:
            axes.axvspan(max(window["start"], low), min(window["end"], high), color=_SHADE, lw=0.0)


@default_settings()
def _by_window(result: Identification) -> Figure:
    figure, windows = new_figure(6.4, 2.6), result.windows
    axes = figure.subplots()
    for used, colour, label in ((True, BLUE, "counts"), (False, VERMILION, "left out")):
        some = windows[windows["used"] == used]
        if len(some):
            axes.bar(some["start"], some["mean_square"], some["end"] - some["start"], align="edge", color=colour,
                     edgecolor="white", hatch="" if used else "//", label=label)
    axes.axhline(1.0, color=BLACK, lw=0.8)
    if windows["mean_square"].max() > 10.0:
        axes.set_yscale("log")
    axes.set(xlabel="time [s]", ylabel="mean square")
    axes.legend(loc="lower right", fontsize="small")
    style_axes(axes)
    return figure


@default_settings()
def _profile(result: Identification, name: str, quantile: float) -> Figure:
    figure, best, ends = new_figure(3.2, 2.4), result.values[name], np.array(result.intervals[name])
    axes, points = figure.subplots(), result.profiles[name]
    number = list(result.values).index(name)
    deviation = math.sqrt(max(result.covariance[number, number], 0.0))
    shifts = np.linspace(min(points[:, 0].min(), ends[0]), max(points[:, 0].max(), ends[1]), 101) - best
    if deviation > 0.0:
        axes.plot(shifts, (shifts / deviation)**2, color=BLUE, lw=1.0)
    axes.plot(points[:, 0] - best, points[:, 1], "o", color=BLACK, ms=4.0)
    axes.axhline(quantile, color=BLACK, lw=0.8, ls=":")
    for end in ends - best:
        axes.axvline(end, color=VERMILION, lw=1.0, ls="--")
    axes.set(xlabel=with_unit(f"value − {best:.6g}", PARAMETERS[name].unit), ylabel="growth",
             ylim=(-0.05 * quantile, 2.5 * quantile))
    axes.locator_params(axis="x", nbins=4)
    axes.ticklabel_format(axis="x", scilimits=(-2, 3))
    style_axes(axes)
    return figure
