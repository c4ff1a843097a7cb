"""Varied parameters of a sweep: lists and grids of values, and ranges that are sampled.

Linked parameters, such as ``upper.gap+inclined.gap``, always have the same value.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from vibro_lab.orbits.turn_map import whole_number
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
        """Its entry in the document of a design."""
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
        """Its entry in the document of a design."""
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


def varied_in_words(text: str, linked: bool = False) -> Axis | Range:
    """Parse an axis or a range: ``NAME=A,B,C``, ``NAME=LOW:HIGH:COUNT``, or ``NAME=LOW:HIGH``, which is sampled.

    After either of the last two, ``:log`` spaces the values evenly by their logarithms. If `linked` is true, ``NAME``
    may be several names with `LINK` between them.
    """
    name, equals, values = text.partition("=")
    if not equals or not values:
        raise ValueError(f"--vary {text}: give {_FORMS}")
    if LINK in name and not linked:
        raise ValueError(f"--vary {text}: only `study sweep` links parameters; give one name")
    parameters = [parameter_named(parameter, PARAMETERS) for parameter in parameter_names(name)]
    first = parameters[0]
    for other in parameters[1:]:
        if (other.unit, other.type_name) != (first.unit, first.type_name):
            raise ValueError(f"{name}: {first.name} is {first.type_name} [{first.unit or '1'}] and {other.name} "
                             f"{other.type_name} [{other.unit or '1'}]; link parameters of one kind")
    ends, log = (values.removesuffix(f":{LOG}"), True) if values.endswith(f":{LOG}") else (values, False)
    if ":" not in ends:
        try:
            return _axis(name, parameters, [read_scalar(value.strip()) for value in values.split(",")])
        except ValueError as error:
            raise ValueError(f"{error}; --vary takes {_FORMS}") from None
    if not isinstance(first.default, float):
        raise ValueError(f"{name}: is {first.type_name}, which has no range; list its values")
    low, high, count = limits_in_words(f"--vary {name}", ends)
    low, high = _checked(parameters, low), _checked(parameters, high)
    if log and low <= 0.0:
        raise ValueError(f"{name}: {low:g} has no logarithm; begin above 0, or give no {LOG}")
    if not count:
        return Range(name, low, high, log)
    return _axis(name, parameters, values_at_shares(low, high, log, np.linspace(0.0, 1.0, count)).tolist())


_FORMS = "NAME=LOW:HIGH:COUNT, NAME=LOW:HIGH with --sample, or NAME=A,B,C"


def limits_in_words(what: str, text: str) -> tuple[float, float, int]:
    """Parse ``LOW:HIGH:COUNT``, or ``LOW:HIGH``, whose count is 0 (ValueError that begins with `what`)."""
    parts = [read_scalar(part) for part in text.split(":")]
    if len(parts) not in (2, 3):
        raise ValueError(f"{what}: {text} has {len(parts)} parts; give LOW:HIGH:COUNT or LOW:HIGH")
    for end in parts[:2]:
        if isinstance(end, bool) or not isinstance(end, int | float) or not abs(end) <= 1e100:
            raise ValueError(f"{what}: {end!r} is not a number; give LOW:HIGH:COUNT or LOW:HIGH")
    low, high = float(parts[0]), float(parts[1])  # type: ignore[arg-type]
    if not low < high:
        raise ValueError(f"{what}: from {low:g} to {high:g} is no range; give the smaller number first")
    return low, high, whole_number(f"{what}: count", parts[2], 2, MOST_VALUES) if len(parts) == 3 else 0


def sampling_in_words(text: str) -> Sampling:
    """Parse a `Sampling` from ``METHOD:COUNT`` or ``METHOD:COUNT:SEED``."""
    method, *numbers = text.split(":")
    if len(numbers) not in (1, 2):
        raise ValueError(f"--sample {text}: give METHOD:COUNT or METHOD:COUNT:SEED, with METHOD one of "
                         f"{', '.join(SAMPLERS)}")
    if method not in SAMPLERS:
        raise ValueError(f"--sample {text}: {method!r} is unknown; choose one of {', '.join(SAMPLERS)}")
    count, seed = (*map(read_scalar, numbers), 0)[:2]
    points = whole_number("--sample: count", count, 1, MOST_SAMPLES)
    if method == "sobol" and points & (points - 1):
        less = 1 << (points.bit_length() - 1)
        raise ValueError(f"--sample {text}: {points} points of sobol are not spread evenly; give {less} or {2 * less}")
    return Sampling(method, points, whole_number("--sample: seed", seed, 0, 2**63 - 1))


def ends_at(values: Mapping[str, Sequence[Value]], point: int) -> list[str]:
    """Names of the numeric scanned parameters that have their least or largest value at the point `point`.

    `values` contains, by scanned parameter, its value at every point. A parameter of two values has no ends, because
    each of its points would be one.
    """
    numbers = [name for name, series in values.items() if isinstance(series[0], float) and len(set(series)) > 2]
    return [name for name in numbers if values[name][point] in (min(values[name]), max(values[name]))]  # type: ignore


def at_the_edge(what: str, ends: Sequence[str], direction: str = "rise") -> str:
    """Return a sentence that the extreme `what` lies at the end of a range, so that it may be no optimum.

    Empty without `ends`, the names of the parameters.
    """
    return f"{what} is at the end of the range of {', '.join(ends)}: it may still {direction} beyond" if ends else ""


def _axis(name: str, parameters: Sequence[Parameter], values: Sequence[object]) -> Axis:
    if not 1 <= len(values) <= MOST_VALUES:
        raise ValueError(f"{name}: {len(values)} values; give from 1 to {MOST_VALUES}")
    checked = tuple(_checked(parameters, value) for value in values)
    if len(set(checked)) < len(checked):
        twice = next(value for k, value in enumerate(checked) if value in checked[:k])
        raise ValueError(f"{name}: {twice!r} is given twice; keep one")
    return Axis(name, checked)


def _checked(parameters: Sequence[Parameter], value: object) -> Any:
    """Return `value` as the parameters take it, which are of one type (ValueError if one of them refuses it)."""
    return [parameter.checked(value) for parameter in parameters][0]
