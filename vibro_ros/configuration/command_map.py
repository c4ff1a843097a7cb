"""The command map of a machine: which motions it has at each motor speed and gap.

The map is a grid of cells over the motor's speed and the gap, which is the same for all commanded sides, and a table
with a row for each motion that was found in a cell. `study map` makes maps, `controller` reads them. A map's file is
strict JSON with exactly the keys in `_KEYS`; `_numbers` checks every column.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from vibro_ros.model.parameters import BY_NAME, Value, checked_parameters, quoted
from vibro_ros.model.scene import Scene
from vibro_ros.process.files import read_file

PATCHWORK = -1
"""Motion number of cells that form no motion, because what was found changes from cell to cell."""
TYPE = "vibro_ros command map, version 1"
"""Value of the key `type` in a file; files of another format have another version."""
LARGEST = 2**20
"""Largest file [bytes]."""
SIDES = ("upper", "inclined")
"""Sides whose gaps a map may vary."""
CURVES = ("fold", "period doubling", "Neimark-Sacker", "grazing")
"""Kinds of bifurcation curves."""
# A settled motion does not depend on how plates, and a motor whose speed is prescribed, reach their commands, nor on
# the commanded speed itself, nor on limits that only warn.
_FREE = ("start.", "solver.", "gap_actuator.")
_OF_MOTOR, _FREE_OF_DC = ("motor.", "effects.motor"), (
    "motor.speed", "motor.max_speed", "motor.acceleration", "motor.time_constant", "motor.voltage",
    "motor.continuous_current")


@dataclass(frozen=True)
class Axis:
    """At least two equally spaced values, in the unit of the command."""

    low: float
    high: float
    count: int

    @property
    def step(self) -> float:
        """Distance between neighbouring values, in the unit of the command."""
        return (self.high - self.low) / (self.count - 1)

    @property
    def values(self) -> np.ndarray:
        """All values, shape (count,)."""
        return np.linspace(self.low, self.high, self.count)

    def nearest(self, value: float) -> int | None:
        """Return the index of the value nearest to `value`; None if it lies more than half a step outside."""
        index = round((value - self.low) / self.step) if math.isfinite(value) else -1
        return index if 0 <= index < self.count else None


@dataclass(frozen=True)
class Found:
    """The motions that were found, a row each: columns of shape (rows,).

    Attributes
    ----------
    speed_index, gap_index : ndarray of int
        Cell of the grid.
    motion : ndarray of int
        Number of the motion: the same in neighbouring cells between which the motion changes little; `PATCHWORK` where
        it has no number.
    turns : ndarray of int
        Period of the motion in turns of the crank; 0 if it has no period.
    landings : ndarray of int
        Landings of the body in a period; 0 if the motion has no period.
    sure : ndarray of int
        1 where the robot surely settles to this motion, whatever it did before: no trial led to another motion, and
        this one has a period and a number; else 0.
    mean_speed : ndarray
        Mean speed of the body [m/s], forwards positive.
    cost_of_transport : ndarray
        Mean power / (weight x speed), dimensionless; NaN where it is not defined.
    stick_share, air_share : ndarray
        Shares of the time in which the body sticks to the ground, and is in the air, dimensionless.
    """

    speed_index: np.ndarray
    gap_index: np.ndarray
    motion: np.ndarray
    turns: np.ndarray
    landings: np.ndarray
    sure: np.ndarray
    mean_speed: np.ndarray
    cost_of_transport: np.ndarray
    stick_share: np.ndarray
    air_share: np.ndarray

    def describe(self, row: int) -> str:
        """Return the motion of a row in words."""
        turns, landings = int(self.turns[row]), int(self.landings[row])
        kind = "without a period" if not turns else (
            f"period {turns} turn{'s' * (turns > 1)}, {landings} landing{'s' * (landings != 1)}")
        return f"{self.mean_speed[row] * 1e3:.0f} mm/s, {kind}"


_COLUMNS = tuple(field.name for field in fields(Found))
_KEYS = ("type", "made_by", "scene", "parameters", "gaps", "motor_speed", "gap", "found", "curves")


@dataclass(frozen=True)
class Curve:
    """Bifurcation curve of the motions with a period of `turns` turns; its kind is one of `CURVES`.

    The points of the curve have a motor speed [rad/s] and a gap [m].
    """

    kind: str
    turns: int
    motor_speed: tuple[float, ...]
    gap: tuple[float, ...]


@dataclass(frozen=True)
class CommandMap:
    """The motions of a machine over motor speed [rad/s] and gap [m]: the grid, the motions found, and the curves.

    `parameters` are all parameters of the scene that the motions depend on, without the commands; `sides` are the sides
    whose gaps are commanded, always to the same value.
    """

    scene: str
    parameters: Mapping[str, Value]
    sides: tuple[str, ...]
    speeds: Axis
    gaps: Axis
    found: Found
    curves: tuple[Curve, ...]

    @property
    def commands(self) -> tuple[str, ...]:
        """The commands that the axes of the map stand for."""
        return ("motor_speed", *(f"{side}_gap" for side in self.sides))

    def difference(self, scene: Scene) -> str:
        """Return in words the first parameter in which `scene` differs from the map's machine; empty if none does."""
        if scene.has_rotor and "effects.motor" not in self.parameters:
            return "effects.motor is given in time there, dc here"
        for name, value in self.parameters.items():
            if scene[name] != value:
                there, here = (f"{one:.6g}" if isinstance(one, float) else str(one) for one in (value, scene[name]))
                return f"{name} is {there} there, {here} here"
        return ""

    def rows_at(self, commands: Mapping[str, float]) -> np.ndarray:
        """Return the rows of the motions at commands, in the units of the topics.

        The result is empty outside the map, and where the gaps of both sides differ by more than half a step.
        """
        gaps = [commands[f"{side}_gap"] for side in self.sides]
        if max(gaps) - min(gaps) > self.gaps.step / 2.0:
            return np.empty(0, dtype=int)
        speed, gap = self.speeds.nearest(commands["motor_speed"]), self.gaps.nearest(sum(gaps) / len(gaps))
        return np.flatnonzero((self.found.speed_index == speed) & (self.found.gap_index == gap))


