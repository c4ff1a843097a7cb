"""What upsets each motion: the smallest shocks, found by whoever gets a motion, and kept in a file each."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.fatal_shock import Shock, Shocked
from vibro_ros.orbits.recurrence import SettledMotion, number_among
from vibro_ros.orbits.turn_map import coordinates
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.study.basins.attractors import UNTOLD
from vibro_ros.study.basins.design import Design
from vibro_ros.study.basins.rows import stroboscope_of
from vibro_ros.study.running.parquet_blocks import Column, ParquetBlocks, has_columns
from vibro_ros.study.running.pieces import Piece

FOLDER = "shocks"
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


@dataclass(frozen=True)
class ShockWork:
    """What is done with every attractor; a callable, which other processes get as it is.

    Attributes
    ----------
    scene : Scene
        What moves.
    phase : float
        Crank angle at the cut [rad].
    motions : tuple of SettledMotion
        All attractors, in their order.
    tries : int
        Shocks that are tried in any direction.
    run_time : float
        Robot time of a motion's shocks [s], about.
    """

    scene: Scene
    phase: float
    motions: tuple[SettledMotion, ...]
    tries: int
    run_time: float
    study = "basins"

    def __call__(self, piece: Piece) -> list[Upset]:
        """Shock the motions of a piece."""
        return [self._upset(self.motions[number or 0]) for number in piece.starts]

    def _upset(self, motion: SettledMotion) -> Upset:
        shocked = Shocked(stroboscope_of(self.scene, self.phase), motion)
        units = stroboscope_of(self.scene, self.phase).turn_map.units.tolist()
        alone = [shocked.along(k, -(-self.tries // _ALONG)) for k in range(len(units))]
        smallest = min((shock for shock in alone if shock), key=lambda shock: shock.size, default=None)
        best: Shock | None = shocked.anywhere(smallest, self.tries)
        sizes = tuple(float(shock.change[k] * units[k]) if shock else None for k, shock in enumerate(alone))
        if best is None:
            return Upset(None, None, (None,) * len(units), None, sizes)
        other = number_among(best.leads_to, self.motions)
        return Upset(best.size, best.crank_angle, tuple((best.change * units).tolist()),
                     UNTOLD if other is None else other + 1, sizes)


class ShockBlocks(ParquetBlocks[list[Upset]]):
    """A file a motion.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    design : Design
        What was run.
    count : int
        Motions.
    """

    def __init__(self, folder: Path, design: Design, count: int):
        super().__init__(folder, "basins", {**design.document(), "shocks": design.shocks}, count)
        self._names = coordinates(design.scene)

    def is_own(self, block: int, table: pa.Table) -> bool:
        """Whether a file tells of its one motion a whole shock, or none."""
        if len(table) != 1 or not has_columns(table, self.columns(block, [])):
            return False
        row = table.to_pylist()[0]
        shock = [value for name, value in row.items() if name != "attractor" and not name.startswith("alone.")]
        whole = all(value is None for value in shock) or (
            None not in shock and (row["leads_to"] == UNTOLD or 1 <= row["leads_to"] <= self._count))
        return whole and row["attractor"] == block + 1

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
