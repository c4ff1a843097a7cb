"""Varied parameters of a sweep: lists and grids of values, and ranges that are sampled.

Linked parameters, such as ``upper.gap+inclined.gap``, always have the same value.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from vibro_ros import PARAMETERS, Parameter, Value, parameter_named, read_scalar

#: Largest number of values of a list or grid, because every file's metadata contain all of them, and of samples.
MOST_VALUES, MOST_SAMPLES = 10_000, 10_000_000
LOG = "log"
#: Stands between the names of linked parameters.
LINK = "+"
#: Methods to sample ranges, all with a seed.
SAMPLERS = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}


@dataclass(frozen=True)
class Axis:
    """A parameter, or linked ones, that take each of some values in turn."""

    name: str  # name of the parameter; names of linked ones with `LINK` between them
    values: tuple[Value, ...]  # its values, in SI units, in their order

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, one or the linked ones."""
        return parameter_names(self.name)

    def document(self) -> list[Value]:
        """Its entry in a sweep's file."""
        return list(self.values)


@dataclass(frozen=True)
class Range:
    """A numeric parameter, or linked ones, sampled in a range."""

    name: str  # name of the parameter; names of linked ones with `LINK` between them
    low: float  # its limits, in SI units
    high: float
    log: bool  # whether its logarithm is distributed evenly, instead of the number itself

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, one or the linked ones."""
        return parameter_names(self.name)

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Values at `shares` of the range, from 0 to 1."""
        return values_at_shares(self.low, self.high, self.log, shares)

    def document(self) -> dict[str, Value]:
        """Its entry in a sweep's file."""
        return {"from": self.low, "to": self.high, **({"scale": LOG} if self.log else {})}


@dataclass(frozen=True)
class Sampling:
    """Sampling of the ranges."""

    method: str  # name in `SAMPLERS`
    count: int  # number of points
    seed: int  # seed of the random numbers that shift or scatter the points

    def shares(self, dimensions: int) -> np.ndarray:
        """Points in the unit cube, shape (count, dimensions)."""
        return SAMPLERS[self.method](dimensions, seed=np.random.default_rng(self.seed)).random(self.count)


def parameter_names(name: str) -> tuple[str, ...]:
    """Return the names of the parameters that `name` links, or `name` itself."""
    return tuple(name.split(LINK))


def values_at_shares(low: float, high: float, log: bool, shares: np.ndarray) -> np.ndarray:
    """Values from `low` at share 0 to `high` at share 1, linear or logarithmic; both ends are exact."""
    values = low * (high / low) ** shares if log else low + (high - low) * shares
    return np.where(shares == 1.0, high, np.clip(values, min(low, high), max(low, high)))


def varied(name: str, given: object) -> Axis | Range:
    """Return the axis or range of a parameter, or of linked ones, from its entry in a sweep's file.

    A list has the values; a mapping has `from`, `to` and optionally `scale` for a range that is sampled, and `count`
    for a grid.
    """
    parameters = [parameter_named(one, PARAMETERS) for one in parameter_names(name)]
    first = parameters[0]
    for other in parameters[1:]:
        if (other.unit, other.type_name) != (first.unit, first.type_name):
            raise ValueError(f"{name}: {first.name} is {first.type_name} [{first.unit or '1'}] and {other.name} "
                             f"{other.type_name} [{other.unit or '1'}]; link parameters of one kind")
    if isinstance(given, (list, tuple)):
        return _axis(name, parameters, given)
    if not isinstance(given, dict):
        raise ValueError(f"{name}: {given!r} varies nothing; give a list of values, or `from` and `to`")
    for key in given:
        if key not in ("from", "to", "count", "scale"):
            raise ValueError(f"{name}: {key!r} is unknown; give from, to, count, scale")
    for key in ("from", "to"):
        if key not in given:
            raise ValueError(f"{name}: {key!r} is missing; give `from` and `to`")
    return _grid_or_range(name, parameters, given["from"], given["to"], given.get("count"),
                          given.get("scale", "linear"))


def varied_in_words(text: str, linked: bool = False) -> tuple[str, Axis | Range]:
    """Parse a parameter's name and its axis or range: ``NAME=A,B,C``, ``NAME=LOW:HIGH:COUNT`` or ``NAME=LOW:HIGH``.

    After either of the last two, ``:log`` spaces the values evenly by their logarithms. If `linked` is true, ``NAME``
    may be several names with `LINK` between them.
    """
    name, equals, values = text.partition("=")
    parts = values.split(":")
    if not equals or not values:
        raise ValueError(f"--vary {text}: give NAME=LOW:HIGH:COUNT, NAME=LOW:HIGH with --sample, or NAME=A,B,C")
    if LINK in name and not linked:
        raise ValueError(f"--vary {text}: only `study sweep` links parameters; give one name")
    if len(parts) == 1:
        try:
            return name, varied(name, [read_scalar(value.strip()) for value in values.split(",")])
        except ValueError as error:
            if not PARAMETERS.keys() >= set(parameter_names(name)):
                raise
            raise ValueError(f"{error}; --vary takes NAME=LOW:HIGH:COUNT, NAME=LOW:HIGH with --sample, or NAME=A,B,C"
                             ) from None
    scale = parts.pop() if parts[-1] == LOG else "linear"
    if len(parts) not in (2, 3):
        raise ValueError(f"--vary {text}: has {len(parts)} parts; give LOW:HIGH:COUNT, or LOW:HIGH with --sample")
    low, high, *count = map(read_scalar, parts)
    return name, varied(name, {"from": low, "to": high, "scale": scale, **({"count": count[0]} if count else {})})


