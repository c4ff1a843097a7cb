"""The exact motion between the samples that a live robot publishes, from these samples alone."""

from collections.abc import Iterator, Mapping

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.view.assembly import Assembly, Span, spans
from vibro_ros.view.contacts import as_json
from vibro_ros.view.following import Following, regular, state_of
from vibro_ros.view.interpolation import interpolated
from vibro_ros.view.machine import shown
from vibro_ros.view.motion import Document
from vibro_ros.view.recorded import RATES, Track
from vibro_ros.view.stretch import Stretch, quiet_device


class Between:
    """Makes motions of the samples of one robot.

    Parameters
    ----------
    scene : Scene
        What the robot simulates, as its parameters are now.
    """

    def __init__(self, scene: Scene):
        self._device = quiet_device(scene)
        self._names = shown(scene)

    def motion(self, samples: Mapping[str, np.ndarray]) -> Document:
        """The motion from the first of some samples to the last.

        Parameters
        ----------
        samples : mapping of str to ndarray, each of shape (n,)
            Fields of `Samples`: ``time`` [s], ascending, and what was published of the others, with NaN or without the
            field where something was not.

        Returns
        -------
        header, payload : dict, bytes
            The document, see `motion`. ``why`` names the first reason why not all is exact.
        """
        samples = _finite(samples)
        times = regular(samples["time"])
        found = Following(self._device, samples, times)
        missing = [name for name in state_of(self._device.scene) if name not in samples]
        if not missing:
            found.follow()
        tracks = _tracks(samples, times)
        rest = [interpolated(tracks, self._names, span, found.resets) for span in _not_exact(found.stretches, times)]
        made = Assembly(self._names, found.stretches, found.instants, rest)
        made.write()
        exact = len(made.exact) == len(found.stretches) and not any(len(borders) for borders, _ in rest)
        return made.writer.document({
            "exact": exact, "why": "" if exact else _why(missing, found.fault), "exact_spans": spans(made.exact),
            "impacts": as_json(found.impacts), "resets": found.resets})


def _finite(samples: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The samples by ascending time, without fields that nobody published; of the state, no instant is left open."""
    times = np.asarray(samples["time"], dtype=float)
    columns = {name: np.asarray(column, dtype=float) for name, column in samples.items()}
    columns = {name: column for name, column in columns.items() if np.isfinite(column).any()}
    whole = np.isfinite(times)
    for name in UNITS:
        whole &= np.isfinite(columns.get(name, times))
    order = np.flatnonzero(whole)
    order = order[np.unique(times[order], return_index=True)[1]]
    return {**{"time": times[order]}, **{name: column[order] for name, column in columns.items() if name != "time"}}


def _tracks(samples: Mapping[str, np.ndarray], times: np.ndarray) -> dict[str, Track]:
    return {name: Track(times, values, samples.get(RATES.get(name, ""))) for name, values in samples.items()
            if name != "time"}


def _not_exact(stretches: list[Stretch], times: np.ndarray) -> Iterator[Span]:
    """Begin and end [s] of what no stretch covers."""
    if len(times):
        begins, ends = zip(*spans(stretches), strict=True) if stretches else ((), ())
        yield from zip((float(times[0]), *ends), (*begins, float(times[-1])), strict=True)


def _why(missing: list[str], fault: str) -> str:
    first = f"{missing[0]} is not published" if missing else fault or "the motion changes too often to be drawn finely"
    return f"{first}; there the motion is interpolated between the samples"