def parameters_that_count(scene: Scene, sides: tuple[str, ...]) -> dict[str, Value]:
    """Return the parameters that a scene's motions depend on: all but commands, actuators, start and solver.

    The parameters of a dc motor are included, because the motions depend on it.
    """
    return {name: scene[name] for name in _names_that_count(sides, scene.has_rotor)}


def _names_that_count(sides: tuple[str, ...], with_motor: bool) -> list[str]:
    free = (*_FREE, *(_FREE_OF_DC if with_motor else _OF_MOTOR), *(f"{side}.gap" for side in sides))
    return [name for name in BY_NAME if not name.startswith(free)]


def read_map(path: Path) -> CommandMap:
    """Read and check the file of a command map.

    Raises
    ------
    ValueError
        When the file is no command map of this version; one line that names the file and the place in it.
    """
    try:
        return _command_map(json.loads(read_file(path, LARGEST), parse_constant=_refuse))
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}; give the path of a command map") from error
    except RecursionError:
        raise ValueError(f"{path}: no command map: its lists are nested too deep") from None
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path}: no command map: {error}; make one with `study map`") from error


def written(command_map: CommandMap, made_by: str) -> str:
    """Return the text of a map's file; numbers of the table have 5 digits."""
    columns = {name: [_rounded(value) for value in getattr(command_map.found, name).tolist()] for name in _COLUMNS}
    axes = {name: {"from": axis.low, "to": axis.high, "count": axis.count}
            for name, axis in (("motor_speed", command_map.speeds), ("gap", command_map.gaps))}
    document = {
        "type": TYPE, "made_by": made_by, "scene": command_map.scene, "parameters": dict(command_map.parameters),
        "gaps": list(command_map.sides), **axes, "found": columns,
        "curves": [{"kind": curve.kind, "turns": curve.turns, "motor_speed": list(curve.motor_speed),
                    "gap": list(curve.gap)} for curve in command_map.curves]}
    lines = ",\n".join(f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in document.items())
    return f"{{\n{lines}\n}}\n"


def _rounded(value: float) -> float | None:
    if isinstance(value, int):
        return value
    return float(f"{value:.5g}") if math.isfinite(value) else None


