"""The design of a sweep: the points, the starts of each, and the measures, from a file and the command line.

Rows are numbered point by point, and within a point start by start. Points have the order of the product of the axes
and the samples: the sample changes fastest, then the last axis.
"""

import argparse
import difflib
import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vibro_lab.orbits.starts import SETTLING
from vibro_lab.study.command import settings_of
from vibro_lab.study.measures import checked_names, checked_times
from vibro_lab.study.variation import (
    Axis,
    Range,
    Sampling,
    parameter_names,
    sampling,
    sampling_in_words,
    varied,
    varied_in_words,
    whole_number,
)
from vibro_ros import PARAMETERS, Scene, Value, load_scene, parameter_named, read_yaml, scene_origin

#: Largest number of runs of a sweep.
MOST_RUNS = 100_000_000
#: Largest number of random starts of a point.
MOST_STARTS = 1_000_000
PART = 16
"""Largest number of starts in a part of a point: runs of the same machine, whose equations are set up once."""
KEPT_STATES = 32
"""States of a motion without a period that a row keeps."""
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
            raise ValueError("vary: nothing varies; give --vary NAME=LOW:HIGH:COUNT or NAME=A,B,C")
        if self.ranges and self.sampling is None:
            name = self.ranges[0].name
            raise ValueError(f"{name}: a range without a count needs --sample, such as sobol:64; or give a count")
        if self.sampling is not None and not self.ranges:
            raise ValueError("sample: no range to sample; give one without a count, as --vary NAME=LOW:HIGH")
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
        return tuple(name for one in self.varied for name in one.names)

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
        sampled, rest = self._samples, point
        values: dict[str, Value] = {}
        if self.sampling:
            rest, sample = divmod(point, self.sampling.count)
            values = {name: float(sampled[sample, k])
                      for k, varied_range in enumerate(self.ranges) for name in varied_range.names}
        for axis in reversed(self.axes):
            rest, index = divmod(rest, len(axis.values))
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
        """The design in the form of a sweep's file, with every parameter of the scene."""
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


#: Defaults of a sweep's file and command line; a scene and a varied parameter must be given.
DEFAULTS: Mapping[str, Any] = {"set": {}, "vary": {}, "sample": None, "measure": ["mean_speed"], "starts": 8,
                                  "settling": SETTLING, "duration": 10.0}
KEYS = ("scene", *DEFAULTS)


def read_sweep(path: Path) -> dict[str, Any]:
    """Read the checked entries of a sweep's file, for `design_of`; a relative path of its scene starts at the file."""
    document = read_yaml(path)
    try:
        if not isinstance(document, dict):
            raise ValueError(f"holds no mapping; give {', '.join(KEYS)}")
        for key in document:
            if key not in KEYS:
                near = difflib.get_close_matches(str(key), KEYS, n=1)
                raise ValueError(f"{key!r} is unknown; "
                                 f"{f'did you mean {near[0]}?' if near else 'give ' + ', '.join(KEYS)}")
        return {key: _checked_entry(key, value, path.parent) for key, value in document.items()}
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _checked_entry(key: str, value: object, folder: Path) -> Any:
    if key in ("set", "vary"):
        if not isinstance(value, dict):
            raise ValueError(f"{key}: {value!r} is no mapping; give parameters by name")
        check = varied if key == "vary" else (lambda name, given: parameter_named(name, PARAMETERS).checked(given))
        return {str(name): check(str(name), given) for name, given in value.items()}
    if key == "scene":
        if not isinstance(value, str):
            raise ValueError(f"scene: {value!r} is no text; give a shipped scene's name or a path")
        return scene_origin(value, folder)
    if key == "sample":
        if not isinstance(value, dict) or not {"method", "count"} <= set(value) <= {"method", "count", "seed"}:
            raise ValueError(f"sample: {value!r} says not how; give method and count, and perhaps seed")
        return sampling(value["method"], value["count"], value.get("seed", 0))
    if key == "measure":
        if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
            raise ValueError(f"measure: {value!r} is no list of names; write [mean_speed, mean_power]")
        return list(checked_names(value))
    if key == "starts":
        return whole_number("starts", value, 0, MOST_STARTS)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ValueError(f"{key}: {value!r} is not a number; give seconds")
    return float(value)


def given_in_words(options: argparse.Namespace) -> dict[str, Any]:
    """Return the entries that the command line gives, for `design_of`."""
    given = {key: getattr(options, key) for key in ("scene", "measure", "settling", "duration")}
    given["starts"] = None if options.starts is None else whole_number("--starts", options.starts, 0, MOST_STARTS)
    given["sample"] = sampling_in_words(options.sample) if options.sample else None
    chosen = {key: value for key, value in given.items() if value is not None}
    chosen["set"] = settings_of(options.set)
    chosen["vary"] = dict(varied_in_words(text, linked=True) for text in options.vary)
    if len(chosen["vary"]) < len(options.vary):
        raise ValueError("--vary: a parameter is given twice; keep one")
    return chosen


def design_of(file: Mapping[str, Any], words: Mapping[str, Any]) -> SweepDesign:
    """Make the design from a sweep's file, or nothing, and the command line (`read_sweep` and `given_in_words`).

    A parameter that the command line sets or varies overrides its entry in the file; linked ones, if all of them are.
    """
    entries = {**DEFAULTS, **file, **words}
    given = {name for key in ("set", "vary") for linked in words.get(key, {}) for name in parameter_names(linked)}
    for key in ("set", "vary"):
        on_command_line = words.get(key, {})
        entries[key] = {name: value for name, value in file.get(key, {}).items()
                     if name in on_command_line or not given.issuperset(parameter_names(name))} | on_command_line
    varied_names = {name for linked in entries["vary"] for name in parameter_names(linked)}
    for name in entries["set"]:
        if name in varied_names:
            raise ValueError(f"{name}: is set and varied; keep one")
    if "scene" not in entries:
        raise ValueError("scene: none given; give --scene NAME, or a sweep's file that names one")
    scene = load_scene(entries["scene"]).with_parameters(entries["set"])
    return SweepDesign(scene, tuple(entries["vary"].values()), entries["sample"],
                       tuple(checked_names(entries["measure"])), entries["starts"], entries["settling"],
                       entries["duration"])
