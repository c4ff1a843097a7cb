"""A motion between recorded samples, where nobody can say what it really was.

Between two samples a quantity is a cubic if its rate was recorded, too, else a straight line. Nothing is drawn over a
gap in the recording, or over a reset.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from vibro_ros.view.pieces import polynomials_through
from vibro_ros.view.recorded import Track

GAP = 2.5
"""Periods; two samples that are farther apart have a gap between them."""
DEGREE = 3
NEAR = 3e-9
"""Instants [s] that are one: stamps are rounded to nanoseconds."""


def interpolated(tracks: Mapping[str, Track], names: Sequence[str], span: tuple[float, float],
                 resets: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Pieces between the samples in a span.

    Parameters
    ----------
    tracks : mapping of str to Track
        What was recorded.
    names : sequence of str
        Quantities wanted; what was not recorded of them is NaN.
    span : (float, float)
        Begin and end [s].
    resets : sequence of float
        Instants [s] of samples at which the robot stood at its start again.

    Returns
    -------
    ndarray, ndarray, shapes (p, 2) and (p, names, DEGREE + 1)
        Borders [s] and Chebyshev coefficients (SI).
    """
    times, longest = _grid(tracks)
    times = times[(times >= span[0] - NEAR) & (times <= span[1] + NEAR)]
    borders = np.column_stack([times[:-1], times[1:]])
    after = np.searchsorted(np.sort(np.array(resets)), borders + NEAR)
    borders = np.clip(borders[(np.diff(times) <= longest) & (after[:, 0] == after[:, 1])], *span)
    borders = borders[np.diff(borders)[:, 0] > NEAR]
    if not names:
        return borders, np.empty((len(borders), 0, DEGREE + 1))
    wanted = [tracks.get(name) for name in names]

    def values(instants: np.ndarray) -> np.ndarray:
        return np.stack([_at(track, instants) for track in wanted], axis=2)

    return borders, polynomials_through(borders, values, DEGREE + 1)


def lowered(crank: Track) -> list[float]:
    """Instants [s] at which the crank's angle is less than before: only a reset does that."""
    return crank.times[1:][np.diff(crank.values) < 0.0].tolist()


def _grid(tracks: Mapping[str, Track]) -> tuple[np.ndarray, float]:
    """Instants of the samples [s], those of the first track that has any, because what a robot publishes has one rate;
    and the longest pause [s] that is no gap."""
    times = next((track.times for track in tracks.values() if len(track.times) > 1), np.empty(0))
    return times, _longest(times)


def _longest(times: np.ndarray) -> float:
    """Longest pause [s] between neighbours that is no gap."""
    return GAP * float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def _at(track: Track | None, instants: np.ndarray) -> np.ndarray:
    """A quantity at some instants [s], of their shape; NaN beyond its samples and in its gaps."""
    if track is None or len(track.times) < 2:
        return np.full(instants.shape, np.nan)
    times, values, rates = track
    left = np.clip(np.searchsorted(times, instants, side="right") - 1, 0, len(times) - 2)
    pause = times[left + 1] - times[left]
    s = (instants - times[left]) / pause
    step = values[left + 1] - values[left]
    found = values[left] + s * step
    if rates is not None:  # Hermite's cubic: what the rates add to the straight line
        found += s * (1.0 - s) * ((1.0 - s) * (rates[left] * pause - step) - s * (rates[left + 1] * pause - step))
    known = (s >= 0.0) & (s <= 1.0) & (pause <= _longest(times))
    return np.where(known, found, np.nan)
