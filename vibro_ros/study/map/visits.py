"""What a machine does in a cell of the map, when it comes there from the cell before."""

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vibro_ros.configuration.command_map import MOST_ROWS, SIDES, Axis, parameters_that_count
from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.recurrence import SettledMotion, settle
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap
from vibro_ros.process.entry_point import Parser
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import Simulator
from vibro_ros.study.command import add_machine, machine_of
from vibro_ros.study.measures import MEASURES, REST, WORK, Window, observed
from vibro_ros.study.variation import whole_number

SPEED, GAP = "motor_speed", "gap"


@dataclass(frozen=True)
class Line:
    """A row or a column of the grid, swept from one end to the other.

    Attributes
    ----------
    along : str
        `SPEED` or `GAP`: what changes.
    place : int
        Index of what stays.
    upwards : bool
        Whether the smallest value comes first.
    """

    along: str
    place: int
    upwards: bool


@dataclass(frozen=True)
class MapDesign:
    """A map to be made.

    Attributes
    ----------
    scene : Scene
        The machine; its own motor speed, gaps of `sides` and start do not count.
    sides : tuple of str
        Sides whose gaps are varied, both alike if there are two.
    speeds, gaps : Axis
        Motor speeds [rad/s] and gaps [m].
    """

    scene: Scene
    sides: tuple[str, ...]
    speeds: Axis
    gaps: Axis

    def scene_at(self, speed_index: int, gap_index: int) -> Scene:
        """The machine in a cell (ValueError where the scene refuses the values)."""
        return self.scene_with(float(self.speeds.values[speed_index]), float(self.gaps.values[gap_index]))

    def scene_with(self, motor_speed: float, gap: float) -> Scene:
        """The machine at a motor speed [rad/s] and a gap [m] (ValueError where the scene refuses the values)."""
        return self.scene.with_parameters({"motor.speed": motor_speed, **{f"{side}.gap": gap for side in self.sides}})

    def lines(self) -> list[Line]:
        """All rows and columns, each in both directions."""
        return [Line(along, place, upwards) for along, other in ((SPEED, self.gaps), (GAP, self.speeds))
                for place in range(other.count) for upwards in (True, False)]

    def cells(self, line: Line) -> Iterator[tuple[int, int]]:
        """Speed and gap index of each cell of a line, in its direction."""
        axis = self.speeds if line.along == SPEED else self.gaps
        for index in range(axis.count) if line.upwards else reversed(range(axis.count)):
            yield (index, line.place) if line.along == SPEED else (line.place, index)

    def document(self) -> dict[str, object]:
        """All that the motions depend on, for the record."""
        solver = {name: value for name, value in self.scene.parameters.items() if name.startswith("solver.")}
        return {"parameters": parameters_that_count(self.scene, self.sides), "solver": solver, "gaps": list(self.sides),
                **{name: [axis.low, axis.high, axis.count]
                   for name, axis in ((SPEED, self.speeds), (GAP, self.gaps))}}


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
    if scene.motor_command != "motor_speed":
        raise ValueError("motor.control: voltage commands no motor speed, which a map has on its axis; choose "
                         "speed_by_voltage or speed_by_current")
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
    for index in range(design.speeds.count):
        design.scene_at(index, 0)  # refuses values that the scene refuses
    for index in range(design.gaps.count):
        design.scene_at(0, index)
    return design


def _axis(option: str, text: str) -> Axis:
    parts = [read_scalar(part) for part in text.split(":")]
    if len(parts) != 3 or not all(isinstance(part, (int, float)) and not isinstance(part, bool) for part in parts[:2]):
        raise ValueError(f"{option} {text}: give LOW:HIGH:COUNT")
    low, high = float(parts[0]), float(parts[1])  # type: ignore[arg-type]
    if not (-1e9 < low < high < 1e9):
        raise ValueError(f"{option} {text}: is no range; give the smaller number first")
    return Axis(low, high, whole_number(f"{option}: count", parts[2], 2, 10_000))


PHASE = math.pi
"""Crank angle [rad] at which states are looked at: both sliders are far from the plates there."""
MOST_TURNS = 2048
"""Turns of the crank after which a start is given up that has not settled."""
UNSETTLED = -1
"""In place of the period of a start that has not settled."""
_LEAST_TURNS, _WITHOUT_PERIOD = 16, 256  # that are measured
_NOTHING = (math.nan, math.nan, math.nan, math.nan)


class Visit(NamedTuple):
    """One motion that was found.

    Attributes
    ----------
    speed_index, gap_index : int
        Cell of the grid.
    turns : int
        Turns of the crank after which it repeats itself; 0 where it does not, `UNSETTLED` where none was found.
    landings : int
        Landings within these turns; 0 without a period.
    mean_speed : float
        Of the body [m/s], forwards positive.
    cost_of_transport, stick_share, air_share : float
        As `study.measures` has them, dimensionless.
    state : tuple of float
        One state at the cut, in units of the machine; empty where none was found.
    """

    speed_index: int
    gap_index: int
    turns: int
    landings: int
    mean_speed: float
    cost_of_transport: float
    stick_share: float
    air_share: float
    state: tuple[float, ...]


def visits(design: MapDesign, line: Line) -> list[Visit]:
    """Sweep a line: each cell begins with the state that the cell before has led to, the first with the scene's own."""
    found, before = [], None
    for speed_index, gap_index in design.cells(line):
        turn_map = TurnMap(design.scene_at(speed_index, gap_index), PHASE)
        stroboscope = Stroboscope(turn_map)
        try:
            try:
                if before is None:
                    stroboscope.begin_as()
                else:
                    stroboscope.begin(before / turn_map.units)
            except ValueError:  # the state before cannot be in this cell
                stroboscope.begin_as()
            motion = settle(stroboscope, most=MOST_TURNS)
            seen = motion and _measured(turn_map, motion)
        except SimulationError:
            motion = seen = None
        if motion and seen:
            before = motion.states[-1] * turn_map.units
            found.append(Visit(speed_index, gap_index, motion.turns, *seen, tuple(motion.states[-1].tolist())))
        else:
            before = None
            found.append(Visit(speed_index, gap_index, UNSETTLED, 0, *_NOTHING, ()))
    return found


def _measured(turn_map: TurnMap, motion: SettledMotion) -> tuple[int, float, float, float, float]:
    """Landings, mean speed, cost of transport, and shares of the time in which the body stands and flies."""
    turns = motion.turns * math.ceil(_LEAST_TURNS / motion.turns) if motion.turns else _WITHOUT_PERIOD
    device = Simulator(turn_map.scene.with_parameters({"solver.accounts": True}))
    device.set_state(crank_angle=turn_map.phase, **dict(zip(turn_map.names, motion.states[-1] * turn_map.units,
                                                             strict=True)))
    period = turn_map.turn_time(motion.states[-1], turns)
    seen = observed(device, (WORK, REST), Window(0.0, period, turns, turns * period))
    landings = round(float(np.sum(seen.events["kind"] == "landing")) * motion.turns / turns)
    speed, cost, standing, airborne = (MEASURES[name].value(seen) for name in (
        "mean_speed", "cost_of_transport", "stick_share", "air_share"))
    return landings, speed if motion.turns else motion.mean_speed, cost, standing, airborne
