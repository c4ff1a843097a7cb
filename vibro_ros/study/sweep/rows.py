"""The runs of a sweep: pieces of a few rows, each simulated by whoever gets it, with the same numbers everywhere."""

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.measures import measure
from vibro_ros.study.running.pieces import PIECE, Piece
from vibro_ros.study.sweep.design import Design

#: How the error of a row begins whose point is no legal scene.
NO_SCENE = "no such scene: "


@dataclass(frozen=True)
class Rows:
    """What came of a piece.

    Attributes
    ----------
    values : ndarray, shape (rows, measures)
        The measures, in their units; NaN where the run could not go on.
    errors, warnings : tuple of (str or None)
        Why a row has no values; what is to be known about its values.
    """

    values: np.ndarray
    errors: tuple[str | None, ...]
    warnings: tuple[str | None, ...]

    def __len__(self) -> int:
        return len(self.errors)


@dataclass(frozen=True)
class Work:
    """What is done with every piece; a callable, which other processes get as it is.

    Attributes
    ----------
    scene : Scene
        What is varied.
    measures : tuple of str
        What is measured.
    settling, duration : float
        Times [s], as `measure` takes them.
    """

    scene: Scene
    measures: tuple[str, ...]
    settling: float
    duration: float
    study = "sweep"

    @property
    def run_time(self) -> float:
        """Robot time of a run [s]."""
        return self.settling + self.duration

    def __call__(self, piece: Piece) -> Rows:
        """Run a piece."""
        try:
            scene = self.scene.with_parameters(piece.changes)
        except ValueError as error:
            return self._refused(piece, str(error))
        fault = scene.broken_promise or None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ToleranceWarning)  # it stands in the row
            runs = [self._run(scene, start) for start in piece.starts]
        return Rows(np.array([values for values, _ in runs]), tuple(error for _, error in runs),
                    (fault,) * len(runs))

    def _run(self, scene: Scene, start: int | None) -> tuple[list[float], str | None]:
        try:
            return list(measure(scene, self.measures, self.settling, self.duration, start).values()), None
        except SimulationError as error:
            return [math.nan] * len(self.measures), str(error)

    def _refused(self, piece: Piece, reason: str) -> Rows:
        count = len(piece.starts)
        return Rows(np.full((count, len(self.measures)), math.nan), (f"{NO_SCENE}{reason}",) * count,
                    (None,) * count)


def work_of(design: Design) -> Work:
    """What is done with every piece of a design."""
    return Work(design.scene, design.measures, design.settling, design.duration)


def pieces(design: Design, block: int) -> Iterator[Piece]:
    """The pieces of a block, in the order of its rows."""
    rows = design.rows_of_block(block)
    first = rows.start
    while first < rows.stop:
        point = design.point_of(first)
        end = min(rows.stop, first + PIECE, (point + 1) * max(design.starts, 1))
        yield Piece(design.changes(point), tuple(map(design.start_of, range(first, end))))
        first = end
