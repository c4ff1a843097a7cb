"""The result of a study of basins in words."""

import math

import numpy as np
import pyarrow as pa

from vibro_ros.orbits.recurrence import LONGEST_PERIOD
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.study.basins.attractors import MOST_MOTIONS, NOWHERE, UNSETTLED, UNTOLD, Attractor, Found
from vibro_ros.study.basins.design import Design
from vibro_ros.study.basins.fractions import BasinEntropy

_TOLD = 12  # motions
_PART = 0.05  # of the largest part of a shock: smaller parts are not told


def in_words(design: Design, table: pa.Table, found: Found, entropy: BasinEntropy | None,
             upsets: list[pa.Table]) -> list[str]:
    """What was found, a line each."""
    over = ", ".join(f"{one.name} {one.low:g} to {one.high:g} {one.unit}" for one in design.starts.over)
    watched = float(np.mean(table["after"].to_numpy()))
    lines = [f"{design.starts.count} starts over {over}; watched for {watched:.1f} turns on average, cut at "
             f"{design.phase:.4f} rad"]
    for number, attractor in enumerate(found.attractors[:_TOLD], 1):
        lines.append(f"motion {number}: {motion_in_words(attractor)}; {_share(attractor)}; {_stability(attractor)}")
    if len(found.attractors) > _TOLD:
        lines.append(f"{len(found.attractors) - _TOLD} more motions; without losses every start has one of its own")
    for row in (row for one in upsets[:_TOLD] for row in one.to_pylist()):
        lines.append(f"motion {row['attractor']}: {_upset(design, row)}")
    if entropy:
        lines.append(entropy_in_words(entropy))
    return lines + _left_over(design, table, found)


def motion_in_words(attractor: Attractor) -> str:
    """Mean speed and period."""
    turns = attractor.motion.turns
    again = f"again after {turns} turn{'s' * (turns > 1)}" if turns else f"not again within {LONGEST_PERIOD} turns"
    return f"{attractor.motion.mean_speed * 1e3:.4g} mm/s, {again}"


def entropy_in_words(entropy: BasinEntropy) -> str:
    """The basin entropies and what they say about the boundary."""
    if not entropy.mixed:
        return f"basin entropy 0: each of {entropy.boxes} boxes has one motion"
    says = "so the boundary is fractal" if entropy.fractal else (
        f"not above log 2 = {math.log(2.0):.3f}, which leaves open whether the boundary is fractal")
    return (f"basin entropy {entropy.entropy:.4f}, of the {entropy.mixed} of {entropy.boxes} boxes with more than one "
            f"motion {entropy.boundary:.4f}, {says}")


def _share(attractor: Attractor) -> str:
    share = attractor.fraction
    return (f"{attractor.count} start{'s' * (attractor.count > 1)}, {100.0 * share.share:.2f} % (95 % interval "
            f"{100.0 * share.low:.2f} to {100.0 * share.high:.2f} %)")


def _stability(attractor: Attractor) -> str:
    if not attractor.motion.turns:
        return f"largest Lyapunov exponent {attractor.lyapunov:.3g} 1/s"
    if not len(attractor.multipliers):
        return "no orbit closes by Newton's method"
    return f"largest Floquet multiplier {abs(attractor.multipliers[0]):.4f}"


def _upset(design: Design, row: dict) -> str:
    names = coordinates(design.scene)
    if row["size"] is None:
        return "no shock was found that changes it"
    parts = np.array([row[f"change.{name}"] for name in names])
    scale = np.array([design.scene["crank.radius"] * (design.scene["motor.speed"] if UNITS[name] == "m/s" else 1.0)
                      for name in names])
    told = np.abs(parts / scale) >= _PART * np.abs(parts / scale).max()
    change = ", ".join(f"{name} {part:+.3g} {UNITS[name]}" for name, part, tell in zip(names, parts, told, strict=True)
                       if tell)
    alone = ", ".join(f"{name} {row[f'alone.{name}']:+.3g} {UNITS[name]}" for name in names
                      if row[f"alone.{name}"] is not None)
    after = f"motion {row['leads_to']}" if row["leads_to"] != UNTOLD else "another motion"
    return (f"smallest shock found {row['size']:.3g}: at {row['crank_angle']:.3f} rad {change}, to {after}; "
            f"one coordinate alone: {alone}")


def _left_over(design: Design, table: pa.Table, found: Found) -> list[str]:
    lines = []
    for number, what in ((UNSETTLED, f"starts had not settled within {design.most_turns} turns"),
                         (UNTOLD, f"starts have other motions than the first {MOST_MOTIONS}"),
                         (NOWHERE, "starts cannot be, or could not go on")):
        if count := int(np.sum(found.numbers == number)):
            reason = next(text for text in table["error"].to_pylist() if text) if number == NOWHERE else ""
            lines.append(f"{count} {what}{f', such as: {reason}' if reason else ''}")
    return lines
