"""What kind of motion each visit of a diagram has found: all Lyapunov exponents, and K of the 0-1 test."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from vibro_ros.model.scene import PREFIX, Scene
from vibro_ros.orbits.lyapunov_spectrum import spectrum_from, spectrum_of_cycle
from vibro_ros.orbits.recurrence import SAME
from vibro_ros.orbits.stroboscope import Stroboscope
from vibro_ros.orbits.turn_map import TurnMap
from vibro_ros.orbits.zero_one import zero_one_test
from vibro_ros.study.diagram.chain import Visit
from vibro_ros.study.diagram.design import Design
from vibro_ros.study.running.parquet_blocks import Column, ParquetBlocks
from vibro_ros.study.running.pieces import Piece


@dataclass(frozen=True)
class Nature:
    """What was measured of a visit's motion.

    Attributes
    ----------
    number : int
        Of the visit.
    exponents, spread : ndarray, shape (n,)
        As `LyapunovSpectrum` has them [1/s]; NaN where none were asked for.
    chaos : float
        K of `zero_one_test`, dimensionless; NaN where it was not asked for.
    """

    number: int
    exponents: np.ndarray
    spread: np.ndarray
    chaos: float

    def __len__(self) -> int:
        """One visit, as whoever counts them has it."""
        return 1


@dataclass(frozen=True)
class NatureWork:
    """What is done with each visit; a callable, which other processes get as it is.

    Attributes
    ----------
    scene : Scene
        What is varied.
    phase : float
        Crank angle at the cut [rad].
    coordinate : str
        What the 0-1 test hears.
    exponents, cuts : int
        Turns of the one measurement and of the other; 0: not at all.
    periods : tuple of int
        Turns after which each visit's motion repeats itself; 0: it does not.
    """

    scene: Scene
    phase: float
    coordinate: str
    exponents: int
    cuts: int
    periods: tuple[int, ...]

    study = "diagram"

    @property
    def run_time(self) -> float:
        """Robot time of a visit [s], about: a derivative takes some fifteen turns, each put into a state of its own."""
        return (300.0 * self.exponents + self.cuts) * 0.06

    def __call__(self, piece: Piece) -> Nature:
        """Measure a visit."""
        number, = piece.starts
        assert number is not None
        turn_map = TurnMap(self.scene.with_parameters(piece.changes), self.phase)
        state = np.array([turn_map.scene[f"{PREFIX}{name}"] for name in turn_map.names]) / turn_map.units
        nothing = np.full(len(state), math.nan)
        exponents, spread = self._spectrum(turn_map, state, self.periods[number]) if self.exponents else (
            nothing, nothing)
        return Nature(number, exponents, spread, self._chaos(turn_map, state) if self.cuts else math.nan)

    def _spectrum(self, turn_map: TurnMap, state: np.ndarray, period: int) -> tuple[np.ndarray, np.ndarray]:
        if not period:
            found = spectrum_from(turn_map, state, self.exponents)
        else:
            stroboscope = Stroboscope(turn_map)
            stroboscope.begin(state)
            found = spectrum_of_cycle(turn_map, stroboscope.turns(period).states)
        return found.exponents, found.spread

    def _chaos(self, turn_map: TurnMap, state: np.ndarray) -> float:
        stroboscope = Stroboscope(turn_map)
        stroboscope.begin(state)
        return zero_one_test(stroboscope.turns(self.cuts).states[:, turn_map.names.index(self.coordinate)], SAME)


def nature_work(design: Design, found: Sequence[Visit]) -> NatureWork:
    """What is done with each visit of a design, all of which are `found`."""
    return NatureWork(design.scene, design.phase, design.coordinate, design.exponents, design.cuts,
                      tuple(one.motion.turns for one in found))


def pieces(design: Design, found: Sequence[Visit], blocks: Sequence[int]) -> Iterator[Piece]:
    """Each visit of the blocks as a piece, which begins in the last state of the visit."""
    for block in blocks:
        for number in design.visits_of_block(block):
            given = {f"{PREFIX}{name}": float(value)
                     for name, value in zip(design.names, found[number].states[-1], strict=True)}
            yield Piece({design.axis.name: design.value(number), "start.state": "given", **given}, (number,))


class NatureBlocks(ParquetBlocks[Nature]):
    """The files of what was measured, a row a visit.

    Parameters
    ----------
    folder : Path
        Where they are; it exists.
    design : Design
        What they hold.
    """

    def __init__(self, folder, design: Design):
        super().__init__(folder, "diagram", design.document(), design.blocks)
        self._design = design

    def is_own(self, block: int, table: pa.Table) -> bool:
        """Whether the rows can be what was measured of the visits of this block."""
        try:
            found = natures_in(self._design, table)
            asked = [one.number for one in found] == list(self._design.visits_of_block(block))
            return asked and self.is_of(block, table, found)
        except (LookupError, TypeError, ValueError, OverflowError):
            return False

    def columns(self, block: int, found: Sequence[Nature]) -> list[Column]:
        """See `ParquetBlocks`."""
        numbers = range(len(self._design.names))
        return [
            Column("visit", pa.array([one.number for one in found], pa.int64()), "1", "number of the visit"),
            *(Column(f"exponent_{k + 1}", pa.array([float(one.exponents[k]) for one in found], pa.float64()), "1/s",
                     "Lyapunov exponent; -inf: the direction is gone within a turn") for k in numbers),
            *(Column(f"spread_{k + 1}", pa.array([float(one.spread[k]) for one in found], pa.float64()), "1/s",
                     "half the width of the exponent's 95 % interval; 0 for a periodic motion") for k in numbers),
            Column("zero_one", pa.array([one.chaos for one in found], pa.float64()), "1",
                   "K of the 0-1 test: near 0 regular, near 1 chaotic")]


def natures_in(design: Design, table: pa.Table) -> list[Nature]:
    """What a block's table holds."""
    exponents, spread = (np.column_stack([table[f"{what}_{k + 1}"].to_numpy() for k in range(len(design.names))])
                         for what in ("exponent", "spread"))
    return [Nature(number, exponents[row], spread[row], chaos) for row, (number, chaos) in enumerate(
        zip(table["visit"].to_pylist(), table["zero_one"].to_pylist(), strict=True))]
