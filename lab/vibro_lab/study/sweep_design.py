"""The design of a sweep: the points, the starts of each, and the measures.

Rows are numbered point by point, and within a point start by start. Points have the order of the product of the axes
and the samples: the sample changes fastest, then the last axis.
"""

import argparse
import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vibro_lab.orbits.turn_map import whole_number
from vibro_lab.study.command import machine_of, settings_of
from vibro_lab.study.measures import checked_names, checked_times
from vibro_lab.study.variation import Axis, Range, Sampling, sampling_in_words, varied_in_words
from vibro_ros import Scene, Value

#: Largest number of runs of a sweep.
MOST_RUNS = 100_000_000
#: Largest number of random starts of a point.
MOST_STARTS = 1_000_000
PART = 16
"""Largest number of starts in a part of a point: runs of the same machine, whose equations are set up once."""
NO_SCENE = "no such scene: "
"""Prefix of a row's error if the scene refuses the point's values."""


@dataclass(frozen=True)
class SweepDesign:
    """A checked design of a sweep."""

    scene: Scene  # scene with the values of all other parameters
    varied: tuple[Axis | Range, ...]  # the varied parameters
    sampling: Sampling | None  # sampling of the ranges; None without a range
    measures: tuple[str, ...]  # names of the measures
    starts: int  # number of random starts of each point; 0 for one run from the scene's own start
    settling: float  # settling time and measuring time of a run [s]
    duration: float

    def __post_init__(self) -> None:
        checked_names(self.measures)
        checked_times(self.settling, self.duration, self.starts > 0)
        if not self.varied:
            raise ValueError("--vary: nothing varies; give NAME=LOW:HIGH:COUNT or NAME=A,B,C")
        if self.ranges and self.sampling is None:
            name = self.ranges[0].name
            raise ValueError(f"{name}: a range without a count needs --sample, such as sobol:64; or give a count")
        if self.sampling is not None and not self.ranges:
            raise ValueError("--sample: no range to sample; give one without a count, as --vary NAME=LOW:HIGH")
        for name in self.names:
            if self.names.count(name) > 1:
                raise ValueError(f"{name}: is varied twice; keep one")
        if self.rows > MOST_RUNS:
            raise ValueError(f"{self.points} points from {max(self.starts, 1)} starts each are more than {MOST_RUNS} "
                             "runs; give fewer")
        name = self.scene.motor_command.replace("_", ".")
        if self.scene[name] == 0.0 and name not in self.names:
            raise ValueError(f"{name}: 0 in {self.scene.name}, where the motor stands until a command; "
                             f"give --set {name}={'15' if name == 'motor.voltage' else '100'}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the varied parameters, each of linked ones by itself."""
        return tuple(name for parameter in self.varied for name in parameter.names)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The parameters with lists of values."""
        return tuple(axis for axis in self.varied if isinstance(axis, Axis))

    @property
    def ranges(self) -> tuple[Range, ...]:
        """The parameters that are sampled."""
        return tuple(varied for varied in self.varied if isinstance(varied, Range))

    @property
    def points(self) -> int:
        """Number of combinations of parameter values."""
        return math.prod(len(axis.values) for axis in self.axes) * (self.sampling.count if self.sampling else 1)

    @property
    def rows(self) -> int:
        """Number of runs, each of which has a row."""
        return self.points * max(self.starts, 1)

    @property
    def parts(self) -> int:
        """Number of parts of a point, each of which has at most `PART` starts."""
        return max(1, -(-self.starts // PART))

    def runs(self, number: int) -> tuple[int, tuple[int | None, ...]]:
        """Point and numbers of the starts of part `number`, counted over all points; None for the scene's own start."""
        point, part = divmod(number, self.parts)
        return point, tuple(range(part * PART, min((part + 1) * PART, self.starts))) or (None,)

    def changes(self, point: int) -> dict[str, Value]:
        """Values of the varied parameters at a point."""
        sampled, remainder = self._samples, point
        values: dict[str, Value] = {}
        if self.sampling:
            remainder, sample = divmod(point, self.sampling.count)
            values = {name: float(sampled[sample, k])
                      for k, varied_range in enumerate(self.ranges) for name in varied_range.names}
        for axis in reversed(self.axes):
            remainder, index = divmod(remainder, len(axis.values))
            values |= dict.fromkeys(axis.names, axis.values[index])
        return {name: values[name] for name in self.names}

    def scenes(self) -> Iterator[tuple[int, Scene | None, str]]:
        """Yield number, scene and an empty text for each point; for values that are refused, None and the reason."""
        for point in range(self.points):
            try:
                yield point, self.scene.with_parameters(self.changes(point)), ""
            except ValueError as error:
                yield point, None, str(error)

    def document(self) -> dict[str, object]:
        """Everything that determines the rows, for JSON."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name not in self.names}
        sample = {"sample": vars(self.sampling)} if self.sampling else {}
        vary = {parameter.name: parameter.document() for parameter in self.varied}
        return {"scene": self.scene.name, "set": fixed, "vary": vary, **sample, "measure": list(self.measures),
                "starts": self.starts, "settling": self.settling, "duration": self.duration}

    @functools.cached_property
    def _samples(self) -> np.ndarray:
        """Values of the ranges, shape (count, ranges)."""
        if self.sampling is None:
            return np.zeros((1, 0))
        shares = self.sampling.shares(len(self.ranges))
        return np.column_stack([sampled.at(shares[:, k]) for k, sampled in enumerate(self.ranges)])


def design_of(options: argparse.Namespace) -> SweepDesign:
    """Make the design from the options of the command line (ValueError)."""
    varied = tuple(varied_in_words(text, linked=True) for text in options.vary)
    settings = settings_of(options.set)
    for name in (name for parameter in varied for name in parameter.names):
        if name in settings:
            raise ValueError(f"{name}: is set and varied; keep one")
    return SweepDesign(machine_of(options), varied, sampling_in_words(options.sample) if options.sample else None,
                       checked_names(options.measure), whole_number("--starts", options.starts, 0, MOST_STARTS),
                       options.settling, options.duration)
