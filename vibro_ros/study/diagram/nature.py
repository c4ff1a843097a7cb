"""What kind of motion each visit of a diagram has found: all Lyapunov exponents, and K of the 0-1 test."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pyarrow as pa

from vibro_ros.model.scene import PREFIX
from vibro_ros.orbits.chaos import spectrum_from, spectrum_of_cycle, zero_one_test
from vibro_ros.orbits.recurrence import SAME
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap
from vibro_ros.study.diagram.design import Design
from vibro_ros.study.diagram.visits import Visit
from vibro_ros.study.running.blocks import Field
from vibro_ros.study.running.runner import Piece


def run_time(design: Design) -> float:
    """Robot time of a measurement [s], about: a derivative takes some fifteen turns, each begun in its own state."""
    return (300.0 * design.exponents + design.cuts) * 0.06


def nature_of(design: Design, periods: tuple[int, ...], piece: Piece) -> list[dict]:
    """Measure the visit that a piece has the number of; one row.

    `periods` has the turns after which the motion of each visit repeats itself, or 0.
    """
    turn_map = TurnMap(design.scene.with_parameters(piece.changes), design.phase)
    state = np.array([turn_map.scene[f"{PREFIX}{name}"] for name in turn_map.names]) / turn_map.units
    exponents = spread = np.full(len(state), math.nan)
    if design.exponents and periods[piece.number]:
        spectrum = spectrum_of_cycle(turn_map, _turns_from(turn_map, state, periods[piece.number]))
        exponents, spread = spectrum.exponents, spectrum.spread
    elif design.exponents:
        spectrum = spectrum_from(turn_map, state, design.exponents)
        exponents, spread = spectrum.exponents, spectrum.spread
    chaos = math.nan
    if design.cuts:
        seen = _turns_from(turn_map, state, design.cuts)
        chaos = zero_one_test(seen[:, turn_map.names.index(design.coordinate)], SAME)
    return [{"visit": piece.number, **{f"exponent_{k + 1}": one for k, one in enumerate(exponents.tolist())},
             **{f"spread_{k + 1}": one for k, one in enumerate(spread.tolist())}, "zero_one": chaos}]


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
            yield Piece(number, {design.axis.name: design.value(number), "start.state": "given", **given}, (None,))


def fields_of(design: Design) -> list[Field]:
    """The columns of the measurements, a row a visit."""
    numbers = range(1, len(design.names) + 1)
    return [
        Field("visit", pa.int64(), "1", "number of the visit"),
        *(Field(f"exponent_{k}", pa.float64(), "1/s", "Lyapunov exponent; -inf: the direction is gone within a turn")
          for k in numbers),
        *(Field(f"spread_{k}", pa.float64(), "1/s", "half the width of the exponent's 95 % interval; 0 for a periodic "
                "motion") for k in numbers),
        Field("zero_one", pa.float64(), "1", "K of the 0-1 test: near 0 regular, near 1 chaotic")]
