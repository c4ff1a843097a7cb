"""Where starts lead: pieces of starts, each judged for itself, by whoever gets them."""

import itertools
import math
import warnings
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import Value
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.fatal_shock import Shocked
from vibro_ros.orbits.recurrence import SettledMotion, number_among, settle
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap, coordinates
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.basins.attractors import UNTOLD
from vibro_ros.study.basins.starts import Design
from vibro_ros.study.running.blocks import NUMBERS, BlockRun, Field, ParquetBlocks
from vibro_ros.study.running.runner import Piece, Runner

#: Starts of a piece: together some hundredths of a second of work.
PIECE = 64
#: States that tell the motion of a start which is not periodic.
KEPT_STATES = 16
#: How the error of a start begins that cannot be, such as a mass beyond its rigid plate.
NO_START = "no such start: "


def rows_of(design: Design, piece: Piece) -> list[dict]:
    """Let the starts of a piece settle; a row a start."""
    stroboscope = stroboscope_of(design.scene, design.phase)
    rows: list[dict] = []
    for number in piece.starts:
        start = design.starts.start(number or 0)
        motion, after, error = None, design.most_turns, None
        try:
            stroboscope.begin_as(**start)
            motion = settle(stroboscope, design.turns, design.most_turns)
        except ValueError as refused:
            after, error = 0, f"{NO_START}{refused}"
        except SimulationError as failed:
            after, error = 0, str(failed)
        rows.append({
            **start, "turns": motion.turns if motion else None, "after": motion.after if motion else after,
            "mean_speed": motion.mean_speed if motion else math.nan,
            "states": _kept(motion).ravel() if motion else [], "error": error})
    return rows


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
        yield Piece(first, {}, tuple(range(first, min(first + PIECE, rows.stop))))


FOLDER = "blocks"


def settle_starts(design: Design, folder: Path, runner: Runner) -> pa.Table:
    """Where each start leads, a row a start; blocks that are missing in the folder are computed (see `BlockRun.do`)."""
    fields = [
        *(Field(one.name, pa.float64(), one.unit, "of the start; other coordinates are as the scene starts")
          for one in design.starts.over),
        Field("turns", pa.int64(), "1", "turns of the crank after which the settled motion repeats itself; 0 where it "
              "does not, null where nothing has settled"),
        Field("after", pa.int64(), "1", "turns of the crank that the start was watched for"),
        Field("mean_speed", pa.float64(), "m/s", "mean speed of the settled body, forward positive; NaN where nothing "
              "has settled"),
        Field("states", NUMBERS, "1", "states of the settled motion at the cut, one after the other, in crank radii "
              "and crank radii times motor speed"),
        Field("error", pa.string(), "1", "why the start leads nowhere; else null")]
    blocks = ParquetBlocks(folder, design.document(), design.blocks, fields)
    run = BlockRun("starts", blocks, [len(design.rows_of_block(block)) for block in range(design.blocks)])
    run.do(lambda missing: runner(
        partial(rows_of, design), design.run_time, (design.scene["solver.method"],),
        itertools.chain.from_iterable(pieces(design, block) for block in missing)))
    return run.whole


SHOCKS_FOLDER = "shocks"
_ALONG = 10  # parts of the tries that each coordinate alone gets


def upset_motions(design: Design, motions: tuple[SettledMotion, ...], folder: Path, runner: Runner) -> list[pa.Table]:
    """What upsets each of several motions, a table each; missing ones are computed (see `BlockRun.do`)."""
    names, real = coordinates(design.scene), pa.float64()
    fields = [
        Field("attractor", pa.int64(), "1", "number of the motion, counted from 1"),
        Field("size", real, "1", "length of the smallest shock found, in crank radii and crank radii times motor "
              "speed; null where none changes the motion"),
        Field("crank_angle", real, "rad", "where the shock acts"),
        Field("leads_to", pa.int64(), "1", "number of the motion that follows"),
        *(Field(f"change.{name}", real, UNITS[name], "what the shock adds") for name in names),
        *(Field(f"alone.{name}", real, UNITS[name], "smallest change of this coordinate alone that changes the motion")
          for name in names)]
    blocks = ParquetBlocks(folder, {**design.document(), "shocks": design.shocks}, len(motions), fields)
    run = BlockRun("shocks", blocks, [1] * len(motions))
    run.do(lambda missing: runner(
        partial(upset_of, design, motions), design.shocks * design.run_time, (design.scene["solver.method"],),
        (Piece(number, {}, (None,)) for number in missing)))
    return [run.tables[number] for number in range(len(motions))]


def upset_of(design: Design, motions: tuple[SettledMotion, ...], piece: Piece) -> list[dict]:
    """Shock the motion that a piece has the number of, among all; one row, whose shock is null if none was found."""
    stroboscope = stroboscope_of(design.scene, design.phase)
    shocked, units = Shocked(stroboscope, motions[piece.number]), stroboscope.turn_map.units
    names = stroboscope.turn_map.names
    alone = [shocked.along(k, -(-design.shocks // _ALONG)) for k in range(len(units))]
    smallest = min((shock for shock in alone if shock), key=lambda shock: shock.size, default=None)
    best = shocked.anywhere(smallest, design.shocks)
    row = {"attractor": piece.number + 1, **{f"alone.{name}": float(shock.change[k] * units[k]) if shock else None
                                             for k, (name, shock) in enumerate(zip(names, alone, strict=True))}}
    if best is not None:
        other = number_among(best.leads_to, motions)
        row |= {"size": best.size, "crank_angle": best.crank_angle, "leads_to": UNTOLD if other is None else other + 1}
        row |= {f"change.{name}": one for name, one in zip(names, (best.change * units).tolist(), strict=True)}
    return [row]
