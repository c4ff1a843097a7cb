"""Slow motion of a live robot: its last seconds, interpolated between the samples that it has published."""

from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.view.motion import Document, Impact, fitted_motion, impacts_as_json
from vibro_ros.view.protocol import COLUMNS, MOST_SECONDS, shown_quantities
from vibro_ros.view.recorded import RATES, Signal, interpolate, reset_instants

WHY = "a live robot is drawn between its samples; record it and open the recording (view BAG_FOLDER) for every instant"
STAMP = 1e-9  # resolution of stamps [s]: times closer to each other differ only by rounding
MOST_IMPACTS = 2000  # most impacts that are kept, some 100 turns of the crank
_TIME = COLUMNS.index("time")


class History:
    """Rows of `COLUMNS` in time order, and impacts; rows older than `MOST_SECONDS` are dropped."""

    def __init__(self):
        self._parts: deque[np.ndarray] = deque()
        self._impacts: deque[Impact] = deque(maxlen=MOST_IMPACTS)

    def clear(self) -> None:
        """Drop all rows and impacts."""
        self._parts.clear()
        self._impacts.clear()

    def add(self, rows: np.ndarray) -> None:
        """Add rows that are later than all previous ones; shape (n, len(COLUMNS)), n above 0."""
        self._parts.append(rows)
        while self._parts[0][-1, _TIME] < rows[-1, _TIME] - MOST_SECONDS:
            self._parts.popleft()

    def add_impacts(self, impacts: Iterable[Impact]) -> None:
        """Add impacts that were reported."""
        self._impacts += impacts

    def last(self) -> np.ndarray | None:
        """Return the latest row; None without any."""
        return self._parts[-1][-1] if self._parts else None

    def samples(self, seconds: float) -> dict[str, np.ndarray]:
        """Return every quantity over the last `seconds` [s]; empty arrays without any rows."""
        rows = np.concatenate([np.empty((0, len(COLUMNS))), *self._parts])
        if len(rows):
            rows = rows[rows[:, _TIME] > rows[-1, _TIME] - seconds - STAMP]
        return dict(zip(COLUMNS, np.ascontiguousarray(rows.T), strict=True))

    def motion(self, scene: Scene, seconds: float) -> Document:
        """Return the motion document of the last `seconds` [s] (ValueError if there are no two samples)."""
        samples = self.samples(seconds)
        if len(samples["time"]) < 2:
            raise ValueError("there are no samples of the last seconds; let the robot run")
        begin, end = samples["time"][[0, -1]]
        return motion_between(scene, samples, [impact for impact in self._impacts if begin <= impact.time <= end])


@np.errstate(over="ignore", invalid="ignore")  # peers may publish any number
def motion_between(scene: Scene, samples: Mapping[str, np.ndarray], impacts: Iterable[Impact] = ()) -> Document:
    """Return the motion document of a robot from the first of at least two samples to the last.

    `samples` are the finite columns of `COLUMNS`, ascending in ``time`` [s].
    """
    times, names = samples["time"], shown_quantities(scene)
    signals = {name: Signal(times, values, samples.get(RATES.get(name, "")))
               for name, values in samples.items() if name != "time"}
    resets = reset_instants(signals["crank_angle"])
    pieces = interpolate(signals, names, (float(times[0]), float(times[-1])), resets)
    return fitted_motion(names, [], [], [pieces]).writer.document({
        "exact": False, "why": WHY, "exact_spans": [], "impacts": impacts_as_json(list(impacts)), "resets": resets})
