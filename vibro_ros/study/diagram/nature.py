"""What kind of motion each visit of a diagram has found: all Lyapunov exponents, and K of the 0-1 test."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from vibro_ros.model.scene import PREFIX
from vibro_ros.orbits.chaos import spectrum_from, spectrum_of_cycle, zero_one_test
from vibro_ros.orbits.recurrence import SAME
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap
from vibro_ros.study.diagram.design import Design
from vibro_ros.study.diagram.visits import Visit
from vibro_ros.study.running.blocks import Column, ParquetBlocks
from vibro_ros.study.running.runner import Piece


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


def run_time(design: Design) -> float:
    """Robot time of a measurement [s], about: a derivative takes some fifteen turns, each begun in its own state."""
    return (300.0 * design.exponents + design.cuts) * 0.06


def nature_of(design: Design, periods: tuple[int, ...], piece: Piece) -> Nature:
    """Measure the visit of a piece; `periods` has the turns after which each visit's motion repeats itself, or 0."""
    number, = piece.starts
    assert number is not None
    turn_map = TurnMap(design.scene.with_parameters(piece.changes), design.phase)
    state = np.array([turn_map.scene[f"{PREFIX}{name}"] for name in turn_map.names]) / turn_map.units
    exponents = spread = np.full(len(state), math.nan)
    if design.exponents and periods[number]:
        spectrum = spectrum_of_cycle(turn_map, _turns_from(turn_map, state, periods[number]))
        exponents, spread = spectrum.exponents, spectrum.spread
    elif design.exponents:
        spectrum = spectrum_from(turn_map, state, design.exponents)
        exponents, spread = spectrum.exponents, spectrum.spread
    chaos = math.nan
    if design.cuts:
        seen = _turns_from(turn_map, state, design.cuts)
        chaos = zero_one_test(seen[:, turn_map.names.index(design.coordinate)], SAME)
    return Nature(number, exponents, spread, chaos)


def _turns_from(turn_map: TurnMap, state: np.ndarray, turns: int) -> np.ndarray:
    stroboscope = Stroboscope(turn_map)
    stroboscope.begin(state)
    return stroboscope.turns(turns).states


def pieces(design: Design, found: Sequence[Visit], blocks: Sequence[int]) -> Iterator[Piece]:
    """Each visit of the blocks as a piece, which begins in the last state of the visit."""
    for block in blocks:
        for number in design.visits_of_block(block):
            given = {f"{PREFIX}{name}": float(value)
                     for name, value in zip(design.names, found[number].states[-1], strict=True)}
            yield Piece({design.axis.name: design.value(number), "start.state": "given", **given}, (number,))


class NatureBlocks(ParquetBlocks[Nature]):
    """The files of the measurements, a row a visit."""

    def __init__(self, folder: Path, design: Design):
        super().__init__(folder, design.document(), design.blocks)
        self._design = design

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
