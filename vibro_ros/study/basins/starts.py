"""The starts of a study of basins, and all else that decides where they lead."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

import numpy as np
import pyarrow as pa

from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.recurrence import settle
from vibro_ros.orbits.turn_map import TURN, Stroboscope, TurnMap, coordinates, pace
from vibro_ros.simulation.given_state import STATE_UNITS
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.table import NUMBERS, Field, Study, are
from vibro_ros.study.variation import whole_number

ANGLE = "crank_angle"
#: Most starts of a study.
MOST_STARTS = 1_000_000
_MOST_VALUES = 10_000  # of a coordinate of a grid


@dataclass(frozen=True)
class Over:
    """A coordinate of the start that varies.

    Attributes
    ----------
    name : str
        As `Simulator.set_state` has it.
    low, high : float
        Its range [m, m/s or rad].
    count : int
        Values on a grid, both ends among them; 0 where starts are drawn.
    """

    name: str
    low: float
    high: float
    count: int = 0

    @property
    def unit(self) -> str:
        """Its unit."""
        return STATE_UNITS[self.name]

    @property
    def values(self) -> np.ndarray:
        """Values on the grid, shape (count,)."""
        return np.linspace(self.low, self.high, self.count)

    def document(self) -> list:
        """What a file says of it."""
        return [self.name, self.low, self.high, self.count]


@dataclass(frozen=True)
class Plane:
    """A grid over two coordinates; the second changes fastest."""

    over: tuple[Over, ...]

    @property
    def count(self) -> int:
        """How many starts there are."""
        return math.prod(one.count for one in self.over)

    def start(self, number: int) -> dict[str, float]:
        """What a start gives to `Simulator.set_state`."""
        places = divmod(number, self.over[1].count)
        return {one.name: float(values[place])
                for one, values, place in zip(self.over, self._values, places, strict=True)}

    def document(self) -> dict:
        """All that decides the starts, as JSON has it."""
        return {"grid": [one.document() for one in self.over]}

    @cached_property
    def _values(self) -> list[np.ndarray]:
        return [one.values for one in self.over]


@dataclass(frozen=True)
class Draws:
    """Starts that are drawn evenly from a box.

    A start depends on seed and number alone: more starts are the same starts and others.

    Attributes
    ----------
    over : tuple of Over
        The sides of the box.
    count, seed : int
        Starts, and what else their random numbers depend on.
    """

    over: tuple[Over, ...]
    count: int
    seed: int

    def start(self, number: int) -> dict[str, float]:
        """What a start gives to `Simulator.set_state`."""
        shares = np.random.default_rng((self.seed, number)).uniform(size=len(self.over))
        return {one.name: float(one.low + share * (one.high - one.low))
                for one, share in zip(self.over, shares, strict=True)}

    def document(self) -> dict:
        """All that decides the starts, as JSON has it."""
        return {"box": [one.document() for one in self.over], "count": self.count,
                "seed": self.seed}


Starts = Plane | Draws


def over_in_words(scene: Scene, text: str) -> Over:
    """A coordinate from ``NAME=LOW:HIGH`` or ``NAME=LOW:HIGH:COUNT``.

    Raises
    ------
    ValueError
        Naming the value, the limit and the remedy.
    """
    name, equals, values = text.partition("=")
    parts = [read_scalar(part) for part in values.split(":")]
    if not equals or len(parts) not in (2, 3):
        raise ValueError(f"--over {text}: give NAME=LOW:HIGH:COUNT for a grid, NAME=LOW:HIGH for draws")
    known = (*coordinates(scene), ANGLE)
    if name not in known:
        raise ValueError(f"--over {name or repr(name)}: is no coordinate of this scene's start; give one of "
                         f"{', '.join(known)}")
    low, high = (_number(name, part) for part in parts[:2])
    if not low < high:
        raise ValueError(f"--over {name}: from {low:g} to {high:g} is no range; give the smaller number first")
    if name == "body_height" and low < 0.0:
        raise ValueError(f"--over {name}: {low:g} {STATE_UNITS[name]} is out of range; give at least 0")
    count = whole_number(f"--over {name}: count", parts[2], 2, _MOST_VALUES) if len(parts) == 3 else 0
    return Over(name, low, high, count)


def chosen_starts(scene: Scene, over: tuple[Over, ...], count: int, seed: int) -> Starts:
    """The starts that the command line asks for.

    Raises
    ------
    ValueError
        For what contradicts itself or is too much.
    """
    if len({one.name for one in over}) < len(over):
        raise ValueError("--over: a coordinate is given twice; keep one")
    if not any(one.count for one in over):
        return Draws(over or everywhere(scene), whole_number("--starts", count, 1, MOST_STARTS), seed)
    if len(over) != 2 or not all(one.count for one in over):
        raise ValueError(f"--over: {len(over)} coordinates, of which {sum(one.count > 0 for one in over)} have a "
                         "count; a grid has two, both with a count; draws have none with a count")
    plane = Plane(over)
    if plane.count > MOST_STARTS:
        raise ValueError(f"--over: {plane.count} starts are more than {MOST_STARTS}; give smaller counts")
    return plane


def everywhere(scene: Scene) -> tuple[Over, ...]:
    """All coordinates, each within one unit of the machine of rest: a crank radius l, and l omega.

    The body starts on the ground. Where a rigid plate is nearer, the range of its mass ends at the plate. A dc motor's
    crank turns forwards; current and integral are those of the scene's own start.
    """
    reach = scene["crank.radius"]
    speed, sides = reach * pace(scene), []
    for name in coordinates(scene):
        side = name.split("_")[0]
        if name.endswith("velocity") and name != "body_vertical_velocity":
            sides.append(Over(name, -speed, speed))
        elif name == "motor_speed":
            sides.append(Over(name, 0.0, pace(scene)))
        elif side in scene.guides:
            rigid = side in scene.plates and scene[f"effects.{side}_contact"] == "restitution"
            high = scene[f"crank.{side}_rod"] + (min(reach, scene[f"{side}.gap"]) if rigid else reach)
            sides.append(Over(name, high - 2.0 * reach, high))
    return (*sides, Over(ANGLE, 0.0, TURN))


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= 1e6:
        raise ValueError(f"--over {name}: {value!r} is no number up to 1e6; give one in {STATE_UNITS[name]}")
    return float(value)


#: Rows of a block, some seconds of work: what an interruption can lose.
BLOCK_ROWS = 1024
FIRST, MOST = 8, 1_000_000  # limits of turns


@dataclass(frozen=True)
class Design:
    """A study of basins, checked.

    Attributes
    ----------
    scene : Scene
        What starts.
    phase : float
        Crank angle at the cut [rad].
    starts : Starts
        From where.
    turns : int
        Turns of the crank after which a start is looked at for the first time.
    most_turns : int
        Turns after which a start is given up.

    Raises
    ------
    ValueError
        For numbers of turns that make no sense.
    """

    scene: Scene
    phase: float
    starts: Starts
    turns: int
    most_turns: int

    def __post_init__(self) -> None:
        if not FIRST <= self.turns <= self.most_turns <= MOST:
            raise ValueError(f"--turns {self.turns} and --most-turns {self.most_turns}: give numbers from {FIRST} to "
                             f"{MOST}, the smaller one first")

    @property
    def run_time(self) -> float:
        """Robot time [s] of a start that settles at once."""
        return self.turns * TURN / pace(self.scene)

    def document(self) -> dict:
        """All that decides where the starts lead, as JSON has it."""
        return {"scene": self.scene.name, "set": dict(self.scene.parameters), "phase": self.phase,
                "starts": self.starts.document(), "turns": self.turns, "most_turns": self.most_turns}


#: States that tell the motion of a start which is not periodic.
KEPT_STATES = 16
#: How the error of a start begins that cannot be, such as a mass beyond its rigid plate.
NO_START = "no such start: "


def rows_of(design: Design, number: int) -> list[dict]:
    """Let a start settle; one row."""
    stroboscope = stroboscope_of(design.scene, design.phase)
    start, motion, after, error = design.starts.start(number), None, design.most_turns, None
    try:
        stroboscope.begin_as(**start)
        motion = settle(stroboscope, design.turns, design.most_turns)
    except ValueError as refused:
        after, error = 0, f"{NO_START}{refused}"
    except SimulationError as failed:
        after, error = 0, str(failed)
    return [{
        **start, "turns": motion.turns if motion else None, "after": motion.after if motion else after,
        "mean_speed": motion.mean_speed if motion else math.nan,
        "states": [] if motion is None else motion.states[-1:].ravel() if motion.turns else
        motion.states[::len(motion.states) // KEPT_STATES].ravel(), "error": error}]


def _kept_states(turns: int | None) -> int:
    """States that the row of a start keeps, given the period of its motion."""
    return 0 if turns is None else 1 if turns else KEPT_STATES


def stroboscope_of(scene: Scene, phase: float) -> Stroboscope:
    """The stroboscope of a scene, the last one again if it is the same: it takes as long to make as a start."""
    return _stroboscope(scene.name, tuple(scene.parameters.items()), phase)


@lru_cache(maxsize=1)
def _stroboscope(name: str, parameters: tuple[tuple[str, Value], ...], phase: float) -> Stroboscope:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # the command says it once
        return Stroboscope(TurnMap(Scene(name, dict(parameters)), phase))


FOLDER = "blocks"


def study_of(design: Design) -> Study:
    """The table of where each start leads, a row a start."""
    fields = [
        *(Field(one.name, pa.float64(), one.unit, "of the start; other coordinates are as the scene starts")
          for one in design.starts.over),
        Field("turns", pa.int64(), "1", "turns of the crank after which the settled motion repeats itself; 0 where it "
              "does not, null where nothing has settled", True),
        Field("after", pa.int64(), "1", "turns of the crank that the start was watched for"),
        Field("mean_speed", pa.float64(), "m/s", "mean speed of the settled body, forward positive; NaN where nothing "
              "has settled"),
        Field("states", NUMBERS, "1", "states of the settled motion at the cut, one after the other, in crank radii "
              "and crank radii times motor speed; of a dc motor see `vibro_ros.orbits.turn_map`"),
        Field("error", pa.string(), "1", "why the start leads nowhere; else null", True)]
    dimension = len(coordinates(design.scene))

    def are_own(numbers: Sequence[int], rows: list[dict]) -> bool:
        return are(rows, [design.starts.start(number) for number in numbers]) and all(
            len(row["states"]) == dimension * _kept_states(row["turns"]) for row in rows)

    return Study("starts", design.document(), fields, partial(rows_of, design), are_own, design.run_time,
                 (design.scene["solver.method"],), design.starts.count, BLOCK_ROWS)