def _refuse(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _command_map(document: Any) -> CommandMap:
    given = _fields(document, "the document", _KEYS)
    if given["type"] != TYPE:
        raise ValueError(f"type: {quoted(given['type'])} is not {TYPE!r}")
    sides, scene, curves, parameters = given["gaps"], given["scene"], given["curves"], given["parameters"]
    if sides not in ([*SIDES], *([side] for side in SIDES)):
        raise ValueError(f"gaps: {quoted(sides)} is no list of sides; give {', '.join(SIDES)}, or one of them")
    if not isinstance(scene, str) or not scene.isprintable() or len(scene) > 200:
        raise ValueError("scene: is no text of at most 200 characters")
    if not isinstance(parameters, dict) or not isinstance(curves, list):
        raise ValueError("parameters, curves: give a mapping and a list")
    # A parameter that the file lacks gets its default: an older version wrote the file.
    table = [BY_NAME[name] for name in _names_that_count(tuple(sides), "effects.motor" in parameters)]
    parameters = checked_parameters({one.name: one.default for one in table} | parameters, table)
    speeds, gaps = (_axis(given[name], name) for name in ("motor_speed", "gap"))
    if speeds.low <= 0.0:
        raise ValueError(f"motor_speed: from {speeds.low:g} rad/s; give speeds above 0")
    return CommandMap(scene, parameters, tuple(sides), speeds, gaps, _read_found(given["found"], speeds, gaps),
                      tuple(_curve(curve, f"curves[{number}]") for number, curve in enumerate(curves)))


def _axis(given: Any, name: str) -> Axis:
    low, high, count = _numbers([*_fields(given, name, ("from", "to", "count")).values()], name).tolist()
    if not (low < high and count in range(2, 10_001)):
        raise ValueError(f"{name}: is no grid of at least 2 ascending values")
    return Axis(low, high, int(count))


def _read_found(given: Any, speeds: Axis, gaps: Axis) -> Found:
    limits = {"speed_index": (0, speeds.count - 1), "gap_index": (0, gaps.count - 1), "motion": (PATCHWORK, 10**6),
              "turns": (0, 10**6), "landings": (0, 10**9), "sure": (0, 1)}
    columns = {name: _numbers(values, f"found.{name}", limits.get(name), may_lack=name == "cost_of_transport")
               for name, values in _fields(given, "found", _COLUMNS).items()}
    if len({len(column) for column in columns.values()}) > 1:
        raise ValueError("found: its columns have not the same length")
    return Found(**columns)


def _curve(given: Any, where: str) -> Curve:
    kind, turns, *points = _fields(given, where, ("kind", "turns", "motor_speed", "gap")).values()
    if kind not in CURVES:
        raise ValueError(f"{where}.kind: is none of {', '.join(CURVES)}")
    (turns,) = _numbers([turns], f"{where}.turns", (1, 10**6)).tolist()
    speeds, gaps = (tuple(_numbers(values, where).tolist()) for values in points)
    if len(speeds) != len(gaps):
        raise ValueError(f"{where}: {len(speeds)} motor speeds and {len(gaps)} gaps")
    return Curve(kind, turns, speeds, gaps)


def _numbers(given: Any, where: str, whole: tuple[int, int] | None = None, may_lack: bool = False) -> np.ndarray:
    """Check a list of numbers and return it as an array (ValueError).

    The numbers are up to 1e9 in magnitude, or whole numbers in the range `whole`. None becomes NaN if `may_lack`.
    """
    low, high = whole or (-1e9, 1e9)
    values = np.array([math.nan if value is None and may_lack else value for value in given]
                      if isinstance(given, list) else given)
    kinds = "i" if whole and values.size else "if"  # numpy's codes of integers and floats
    if values.ndim != 1 or values.dtype.kind not in kinds or np.any((values < low) | (values > high)):
        raise ValueError(f"{where}: holds what is no {'whole ' * bool(whole)}number from {low:g} to {high:g}")
    return values.astype(int if whole else float)


def _fields(given: Any, where: str, keys: tuple[str, ...]) -> dict[str, Any]:
    """Return `given` in the order of `keys` (ValueError unless it is a mapping with exactly these keys)."""
    if not isinstance(given, dict):
        raise ValueError(f"{where}: is no mapping")
    if wrong := [key for key in (*keys, *given) if key not in given or key not in keys]:
        raise ValueError(f"{where}: {quoted(wrong[0])} is {'unknown' if wrong[0] in given else 'missing'}")
    return {key: given[key] for key in keys}
