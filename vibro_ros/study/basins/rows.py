"""Where starts lead: pieces of starts, each judged for itself, by whoever gets them."""

import itertools
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.fatal_shock import Shock, Shocked
from vibro_ros.orbits.recurrence import SettledMotion, number_among, settle
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap, coordinates
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.basins.attractors import UNTOLD
from vibro_ros.study.basins.starts import Design
from vibro_ros.study.running.blocks import NUMBERS, BlockRun, Column, ParquetBlocks
from vibro_ros.study.running.runner import Piece, Runner

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


def rows_of(design: Design, piece: Piece) -> Rows:
    """Let the starts of a piece settle."""
    stroboscope, found = stroboscope_of(design.scene, design.phase), Rows([], [], [], [], [])
    for number in piece.starts:
        motion, after, error = None, design.most_turns, None
        try:
            stroboscope.begin_as(**design.starts.start(number or 0))
            motion = settle(stroboscope, design.turns, design.most_turns)
        except ValueError as refused:
            after, error = 0, f"{NO_START}{refused}"
        except SimulationError as failed:
            after, error = 0, str(failed)
        found.turns.append(motion.turns if motion else None)
        found.after.append(motion.after if motion else after)
        found.mean_speed.append(motion.mean_speed if motion else math.nan)
        found.states.append(_kept(motion) if motion else np.empty((0, len(stroboscope.turn_map.names))))
        found.errors.append(error)
    return found


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


def pieces(design: Design, block: int) -> Iterator[Piece]:
    """The pieces of a block, in the order of its starts."""
    rows = design.rows_of_block(block)
    for first in range(rows.start, rows.stop, PIECE):
        yield Piece({"start": first}, tuple(range(first, min(first + PIECE, rows.stop))))


FOLDER = "blocks"


def settle_starts(design: Design, folder: Path, runner: Runner) -> pa.Table:
    """Where each start leads, a row a start; blocks that are missing in the folder are computed (see `BlockRun.do`)."""
    rows = [len(design.rows_of_block(block)) for block in range(design.blocks)]
    run = BlockRun("starts", Blocks(folder, design), rows)
    run.do(lambda missing: runner(
        partial(rows_of, design), design.run_time, (design.scene["solver.method"],),
        itertools.chain.from_iterable(pieces(design, block) for block in missing)))
    return pa.table(run.whole.columns, schema=run.tables[0].schema.remove_metadata())


class Blocks(ParquetBlocks[Rows]):
    """The files of a design, a row a start."""

    def __init__(self, folder: Path, design: Design):
        super().__init__(folder, design.document(), design.blocks)
        self._design = design

    def columns(self, block: int, found: Sequence[Rows]) -> list[Column]:
        """The columns of a block."""
        starts = [self._design.starts.start(number) for number in self._design.rows_of_block(block)]

        def gathered(name: str, kind: pa.DataType) -> pa.Array:
            return pa.array([value for rows in found for value in getattr(rows, name)], kind)

        states = [state.ravel() for rows in found for state in rows.states]
        return [
            *(Column(one.name, pa.array([start[one.name] for start in starts], pa.float64()), one.unit,
                     "of the start; what is no column is as the scene starts") for one in self._design.starts.over),
            Column("turns", gathered("turns", pa.int64()), "1", "turns of the crank after which the settled motion "
                   "repeats itself; 0 where it does not, null where nothing has settled"),
            Column("after", gathered("after", pa.int64()), "1", "turns of the crank that the start was watched for"),
            Column("mean_speed", gathered("mean_speed", pa.float64()), "m/s", "mean speed of the settled body, forward "
                   "positive; NaN where nothing has settled"),
            Column("states", pa.array(states, NUMBERS), "1", "states of the settled motion at the cut, "
                   "one after the other, in crank radii and crank radii times motor speed"),
            Column("error", gathered("errors", pa.string()), "1", "why the start leads nowhere; else null"),
        ]


SHOCKS_FOLDER = "shocks"
_ALONG = 10  # parts of the tries that each coordinate alone gets