def sampling(method: object, count: object, seed: object) -> Sampling:
    """Return a checked `Sampling`."""
    if method not in SAMPLERS:
        raise ValueError(f"sample: {method!r} is unknown; choose one of {', '.join(SAMPLERS)}")
    points = whole_number("sample: count", count, 1, MOST_SAMPLES)
    if method == "sobol" and points & (points - 1):
        less = 1 << (points.bit_length() - 1)
        raise ValueError(f"sample: {points} points of sobol are not spread evenly; give {less} or {2 * less}")
    return Sampling(str(method), points, whole_number("sample: seed", seed, 0, 2**63 - 1))


def sampling_in_words(text: str) -> Sampling:
    """Parse a `Sampling` from ``METHOD:COUNT`` or ``METHOD:COUNT:SEED`` (ValueError as for `sampling`)."""
    method, *numbers = text.split(":")
    if len(numbers) not in (1, 2):
        raise ValueError(f"--sample {text}: give METHOD:COUNT or METHOD:COUNT:SEED, with METHOD one of "
                         f"{', '.join(SAMPLERS)}")
    count, seed = (*map(read_scalar, numbers), 0)[:2]
    return sampling(method, count, seed)


def ends_at(values: Mapping[str, Sequence[Value]], at: int) -> list[str]:
    """Names of the numeric scanned parameters that have their least or largest value at the point `at`.

    `values` contains, by scanned parameter, its value at every point. A parameter of two values has no ends, because
    each of its points would be one.
    """
    numbers = [name for name, every in values.items() if isinstance(every[0], float) and len(set(every)) > 2]
    return [name for name in numbers if values[name][at] in (min(values[name]), max(values[name]))]  # type: ignore


def at_the_edge(what: str, ends: Sequence[str], direction: str = "rise") -> str:
    """Return a sentence that the extreme `what` lies at the end of a range, so that it may be no optimum.

    Empty without `ends`, the names of the parameters.
    """
    return f"{what} is at the end of the range of {', '.join(ends)}: it may still {direction} beyond" if ends else ""


def whole_number(what: str, value: object, least: int, most: int) -> int:
    """Return `value` if it is an integer from `least` to `most`; else raise a ValueError that begins with `what`."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise ValueError(f"{what}: {value!r} is out of range; give a whole number from {least} to {most}")
    return value


def _axis(name: str, parameters: Sequence[Parameter], values: Sequence[object]) -> Axis:
    if not 1 <= len(values) <= MOST_VALUES:
        raise ValueError(f"{name}: {len(values)} values; give from 1 to {MOST_VALUES}")
    checked = tuple(_checked(parameters, value) for value in values)
    if len(set(checked)) < len(checked):
        twice = next(value for k, value in enumerate(checked) if value in checked[:k])
        raise ValueError(f"{name}: {twice!r} is given twice; keep one")
    return Axis(name, checked)


def _grid_or_range(name: str, parameters: Sequence[Parameter], low: object, high: object, count: object,
                   scale: object) -> Axis | Range:
    if not isinstance(parameters[0].default, float):
        raise ValueError(f"{name}: is {parameters[0].type_name}, which has no range; list its values")
    if scale not in ("linear", LOG):
        raise ValueError(f"{name}: scale {scale!r} is unknown; choose one of linear, {LOG}")
    first, last = _checked(parameters, low), _checked(parameters, high)
    if not first < last:
        raise ValueError(f"{name}: from {first:g} to {last:g} is no range; give the smaller number first")
    if scale == LOG and first <= 0.0:
        raise ValueError(f"{name}: {first:g} has no logarithm; begin above 0, or give no {LOG}")
    if count is None:
        return Range(name, first, last, scale == LOG)
    values = whole_number(f"{name}: count", count, 2, MOST_VALUES)
    return _axis(name, parameters, values_at_shares(first, last, scale == LOG, np.linspace(0.0, 1.0, values)).tolist())


def _checked(parameters: Sequence[Parameter], value: object) -> Any:
    """Return `value` as the parameters take it, which are of one type (ValueError if one of them refuses it)."""
    return [parameter.checked(value) for parameter in parameters][0]
