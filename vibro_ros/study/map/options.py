"""The grid and the machine of a map, from the command line."""

import argparse

from vibro_ros.configuration.command_map import MOST_ROWS, SIDES, Axis
from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.process.front_door import Parser
from vibro_ros.study.map.design import MapDesign
from vibro_ros.study.options import add_machine, machine_of
from vibro_ros.study.sweep.variation import whole_number

BOTH = "both"
MOTOR_SPEEDS, GAPS = "50:250:101", "-0.002:0.008:41"
QUICK = "60:180:13", "0:0.006:4"
"""Grids of a full and of a quick map."""


def add_grid(parser: Parser) -> None:
    """The options that name machine and grid."""
    add_machine(parser, "device")
    parser.add_argument("--motor-speed", metavar="LOW:HIGH:COUNT",
                        help=f"motor speeds [rad/s] (default: {MOTOR_SPEEDS})")
    parser.add_argument("--gap", metavar="LOW:HIGH:COUNT", help=f"gaps [m] (default: {GAPS})")
    parser.add_argument("--quick", action="store_true", help=f"a coarse grid, {QUICK[0]} rad/s and {QUICK[1]} m, with "
                        "few trials: a look within a minute")


def design_of(options: argparse.Namespace) -> MapDesign:
    """The map that is asked for.

    Raises
    ------
    ValueError
        For what is no grid or no scene; the message names value, limit and remedy.
    """
    scene = machine_of(options)
    if scene["solver.method"] != "exact":
        raise ValueError(f"solver.method: {scene['solver.method']} has no map; take exact, whose states repeat to "
                         "rounding")
    sides = SIDES if options.gaps == BOTH else (options.gaps,)
    for side in sides:
        if side not in scene.plates:
            raise ValueError(f"--gaps {options.gaps}: {scene.name} has no {side} plate; give another scene or side")
    speeds, gaps = QUICK if options.quick else (MOTOR_SPEEDS, GAPS)
    design = MapDesign(scene, sides, _axis("--motor-speed", options.motor_speed or speeds),
                       _axis("--gap", options.gap or gaps))
    if design.speeds.low <= 0.0:
        raise ValueError(f"--motor-speed: from {design.speeds.low:g} rad/s; a crank that stands has no motion: give "
                         "speeds above 0")
    if 4 * design.speeds.count * design.gaps.count > MOST_ROWS:
        raise ValueError(f"--motor-speed, --gap: {design.speeds.count} x {design.gaps.count} cells; give at most "
                         f"{MOST_ROWS // 4}")
    design.check()
    return design


def _axis(option: str, text: str) -> Axis:
    parts = [read_scalar(part) for part in text.split(":")]
    if len(parts) != 3 or not all(isinstance(part, (int, float)) and not isinstance(part, bool) for part in parts[:2]):
        raise ValueError(f"{option} {text}: give LOW:HIGH:COUNT")
    low, high = float(parts[0]), float(parts[1])  # type: ignore[arg-type]
    if not (-1e9 < low < high < 1e9):
        raise ValueError(f"{option} {text}: is no range; give the smaller number first")
    return Axis(low, high, whole_number(f"{option}: count", parts[2], 2, 10_000))