@dataclass(frozen=True)
class Upset:
    """What upsets a motion, in SI units; None where nothing was found.

    Attributes
    ----------
    size : float or None
        Length of the smallest shock, in units of the machine.
    crank_angle : float or None
        Where in a turn it acts [rad].
    change : tuple of float or None
        What it adds to each coordinate [m, m/s].
    leads_to : int or None
        Number of the attractor that follows, or `UNTOLD`.
    alone : tuple of float or None
        The smallest change of each coordinate alone that upsets the motion [m, m/s].
    """

    size: float | None
    crank_angle: float | None
    change: tuple[float | None, ...]
    leads_to: int | None
    alone: tuple[float | None, ...]


def upset_motions(design: Design, motions: tuple[SettledMotion, ...], folder: Path, runner: Runner) -> list[pa.Table]:
    """What upsets each of several motions, a table each; missing ones are computed (see `BlockRun.do`)."""
    run = BlockRun("shocks", ShockBlocks(folder, design, len(motions)), [1] * len(motions))
    run.do(lambda missing: runner(
        partial(upset_of, design, motions), design.shocks * design.run_time, (design.scene["solver.method"],),
        (Piece({"motion": number + 1}, (number,)) for number in missing)))
    return [run.tables[number] for number in range(len(motions))]


def upset_of(design: Design, motions: tuple[SettledMotion, ...], piece: Piece) -> list[Upset]:
    """Shock the motions of a piece, of all `motions` in their order."""
    return [_upset(design, motions, motions[number or 0]) for number in piece.starts]


def _upset(design: Design, motions: tuple[SettledMotion, ...], motion: SettledMotion) -> Upset:
    stroboscope = stroboscope_of(design.scene, design.phase)
    shocked, units = Shocked(stroboscope, motion), stroboscope.turn_map.units.tolist()
    alone = [shocked.along(k, -(-design.shocks // _ALONG)) for k in range(len(units))]
    smallest = min((shock for shock in alone if shock), key=lambda shock: shock.size, default=None)
    best: Shock | None = shocked.anywhere(smallest, design.shocks)
    sizes = tuple(float(shock.change[k] * units[k]) if shock else None for k, shock in enumerate(alone))
    if best is None:
        return Upset(None, None, (None,) * len(units), None, sizes)
    other = number_among(best.leads_to, motions)
    return Upset(best.size, best.crank_angle, tuple((best.change * units).tolist()),
                 UNTOLD if other is None else other + 1, sizes)


class ShockBlocks(ParquetBlocks[list[Upset]]):
    """A file a motion."""

    def __init__(self, folder: Path, design: Design, count: int):
        super().__init__(folder, {**design.document(), "shocks": design.shocks}, count)
        self._names = coordinates(design.scene)

    def columns(self, block: int, found: Sequence[list[Upset]]) -> list[Column]:
        """The columns of a motion's file."""
        upsets = [upset for part in found for upset in part]

        def values(kind: pa.DataType, *each: object) -> pa.Array:
            return pa.array(each, kind)

        numbers, real = [block + 1] * len(upsets), pa.float64()
        return [
            Column("attractor", values(pa.int64(), *numbers), "1", "number of the motion, counted from 1"),
            Column("size", values(real, *(one.size for one in upsets)), "1", "length of the smallest shock found, in "
                   "crank radii and crank radii times motor speed; null where none changes the motion"),
            Column("crank_angle", values(real, *(one.crank_angle for one in upsets)), "rad", "where the shock acts"),
            Column("leads_to", values(pa.int64(), *(one.leads_to for one in upsets)), "1", "number of the motion that "
                   "follows"),
            *(Column(f"change.{name}", values(real, *(one.change[k] for one in upsets)), UNITS[name],
                     "what the shock adds") for k, name in enumerate(self._names)),
            *(Column(f"alone.{name}", values(real, *(one.alone[k] for one in upsets)), UNITS[name], "smallest change "
                     "of this coordinate alone that changes the motion") for k, name in enumerate(self._names)),
        ]
