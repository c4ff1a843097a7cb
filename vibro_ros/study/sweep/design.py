"""A sweep's design: which points are run from which starts, and what is measured; the same for whoever reads it.

The rows of a sweep are numbered point by point, and within a point start by start. Points come in the order of the
product of the axes, of which the last one changes fastest, and beside it the samples.
"""

import argparse
import difflib
import functools
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa

from vibro_ros.configuration.scene_file import load_scene, scene_origin
from vibro_ros.configuration.strict_yaml import read_yaml
from vibro_ros.model.parameters import BY_NAME, Value, parameter_named
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.starts import SETTLING
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.command import settings_of
from vibro_ros.study.measures import MEASURES, checked_names, checked_times, measure_with_motion
from vibro_ros.study.table import NUMBERS, Field, Study, are
from vibro_ros.study.variation import (
    Axis,
    Range,
    Sampling,
    sampling,
    sampling_in_words,
    varied,
    varied_in_words,
    whole_number,
)

#: Most runs of a sweep.
MOST_RUNS = 100_000_000
#: Most drawn starts of a point.
MOST_STARTS = 1_000_000
KEPT_STATES = 32
"""States that a row keeps of a motion without a period."""
PART = 16
"""Most starts of a part of a point: runs of the same machine, whose equations are compiled once."""
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
        name = self.scene.motor_command.replace("_", ".")
        if self.scene[name] == 0.0 and name not in self.names:
            raise ValueError(f"{name}: 0 in {self.scene.name}, where the motor stands until a command; "
                             f"give --set {name}={'15' if name == 'motor.voltage' else '100'}")

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
    def parts(self) -> int:
        """Parts that the starts of a point are cut into, of which each has at most `PART` runs of one machine."""
        return max(1, -(-self.starts // PART))

    def runs(self, number: int) -> tuple[int, tuple[int | None, ...]]:
        """Point, and numbers of the starts, of the part of a number; None for the scene's own start."""
        point, part = divmod(number, self.parts)
        return point, tuple(range(part * PART, min((part + 1) * PART, self.starts))) or (None,)

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


#: What a sweep is when neither file nor command line say otherwise; a scene and something that varies must be given.
DEFAULTS: Mapping[str, Any] = {"set": {}, "vary": {}, "sample": None, "measure": ["mean_speed"], "starts": 8,
                                  "settling": SETTLING, "duration": 10.0}
KEYS = ("scene", *DEFAULTS)


def read_sweep(path: Path) -> dict[str, Any]:
    """What the file at `path` says, checked key by key, for `design_of`; a relative path of its scene starts there.

    Raises
    ------
    ValueError
        Naming the file, the key, the value and the remedy.
    """
    document = read_yaml(path)
    try:
        if not isinstance(document, dict):
            raise ValueError(f"holds no mapping; give {', '.join(KEYS)}")
        for key in document:
            if key not in KEYS:
                near = difflib.get_close_matches(str(key), KEYS, n=1)
                raise ValueError(f"{key!r} is unknown; "
                                 f"{f'did you mean {near[0]}?' if near else 'give ' + ', '.join(KEYS)}")
        return {key: _checked(key, value, path.parent) for key, value in document.items()}
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _checked(key: str, value: object, folder: Path) -> Any:
    if key in ("set", "vary"):
        if not isinstance(value, dict):
            raise ValueError(f"{key}: {value!r} is no mapping; give parameters by name")
        check = varied if key == "vary" else (lambda name, given: parameter_named(name, BY_NAME).checked(given))
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
    """What the command line says, for `design_of`."""
    given = {key: getattr(options, key) for key in ("scene", "measure", "settling", "duration")}
    given["starts"] = None if options.starts is None else whole_number("--starts", options.starts, 0, MOST_STARTS)
    given["sample"] = sampling_in_words(options.sample) if options.sample else None
    said = {key: value for key, value in given.items() if value is not None}
    said["set"] = settings_of(options.set)
    said["vary"] = dict(varied_in_words(text) for text in options.vary)
    if len(said["vary"]) < len(options.vary):
        raise ValueError("--vary: a parameter is given twice; keep one")
    return said


def design_of(file: Mapping[str, Any], words: Mapping[str, Any]) -> Design:
    """The design that a sweep's file and the command line give together.

    A parameter that the command line sets or varies is no longer set or varied as the file says.

    Parameters
    ----------
    file, words : mapping
        From `read_sweep`, or empty, and `given_in_words`.

    Raises
    ------
    ValueError
        For what is missing, contradicts itself or has no meaning.
    """
    said = {**DEFAULTS, **file, **words}
    for key, other in (("set", "vary"), ("vary", "set")):
        left = {name: value for name, value in file.get(key, {}).items() if name not in words.get(other, {})}
        said[key] = {**left, **words.get(key, {})}
    for name in said["set"]:
        if name in said["vary"]:
            raise ValueError(f"{name}: is set and varied; keep one")
    if "scene" not in said:
        raise ValueError("scene: none given; give --scene NAME, or a sweep's file that names one")
    scene = load_scene(said["scene"]).with_parameters(said["set"])
    return Design(scene, tuple(said["vary"].values()), said["sample"], tuple(checked_names(said["measure"])),
                  said["starts"], said["settling"], said["duration"])


FOLDER = "blocks"
#: How the error of a row begins whose point is no legal scene.
NO_SCENE = "no such scene: "
_TYPES = {float: pa.float64(), bool: pa.bool_(), str: pa.string()}


def study_of(design: Design) -> Study:
    """The table of a sweep: a row a run, point by point, and within a point start by start."""
    methods = next((axis.values for axis in design.axes if axis.name == "solver.method"),
                   (design.scene["solver.method"],))
    starts = min(max(design.starts, 1), PART)
    run_time = (design.settling + design.duration) * starts
    block = max(1, min(_BLOCK_ROWS // starts, int(_BLOCK_TIME / run_time)))
    return Study("sweep", design.document(), fields_of(design), partial(rows_of, design), partial(_are_own, design),
                 run_time, cast(tuple[str, ...], methods), design.points * design.parts, block)


def _are_own(design: Design, numbers: Sequence[int], rows: list[dict]) -> bool:
    own = [{"point": point, "start": start, **design.changes(point)}
           for point, starts in map(design.runs, numbers) for start in starts]
    return are(rows, own) and all(not row["states"] if row["turns"] is None else row["turns"] >= 0 and row["states"] and
                                  len(row["states"]) % (row["turns"] or KEPT_STATES) == 0 for row in rows)


def rows_of(design: Design, number: int) -> list[dict]:
    """Run a part; a row a start, with NaN and the reason where it cannot go on."""
    point, starts = design.runs(number)
    changes = design.changes(point)
    rows = [{"point": point, "start": start, **changes, **dict.fromkeys(design.measures, math.nan), "turns": None,
             "states": [], "error": None, "warning": None} for start in starts]
    try:
        scene = design.scene.with_parameters(changes)
    except ValueError as error:
        return [{**row, "error": f"{NO_SCENE}{error}"} for row in rows]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # it stands in the row
        for row, start in zip(rows, starts, strict=True):
            row["warning"] = scene.broken_promise or None
            try:
                values, motion = measure_with_motion(scene, design.measures, design.settling, design.duration, start)
                row.update(values)
                if motion is not None:
                    row |= {"turns": motion.turns, "states": motion.states[-(motion.turns or KEPT_STATES):].ravel()}
            except SimulationError as error:
                row["error"] = str(error)
    return rows


def fields_of(design: Design) -> list[Field]:
    """The columns: what varies, and what was measured."""
    return [
        Field("point", pa.int64(), "1", "number of the combination of parameters"),
        Field("start", pa.int64(), "1", "number of the drawn start; null for the scene's own", True),
        *(Field(name, _TYPES[type(BY_NAME[name].default)], BY_NAME[name].unit or "1", BY_NAME[name].description)
          for name in design.names),
        *(Field(name, pa.float64(), MEASURES[name].unit, MEASURES[name].meaning) for name in design.measures),
        Field("turns", pa.int64(), "1", "turns of the crank after which the motion repeats itself, by the end of the "
              "run; 0: it does not; null: it has not settled", True),
        Field("states", NUMBERS, "1", "states of this motion at the cut, one after the other, in crank radii and crank "
              "radii times motor speed"),
        Field("error", pa.string(), "1", "why the row has no values; else null", True),
        Field("warning", pa.string(), "1", "what is to be known about the values; else null", True),
    ]
