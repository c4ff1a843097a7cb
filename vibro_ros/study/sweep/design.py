"""A sweep's design: which points are run from which starts, and what is measured; the same for whoever reads it.

The rows of a sweep are numbered point by point, and within a point start by start. Points come in the order of the
product of the axes, of which the last one changes fastest, and beside it the samples. The rows are cut into blocks by
a rule that knows neither machine nor workers.
"""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.study.measures import checked_names
from vibro_ros.study.sweep.variation import Axis, Range, Sampling
from vibro_ros.study.window import checked_times

#: Most runs of a sweep.
MOST_RUNS = 100_000_000
#: Most drawn starts of a point.
MOST_STARTS = 1_000_000
# Robot time [s] of the runs of a block, a second or two of work, and most of its rows: what an interruption can lose.
_BLOCK_TIME, _BLOCK_ROWS = 4096.0, 1024


@dataclass(frozen=True)
class Design:
    """A sweep, checked.

    Attributes
    ----------
    scene : Scene
        What is varied.
    varied : tuple of Axis or Range
        The parameters that vary.
    sampling : Sampling or None
        How the ranges are sampled; None without a range.
    measures : tuple of str
        What is measured.
    starts : int
        Drawn starts of each point; 0 for one run from the scene's own start.
    settling, duration : float
        Time of a run that does not count, and time that does [s].

    Raises
    ------
    ValueError
        For what contradicts itself or is too much; one line that names the remedy.
    """

    scene: Scene
    varied: tuple[Axis | Range, ...]
    sampling: Sampling | None
    measures: tuple[str, ...]
    starts: int
    settling: float
    duration: float

    def __post_init__(self) -> None:
        checked_names(self.measures)
        checked_times(self.settling, self.duration, self.starts > 0)
        if not self.varied:
            raise ValueError("vary: nothing varies; give --vary NAME=LOW:HIGH:COUNT or NAME=A,B,C")
        if self.ranges and self.sampling is None:
            name = self.ranges[0].name
            raise ValueError(f"{name}: a range without a count needs --sample, such as sobol:64; or give a count")
        if self.sampling is not None and not self.ranges:
            raise ValueError("sample: no range to sample; give one without a count, as --vary NAME=LOW:HIGH")
        if self.rows > MOST_RUNS:
            raise ValueError(f"{self.points} points from {max(self.starts, 1)} starts each are more than {MOST_RUNS} "
                             "runs; give fewer")
        if self.scene["motor.speed"] == 0.0 and "motor.speed" not in self.names:
            raise ValueError(f"motor.speed: 0 in {self.scene.name}, where the motor stands until it is told to turn; "
                             "give --set motor.speed=100")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that vary."""
        return tuple(one.name for one in self.varied)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The parameters with lists of values."""
        return tuple(one for one in self.varied if isinstance(one, Axis))

    @property
    def ranges(self) -> tuple[Range, ...]:
        """The parameters that are sampled."""
        return tuple(one for one in self.varied if isinstance(one, Range))

    @property
    def points(self) -> int:
        """Combinations of parameters."""
        return math.prod(len(axis.values) for axis in self.axes) * (self.sampling.count if self.sampling else 1)

    @property
    def rows(self) -> int:
        """Runs."""
        return self.points * max(self.starts, 1)

    @property
    def block_rows(self) -> int:
        """Rows of a block; the last one may have fewer."""
        return max(1, min(_BLOCK_ROWS, int(_BLOCK_TIME / (self.settling + self.duration))))

    @property
    def blocks(self) -> int:
        """Blocks."""
        return -(-self.rows // self.block_rows)

    def rows_of_block(self, block: int) -> range:
        """Numbers of the rows of a block."""
        return range(block * self.block_rows, min((block + 1) * self.block_rows, self.rows))

    def point_of(self, row: int) -> int:
        """Number of a row's point."""
        return row // max(self.starts, 1)

    def start_of(self, row: int) -> int | None:
        """Number of a row's start; None for the scene's own."""
        return row % self.starts if self.starts else None

    def changes(self, point: int) -> dict[str, Value]:
        """Values of the varied parameters at a point."""
        sampled, rest = self._samples, point
        found: dict[str, Value] = {}
        if self.sampling:
            rest, sample = divmod(point, self.sampling.count)
            found = {one.name: float(sampled[sample, k]) for k, one in enumerate(self.ranges)}
        for axis in reversed(self.axes):
            rest, index = divmod(rest, len(axis.values))
            found[axis.name] = axis.values[index]
        return {name: found[name] for name in self.names}

    def scenes(self) -> Iterator[tuple[int, Scene | None, str]]:
        """Each point's number and scene; where such a scene is refused, None and why."""
        for point in range(self.points):
            try:
                yield point, self.scene.with_parameters(self.changes(point)), ""
            except ValueError as error:
                yield point, None, str(error)

    def document(self) -> dict[str, object]:
        """The design in the words of a sweep's file, with every parameter of the scene."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name not in self.names}
        sample = {"sample": vars(self.sampling)} if self.sampling else {}
        return {"scene": self.scene.name, "set": fixed, "vary": {one.name: one.document() for one in self.varied},
                **sample, "measure": list(self.measures), "starts": self.starts, "settling": self.settling,
                "duration": self.duration}

    @functools.cached_property
    def _samples(self) -> np.ndarray:
        """Values of the ranges, shape (count, ranges)."""
        if self.sampling is None:
            return np.zeros((1, 0))
        shares = self.sampling.shares(len(self.ranges))
        return np.column_stack([one.at(shares[:, k]) for k, one in enumerate(self.ranges)])
