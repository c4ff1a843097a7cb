"""Slow motion of a live robot: the last seconds simulated between the samples that it has published.

Motions are computed in a thread of their own, so that the page goes on meanwhile.
"""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from queue import Full, Queue

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.view.exact import ExactMotion, evenly_spaced, inexact_spans, spans, state_of
from vibro_ros.view.motion import Document, fitted_motion, impacts_as_json, quiet_device
from vibro_ros.view.protocol import COLUMNS, MOST_SECONDS, shown_quantities
from vibro_ros.view.recorded import RATES, Signal, interpolate

MOST_WAITING = 8
"""Most motions that wait to be computed: one for each page."""
STAMP = 1e-9
"""Resolution of stamps [s]: times closer to each other differ only by rounding."""
_TIME = COLUMNS.index("time")

Done = Callable[[Document | str], object]
"""Callback with the motion, or with the reason in words why there is none; called in the thread of the motions, or in
that of the caller for an immediate refusal."""


class SlowMotions:
    """Computes one motion after the other."""

    def __init__(self) -> None:
        self._line: Queue[tuple[Scene, Mapping[str, np.ndarray], Done]] = Queue(MOST_WAITING)
        threading.Thread(target=self._work, name="slow motion", daemon=True).start()

    def ask(self, scene: Scene, samples: Mapping[str, np.ndarray], done: Done) -> None:
        """Compute the motion between samples, and call `done` with the result."""
        if len(samples["time"]) < 2:
            done("there are no samples of the last seconds; let the robot run")
            return
        try:
            self._line.put_nowait((scene, samples, done))
        except Full:
            done(f"{MOST_WAITING} slow motions wait already; ask again later")

    def _work(self) -> None:
        while True:
            scene, samples, done = self._line.get()
            try:
                done(motion_between(scene, samples))
            except Exception as error:  # a page's request must not end the thread
                done(f"there is no slow motion of these samples: {type(error).__name__}: {error}")


class History:
    """Rows of `COLUMNS` in time order; rows older than `MOST_SECONDS` are dropped."""

    def __init__(self):
        self._parts: deque[np.ndarray] = deque()

    def clear(self) -> None:
        """Drop all rows."""
        self._parts.clear()

    def add(self, rows: np.ndarray) -> None:
        """Add rows that are later than all previous ones; shape (n, len(COLUMNS)), n above 0."""
        self._parts.append(rows)
        while self._parts[0][-1, _TIME] < rows[-1, _TIME] - MOST_SECONDS:
            self._parts.popleft()

    def last(self) -> np.ndarray | None:
        """Return the latest row; None without any."""
        return self._parts[-1][-1] if self._parts else None

    def samples(self, seconds: float) -> dict[str, np.ndarray]:
        """Return every quantity over the last `seconds` [s]; empty arrays without any rows."""
        rows = np.concatenate([np.empty((0, len(COLUMNS))), *self._parts])
        if len(rows):
            rows = rows[rows[:, _TIME] > rows[-1, _TIME] - seconds - STAMP]
        return dict(zip(COLUMNS, np.ascontiguousarray(rows.T), strict=True))


@np.errstate(over="ignore", invalid="ignore")  # peers may publish any number
def motion_between(scene: Scene, samples: Mapping[str, np.ndarray]) -> Document:
    """Return the motion document of a robot from the first sample to the last, computed from the samples alone.

    Its ``why`` has the first reason why not everything is exact. `scene` is the robot's scene with its present
    parameters; `samples` have fields of `Samples`: ``time`` [s], ascending, and the published quantities. A value that
    was not published is NaN, or its field is missing.
    """
    columns = {name: np.asarray(column, dtype=float) for name, column in samples.items()}
    columns = {name: column for name, column in columns.items() if name == "time" or np.isfinite(column).any()}
    stamps = columns.pop("time")
    order = np.flatnonzero(np.logical_and.reduce(  # only samples with the whole state
        [np.isfinite(column) for column in (stamps, *(columns[name] for name in UNITS if name in columns))]))
    order = order[np.unique(stamps[order], return_index=True)[1]]
    samples, names = {name: column[order] for name, column in columns.items()}, shown_quantities(scene)
    times = evenly_spaced(stamps[order])
    motion = ExactMotion(quiet_device(scene), samples, times)
    missing = [name for name in state_of(scene) if name not in samples]
    if not missing:
        motion.walk()
    signals = {name: Signal(times, values, samples.get(RATES.get(name, ""))) for name, values in samples.items()}
    rest = [interpolate(signals, names, span, motion.resets)
            for span in (inexact_spans(motion.intervals, float(times[0]), float(times[-1])) if len(times) else ())]
    made = fitted_motion(names, motion.intervals, motion.instants, rest)
    why = ""
    if len(made.exact) < len(motion.intervals) or any(len(borders) for borders, _ in rest):
        faults = [*(f"{name} is not published" for name in missing), *motion.faults,
                  "the motion changes too often to be drawn finely"]
        why = f"{faults[0]}; there the motion is interpolated between the samples"
    return made.writer.document({
        "exact": not why, "why": why, "exact_spans": spans(made.exact), "impacts": impacts_as_json(motion.impacts),
        "resets": motion.resets})
