"""Where starts lead: pieces of starts, each judged for itself, by whoever gets them."""

import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.recurrence import SettledMotion, settle
from vibro_ros.orbits.stroboscope import Stroboscope
from vibro_ros.orbits.turn_map import TurnMap
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.basins.design import Design
from vibro_ros.study.basins.starts import Starts
from vibro_ros.study.running.pieces import Piece

#: Starts of a piece: together some hundredths of a second of work.
PIECE = 64
#: States that tell the motion of a start which is not periodic.
KEPT_STATES = 16
#: How the error of a start begins that cannot be, such as a mass beyond its rigid plate.
NO_START = "no such start: "


@dataclass(frozen=True)
class Rows:
    """Where the starts of a piece lead.

    Attributes
    ----------
    turns : list of int or None
        Turns after which the motion repeats itself; 0 where it does not, None where nothing has settled.
    after : list of int
        Turns that the start was watched for.
    mean_speed : list of float
        Of the settled body [m/s]; NaN where nothing has settled.
    states : list of ndarray, shape (m, n)
        In units of the machine: one state of the orbit, `KEPT_STATES` of a motion that does not repeat itself, none
        where nothing has settled.
    errors : list of str or None
        Why a start leads nowhere.
    """

    turns: list[int | None]
    after: list[int]
    mean_speed: list[float]
    states: list[np.ndarray]
    errors: list[str | None]

    def __len__(self) -> int:
        return len(self.after)


@dataclass(frozen=True)
class Work:
    """What is done with every piece; a callable, which other processes get as it is.

    Attributes
    ----------
    scene : Scene
        What starts.
    phase : float
        Crank angle at the cut [rad].
    starts : Starts
        All starts.
    turns, most_turns : int
        See `Design`.
    run_time : float
        Robot time of a start [s].
    """

    scene: Scene
    phase: float
    starts: Starts
    turns: int
    most_turns: int
    run_time: float
    study = "basins"

    def __call__(self, piece: Piece) -> Rows:
        """Let the starts of a piece settle."""
        stroboscope = stroboscope_of(self.scene, self.phase)
        found = Rows([], [], [], [], [])
        for number in piece.starts:
            self._add(found, stroboscope, self.starts.start(number or 0))
        return found

    def _add(self, found: Rows, stroboscope: Stroboscope, start: dict[str, float]) -> None:
        motion, after, error = None, self.most_turns, None
        try:
            stroboscope.begin_as(**start)
            motion = settle(stroboscope, self.turns, self.most_turns)
        except ValueError as refused:
            after, error = 0, f"{NO_START}{refused}"
        except SimulationError as failed:
            after, error = 0, str(failed)
        found.turns.append(motion.turns if motion else None)
        found.after.append(motion.after if motion else after)
        found.mean_speed.append(motion.mean_speed if motion else math.nan)
        found.states.append(_kept(motion) if motion else np.empty((0, len(stroboscope.turn_map.names))))
        found.errors.append(error)


def _kept(motion: SettledMotion) -> np.ndarray:
    """The states that tell a motion, shape (m, n)."""
    return motion.states[-1:] if motion.turns else motion.states[::len(motion.states) // KEPT_STATES]


def stroboscope_of(scene: Scene, phase: float) -> Stroboscope:
    """The stroboscope of a scene, the last one again if it is the same: it takes as long to make as a start."""
    return _stroboscope(scene.name, tuple(scene.parameters.items()), phase)


@lru_cache(maxsize=1)
def _stroboscope(name: str, parameters: tuple[tuple[str, Value], ...], phase: float) -> Stroboscope:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ToleranceWarning)  # the command says it once
        return Stroboscope(TurnMap(Scene(name, dict(parameters)), phase))


def work_of(design: Design) -> Work:
    """What is done with every piece of a design."""
    return Work(design.scene, design.phase, design.starts, design.turns, design.most_turns, design.run_time)


def pieces(design: Design, block: int) -> Iterator[Piece]:
    """The pieces of a block, in the order of its starts."""
    rows = design.rows_of_block(block)
    for first in range(rows.start, rows.stop, PIECE):
        yield Piece({"start": first}, tuple(range(first, min(first + PIECE, rows.stop))))
