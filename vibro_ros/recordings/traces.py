"""Lines of a recording that is longer than a picture is wide: no peak is lost, and a gap in the stream stays one."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from vibro_ros.recordings.summary import GAP

LEAST_BINS, MOST_BINS = 24, 240  # of a band over the whole run
TURNS = 3.0  # of the crank in a bin: the motion may repeat itself after several
POINTS = 2000  # blocks of a line of many samples; more than the picture has pixels across
LONGEST_MEAN = 2  # bins to both sides
TINT = 0.3  # of a band's colour in white; opaque, so that nothing mixes with what lies below

Span = tuple[float, float]


def line(axes: Axes, time: np.ndarray, values: np.ndarray, span: Span, **style: object) -> None:
    """The samples of `span` [s], broken at gaps in the stream; of many, those that a line can show."""
    shown = np.flatnonzero((time >= span[0]) & (time <= span[1]))
    drawn = [visible(piece, values) for piece in np.split(shown, gaps(time[shown]))]
    broken = [np.concatenate([column for piece in drawn for column in (of[piece], [np.nan])])[:-1]
              for of in (time, values)]
    axes.plot(*broken, **{"lw": 1.3} | style)


def visible(samples: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Of the indices `samples`, those that a line can show: of each of `POINTS` blocks its ends and its extremes."""
    size = len(samples) // POINTS
    if size < 8:
        return samples
    blocks = samples[:len(samples) // size * size].reshape(-1, size)
    rows = np.arange(len(blocks))
    extremes = [blocks[rows, pick(values[blocks], axis=1)] for pick in (np.argmin, np.argmax)]
    return np.unique(np.concatenate([blocks[:, 0], blocks[:, -1], *extremes, samples[blocks.size:]]))


def bins_for(duration: float, speed: float) -> int:
    """Number of bins for a recording of `duration` [s] of a crank that turns with up to `speed` [rad/s]."""
    return int(np.clip(duration * speed / math.tau / TURNS, LEAST_BINS, MOST_BINS))


def band(axes: Axes, time: np.ndarray, values: np.ndarray, edges: np.ndarray, colour: str, label: str) -> None:
    """The range that a quick oscillation fills: minimum and maximum between each two `edges` [s], with its outline."""
    middle, low, high = extremes(time, values, edges)
    axes.fill_between(middle, low, high, color=tinted(colour), lw=0, label=label, zorder=1.5)
    for edge in (low, high):
        axes.plot(middle, edge, color=colour, lw=0.7, zorder=1.6)


def outline(axes: Axes, time: np.ndarray, values: np.ndarray, edges: np.ndarray, colour: str, label: str) -> None:
    """The outline alone of such a range, where several would hide each other."""
    middle, low, high = extremes(time, values, edges)
    axes.plot(middle, high, color=colour, lw=1.4, label=label)
    axes.plot(middle, low, color=colour, lw=1.4, ls=(0, (1, 1)))


def extremes(time: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle [s], minimum and maximum of the samples in each bin, with NaN at gaps in the stream."""
    if not len(time):
        return (np.array([]),) * 3
    firsts, middle = _bins(time, edges)
    low, high = np.minimum.reduceat(values, firsts), np.maximum.reduceat(values, firsts)
    # a bin that ends in a gap would seem to reach over it
    broken = gaps(middle, 1.5)
    middle, low, high = (np.insert(column, broken, np.nan) for column in (middle, low, high))
    return middle, low, high


def share(time: np.ndarray, true: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle [s] of each bin, and the share of its samples that are `true`, with NaN at gaps in the stream."""
    firsts, middle = _bins(time, edges)
    part = np.add.reduceat(true.astype(float), firsts) / np.diff(firsts, append=len(time))
    broken = gaps(middle, 1.5)
    return np.insert(middle, broken, np.nan), np.insert(part, broken, np.nan)


def mean_over_turns(time: np.ndarray, values: np.ndarray, angle_time: np.ndarray,
                    angle: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of a quantity that swings with the crank, over whole turns around the middle of each bin; NaN at gaps.

    Means over bins that cut a turn anywhere would swing themselves. Where the crank hardly turns, the mean is over
    `LONGEST_MEAN` bins to both sides.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        Samples [s], [W].
    angle_time, angle : ndarray, shape (m,)
        Samples of the crank's angle [s], [rad].
    edges : ndarray, shape (k + 1,)
        Of the bins [s], equally spaced.

    Returns
    -------
    ndarray, ndarray, each of shape (k,)
        Middle of what each mean is over [s], and the means; the samples themselves where there are fewer than two.
    """
    if len(time) < 2:
        return time, values
    width, middle = edges[1] - edges[0], (edges[1:] + edges[:-1]) / 2
    on = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(angle), 0.0))])  # a reset turns the crank back
    turned = on / math.tau + 1e-9 * (angle_time - angle_time[0])  # rises where the crank stands
    at = np.interp(middle, angle_time, turned)
    turns = np.maximum(1.0, np.round(np.interp(middle + width, angle_time, turned) - at))
    begin, end = (np.interp(at + half * turns, turned, angle_time) for half in (-0.5, 0.5))
    begin = np.maximum(np.maximum(begin, middle - LONGEST_MEAN * width), time[0])
    end = np.minimum(np.minimum(end, middle + LONGEST_MEAN * width), time[-1])
    means = (_integral(time, values, end) - _integral(time, values, begin)) / (end - begin)
    for after in gaps(time):
        means[(begin < time[after]) & (end > time[after - 1])] = np.nan
    return (begin + end) / 2, means


def _integral(time: np.ndarray, values: np.ndarray, until: np.ndarray) -> np.ndarray:
    """Integral from the first sample to each of the instants `until`, of straight lines between samples."""
    pauses = np.diff(time)
    whole = np.concatenate([[0.0], np.cumsum(pauses * (values[1:] + values[:-1]) / 2)])
    at = np.clip(np.searchsorted(time, until, side="right") - 1, 0, len(time) - 2)
    since = until - time[at]
    return whole[at] + since * (values[at] + since * (values[at + 1] - values[at]) / pauses[at] / 2)


def gaps(time: np.ndarray, periods: float = GAP) -> np.ndarray:
    """Indices of the samples that follow a pause of more than so many periods."""
    pauses = np.diff(time)
    return np.flatnonzero(pauses > periods * np.median(pauses)) + 1 if len(pauses) else np.array([], dtype=int)


def tinted(colour: str) -> tuple[float, float, float]:
    """The colour of a band."""
    return tuple(1.0 - TINT * (1.0 - part) for part in to_rgb(colour))


def _bins(time: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index of the first sample in each bin that holds one, and the mean time [s] of its samples."""
    slots = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    firsts = np.flatnonzero(np.diff(slots, prepend=-1))
    return firsts, np.add.reduceat(time, firsts) / np.diff(firsts, append=len(time))
