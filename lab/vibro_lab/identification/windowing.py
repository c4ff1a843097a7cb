"""Where windows begin, and from which states: what the measurements themselves tell before any fit.

A state is read off the measurements by a local cubic of positions and speeds. That needs an instant between blows, so
windows begin where the measured speeds change most evenly. `arcs` are short windows, in which even parameters that are
wrong by half move no blow out of the window; `chain` is windows of some turns that cover the recording.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from vibro_lab.identification.recording import Channel, Recording

TURN = 2.0 * np.pi
#: Reach of local cubics before and after an instant [s]; the first is tried first.
REACHES = ((0.006, 0.006), (0.003, 0.003), (0.0, 0.010), (0.010, 0.0))
_CALM = 0.004  # s on both sides of a window's start without a blow, where possible
_NEAR, _FAR = 0.7, 1.3  # shares of a window's turns between which its end is chosen
#: A pause of the recording: so long [s], and so many times the spacing of the sensor that measures most often. Windows
#: go on across shorter ones, because the motion is still known behind them.
_PAUSE, _SPACINGS = 0.1, 10.0
_SHORTEST = 10  # instants of a stretch in which windows begin
_SAMPLES = 2.0  # before and after an instant, at least, for a local cubic
_FEWEST = 4  # samples for a cubic; where they are far apart a line through two is better than no state at all


def measured(recording: Recording) -> dict[str, Channel]:
    """Return the least noisy channel of each field."""
    return {channel.field: channel for channel in sorted(recording.channels, key=lambda channel: -channel.sigma)}


def positions_of(name: str) -> tuple[str, str]:
    """Return the fields of position and speed to which a number of a state belongs."""
    pairs = {"body_height": "body_vertical_velocity", "crank_angle": "motor_speed"}
    for position, speed in pairs.items():
        if name in (position, speed):
            return position, speed
    part = name.rsplit("_", 1)[0]
    return f"{part}_position", f"{part}_velocity"


def unmeasured(recording: Recording, names: Sequence[str]) -> list[str]:
    """Return the numbers of a state of which the recording has neither position nor speed."""
    known = measured(recording)
    return [name for name in names if positions_of(name)[0] not in known]


class Stretch(NamedTuple):
    """A part of the recording without pauses: evenly spaced instants [s], the crank's angle [rad] and the roughness
    there, shape (n,) each, and whether the crank rests at its beginning."""

    times: np.ndarray
    angle: np.ndarray
    rough: np.ndarray
    rests: bool


def measured_spans(recording: Recording) -> np.ndarray:
    """Return first and last measurement [s] of each part of the recording without pauses, shape (parts, 2). One whose
    stamp is late may be of before time 0, where no motion is known."""
    channels = recording.channels
    times = np.unique(np.concatenate([channel.times[channel.times >= 0.0] for channel in channels]))
    spacing = min(float(np.median(np.diff(channel.times))) for channel in channels)
    ends = np.flatnonzero(np.diff(times) > max(_PAUSE, _SPACINGS * spacing))
    firsts, lasts = np.append(0, ends + 1), np.append(ends, len(times) - 1)
    is_long = lasts - firsts + 1 >= _SHORTEST
    return np.column_stack([times[firsts], times[lasts]])[is_long if is_long.any() else slice(None)]


def longer_reach(recording: Recording, names: Sequence[str]) -> float:
    """Return how many times longer than `REACHES` a reach must be to have samples for a state; 1 where they are near,
    or where other numbers than these must tell the state."""
    if unmeasured(recording, names):
        return 1.0
    spacing = max(float(np.median(np.diff(channel.times))) for channel in measured(recording).values())
    return max(1.0, _SAMPLES * spacing / REACHES[0][0])


def local_states(recording: Recording, names: Sequence[str], starts: np.ndarray, reach: tuple[float, float],
                 otherwise: np.ndarray) -> np.ndarray:
    """Return the states at `starts` [s], shape (starts, states), from measurements within a reach [s] of each, which is
    longer where samples are far apart and tell all numbers.

    `otherwise` has the numbers that are not measured there, of the same shape.
    """
    known, states, longer = measured(recording), otherwise.copy(), longer_reach(recording, names)
    (reach_before, reach_after), fewest = (longer * part for part in reach), 2 if longer > 1.0 else _FEWEST
    for j, name in enumerate(names):
        position, speed = positions_of(name)
        for k, start in enumerate(starts.tolist()):
            rows, values = [], []
            for field, derivative in ((position, False), (speed, True)):
                if (channel := known.get(field)) is None:
                    continue
                first, end = np.searchsorted(channel.times, (start - reach_before, start + reach_after), side="right")
                away = channel.times[first:end] - start
                powers = np.stack([away**0, away, away**2, away**3], axis=1)
                if derivative:
                    powers = np.stack([0.0 * away, away**0, 2.0 * away, 3.0 * away**2], axis=1)
                rows.append(powers / channel.sigma)
                values.append(channel.values[first:end] / channel.sigma)
            if position in known and (count := sum(map(len, values))) >= fewest:
                scale = np.array([1.0, 1e3, 1e6, 1e9])[:count]  # of milliseconds, else the rank would be 1 or 2
                powers = np.concatenate(rows)[:, :count] * scale
                cubic = np.linalg.lstsq(powers, np.concatenate(values), rcond=1e-9)[0] * scale
                states[k, j] = cubic[0] if name == position else cubic[1]
    return states


def roughness(times: np.ndarray, speeds: Sequence[np.ndarray]) -> np.ndarray:
    """Return how unevenly speeds change around each of evenly spaced instants, by their second differences."""
    rough = sum(np.abs(np.diff(speed, 2, prepend=speed[:1], append=speed[-1:])) for speed in speeds)
    reach = max(1, round(_CALM * (len(times) - 1) / (times[-1] - times[0])))
    return sliding_window_view(np.pad(rough, reach, mode="edge"), 2 * reach + 1).max(axis=1)


def arcs(stretches: Sequence[Stretch], length: float, most: int) -> np.ndarray:
    """Return about so many spans of `length` [s] over the stretches, at most so many in each, which start where it is
    calm."""
    lasting = np.array([times[-1] - times[0] for times, *_ in stretches])
    shares = np.ceil(most * lasting / lasting.sum()).astype(int).tolist()
    return np.concatenate([_arcs(stretch.times, stretch.rough, length, share)
                           for stretch, share in zip(stretches, shares, strict=True)])


def _arcs(times: np.ndarray, rough: np.ndarray, length: float, most: int) -> np.ndarray:
    calm = times[(rough <= np.median(rough)) & (times > times[0] + _CALM) & (times < times[-1] - length)]
    spans: list[tuple[float, float]] = []
    for wanted in np.linspace(calm[0], calm[-1], most) if len(calm) else ():
        later = calm[np.searchsorted(calm, max(wanted, spans[-1][1] if spans else wanted)):]
        if len(later):
            spans.append((later[0], later[0] + length))
    return np.array(spans).reshape(-1, 2)


def chain(stretches: Sequence[Stretch], turns: float) -> np.ndarray:
    """Return spans of about so many turns of the crank, which cover the stretches and are joined within each.

    They start where it is calm; the first of a stretch starts at its first instant if the crank rests there. While the
    crank rests no other window starts, because masses may lie on stiff plates.
    """
    return np.concatenate([_chain(stretch, turns) for stretch in stretches])


def _chain(stretch: Stretch, turns: float) -> np.ndarray:
    times, angle, rough, rests = stretch
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(angle)))]) / (TURN * turns)
    calmest = 0 if rests else int(np.argmin(rough[:max(1, np.searchsorted(turned, 0.5))]))
    edges = [times[calmest]]
    while turned[-1] - turned[calmest] > _FAR:
        first, end = np.searchsorted(turned, (turned[calmest] + _NEAR, turned[calmest] + _FAR))
        calmest = int(first + np.argmin(rough[first:max(end, first + 1)]))
        edges.append(times[calmest])
    edges.append(np.nextafter(times[-1], np.inf))
    return np.column_stack([edges[:-1], edges[1:]])
