"""The visits of a diagram: each value's motion begins with the state that the motion at the value before has left.

So a motion is followed as far as it is stable, and where it ends depends on the way: that is hysteresis. The visits
cannot be shared among processes; a visit takes some hundredths of a second, unless nothing settles.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.orbits.recurrence import CLOUD, FIRST_TURNS, SettledMotion, settle
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap
from vibro_ros.simulation.given_state import UNITS
from vibro_ros.study.diagram.design import Design
from vibro_ros.study.running.blocks import Field
from vibro_ros.study.running.runner import Results


@dataclass(frozen=True)
class Visit:
    """What a value's motion has settled to.

    Attributes
    ----------
    number : int
        Of the visit.
    motion : SettledMotion
        Its states in units of the machine.
    settled : bool
        False for a motion that still changes; its states are the last `CLOUD`.
    states : ndarray, shape (m, n)
        The same states in SI units.
    """

    number: int
    motion: SettledMotion
    settled: bool
    states: np.ndarray


def visits(design: Design, missing: Sequence[int], tables: Mapping[int, pa.Table]) -> Results:
    """The visits of the blocks that are `missing`, in order; `tables` has each block by the time the next one begins.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    """
    for block in missing:
        numbers = design.visits_of_block(block)
        left = visits_in(design, tables[block - 1])[-1].states[-1] if block else None
        for number in numbers:
            one = visit(design, number, left)
            left = one.states[-1]
            yield [one]


def visit(design: Design, number: int, left: np.ndarray | None) -> Visit:
    """A visit that begins in the state that the one before has `left`, SI units, shape (n,); or as the scene starts."""
    turn_map = design.map_of(number)
    stroboscope = Stroboscope(turn_map)
    if left is None:
        stroboscope.begin_as()
    else:
        stroboscope.begin(_within_plates(turn_map, left) / turn_map.units)
    motion = settle(stroboscope, FIRST_TURNS, design.most_turns)
    settled = motion is not None
    if motion is None:
        seen = stroboscope.turns(CLOUD)
        speed = float(seen.positions[-1] - seen.positions[0]) / ((CLOUD - 1) * turn_map.period)
        motion = SettledMotion(0, seen.states, speed, design.most_turns + CLOUD)
    return Visit(number, motion, settled, motion.states * turn_map.units)


def _within_plates(turn_map: TurnMap, state: np.ndarray) -> np.ndarray:
    """The state with each mass on its rigid plate that has moved into it since the value before."""
    scene, moved = turn_map.scene, state.copy()
    for side in scene.plates:
        if scene[f"effects.{side}_contact"] == "restitution":
            place = turn_map.names.index(f"{side}_position")
            moved[place] = min(moved[place], scene[f"crank.{side}_rod"] + scene[f"{side}.gap"])
    return moved


def fields_of(design: Design) -> list[Field]:
    """The columns of the visits' files, in which every state is a row."""
    parameter = BY_NAME[design.axis.name]
    return [
        Field("visit", pa.int64(), "1", "number of the visit"),
        Field("direction", pa.string(), "1", "whether the values went up or down"),
        Field(parameter.name, pa.float64(), parameter.unit or "1", parameter.description),
        Field("period", pa.int64(), "1", "turns of the crank after which the motion repeats itself; 0: it does not"),
        Field("settled", pa.bool_(), "1", "false: the motion still changes"),
        Field("after", pa.int64(), "1", "turns that the motion was watched for"),
        Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
        Field("cut", pa.int64(), "1", "number of the turn"),
        *(Field(name, pa.float64(), UNITS[name], f"at the crank angle {design.phase:.17g}") for name in design.names)]


def rows_of(design: Design, one: Visit) -> list[dict]:
    """The rows of a visit, one a state."""
    about = {"visit": one.number, "direction": design.direction(one.number),
             design.axis.name: design.value(one.number), "period": one.motion.turns, "settled": one.settled,
             "after": one.motion.after, "mean_speed": one.motion.mean_speed}
    return [{**about, "cut": cut, **dict(zip(design.names, state, strict=True))}
            for cut, state in enumerate(one.states.tolist())]


def visits_in(design: Design, table: pa.Table) -> list[Visit]:
    """The visits that a block's table holds."""
    columns = {name: table[name].to_numpy() for name in ("visit", "period", "settled", "after", "mean_speed",
                                                         *design.names)}
    found = []
    for number in dict.fromkeys(columns["visit"].tolist()):
        rows = np.flatnonzero(columns["visit"] == number)
        states, first = np.column_stack([columns[name][rows] for name in design.names]), rows[0]
        motion = SettledMotion(int(columns["period"][first]), states / design.map_of(number).units,
                               float(columns["mean_speed"][first]), int(columns["after"][first]))
        found.append(Visit(number, motion, bool(columns["settled"][first]), states))
    return found
