"""What a diagram has found, in words."""

import math
from collections.abc import Iterator

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.study.diagram.design import DOWN, UP
from vibro_ros.study.diagram.result import Diagram, Region, extent, kind

_MOST_RANGES = 40  # of a table that is read; the files hold all


def in_words(found: Diagram) -> Iterator[str]:
    """Lines: a table of ranges, then the regions of hysteresis."""
    design, name = found.design, found.design.axis.name
    unit = BY_NAME[name].unit
    head = f"{name} [{unit}]" if unit else name
    yield f"{'':5} {head:>24}  {'repeats itself':16} {'mean speed [mm/s]':>18} {'largest exponent [1/s]':>23} {'K':>13}"
    ranges = found.ranges()
    for one in ranges[:_MOST_RANGES]:
        exponents = [found.nature("exponent_1", visit) for visit in one.visits]
        speeds = [1e3 * found.visits[visit].motion.mean_speed for visit in one.visits]
        chaos = [found.nature("zero_one", visit) for visit in one.visits]
        yield (f"{one.direction:5} {_between((one.low, one.high), '.6g'):>24}  {kind(found.visits[one.visits[0]]):16} "
               f"{_between(extent(speeds), '.2f'):>18} {_between(extent(exponents), '.2f'):>23} "
               f"{_between(extent(chaos), '.2f'):>13}").rstrip()
    if len(ranges) > _MOST_RANGES:
        yield f"and {len(ranges) - _MOST_RANGES} ranges more; the files hold all"
    regions = found.hysteresis()
    for region in regions:
        yield _of_region(found, region)
    if not regions:
        yield f"hysteresis: none at the {len(design.axis.values)} values; both ways lead to the same motions"
    unsettled = sum(not one.settled for one in found.visits)
    if unsettled:
        yield (f"not settled: {unsettled} of {design.visits} visits within {design.most_turns} turns, of which nothing "
               "is said about hysteresis; give more --most-turns, or dampers")


def _of_region(found: Diagram, region: Region) -> str:
    unit = BY_NAME[found.design.axis.name].unit
    ways = []
    for direction in (UP, DOWN):
        visits = [found.of(direction)[place] for place in region.places]
        kinds = ", ".join(dict.fromkeys(map(kind, visits)))
        speeds = _between(extent([1e3 * one.motion.mean_speed for one in visits]), ".2f")
        ways.append(f"{direction} {kinds} at {speeds} mm/s")
    where = f"{_between((region.low, region.high), '.6g')}{f' {unit}' if unit else ''}"
    return f"hysteresis: {where} ({len(region.places)} value{'s' * (len(region.places) > 1)}): {'; '.join(ways)}"


def _between(ends: tuple[float, float], form: str) -> str:
    low, high = (f"{end:{form}}" for end in ends)
    if math.isnan(ends[0]):
        return ""
    return low if low == high else f"{low} to {high}"
