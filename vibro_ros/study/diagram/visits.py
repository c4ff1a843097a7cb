"""The visits of a diagram: each value's motion begins with the state that the motion at the value before has left.

So a motion is followed as far as it is stable, and where it ends depends on the way: that is hysteresis. The visits
cannot be shared among processes; a visit takes some hundredths of a second, unless nothing settles.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import pyarrow as pa

from vibro_ros.model.parameters import BY_NAME
from vibro_ros.model.scene import Scene
from vibro_ros.orbits.chaos import LEAST_TURNS, spectrum_of_cycle, spectrum_until_known, zero_one_test
from vibro_ros.orbits.chaos import LEAST_VALUES as LEAST_CUTS
from vibro_ros.orbits.chaos import MOST_TURNS as MOST_MEASURED
from vibro_ros.orbits.recurrence import CLOUD, FIRST_TURNS, LONGEST_PERIOD, SettledMotion, settle, tolerance_of
from vibro_ros.orbits.turn_map import Stroboscope, TurnMap, coordinates, is_sampled, pace, units_of
from vibro_ros.simulation.given_state import STATE_UNITS
from vibro_ros.study.execution import Execution, Results
from vibro_ros.study.table import Field, Study, are, computed, read, stored
from vibro_ros.study.variation import Axis, whole_number

UP, DOWN = "up", "down"
#: Most turns that a motion may be given to settle.
MOST_SETTLING = 1_000_000
_BLOCK = 8  # visits of a block: what an interruption can lose
# Periods that the 0-1 test hears: K of a motion that repeats itself every 158 turns is 0.98 after 6, and 0.10 after 50.
_PERIODS = 50


@dataclass(frozen=True)
class Design:
    """A diagram, checked.

    Attributes
    ----------
    scene : Scene
        What is varied, and how it starts at the first value.
    axis : Axis
        The parameter and its values, ascending.
    phase : float
        Crank angle [rad] at which the states are seen.
    coordinate : str
        Of the state, which the picture shows and the 0-1 test hears.
    most_turns : int
        Turns of the crank that a motion has to settle.
    exponents, cuts : int
        Turns over which Lyapunov exponents are measured, and cuts that the 0-1 test hears; 0 for neither.

    Raises
    ------
    ValueError
        For what contradicts itself or is too much; one line that names the remedy.
    """

    scene: Scene
    axis: Axis
    phase: float
    coordinate: str
    most_turns: int
    exponents: int
    cuts: int

    def __post_init__(self) -> None:
        whole_number("--most-turns", self.most_turns, FIRST_TURNS, MOST_SETTLING)
        if self.exponents:
            whole_number("--exponents (0: none)", self.exponents, LEAST_TURNS, MOST_MEASURED)
        if self.cuts:
            whole_number("--cuts (0: none)", self.cuts, LEAST_CUTS, MOST_MEASURED)
        for value in self.axis.values:
            try:
                scene = self.scene_at(value)
            except ValueError as error:
                raise ValueError(f"--vary {self.axis.name}: at {value:g} there is no scene ({error})") from error
            pace(scene)  # refuses a crank that stands
            if self.exponents and is_sampled(scene):
                raise ValueError(f"--exponents {self.exponents}: motor.control {scene['motor.control']} takes samples, "
                                 "with which the turns are not in step, so that the map of a turn has no derivative; "
                                 "give --exponents 0")
            if coordinates(scene) != self.names:
                raise ValueError(f"--vary {self.axis.name}: at {value:g} the state has other coordinates than at "
                                 f"{self.axis.values[0]:g}; leave that value out")
        if self.coordinate not in self.names:
            raise ValueError(f"--coordinate {self.coordinate}: is none of the state; choose one of "
                             f"{', '.join(self.names)}")

    @property
    def names(self) -> tuple[str, ...]:
        """The state's coordinates, fields of `Samples`."""
        return coordinates(self.scene_at(self.axis.values[0]))

    @property
    def visits(self) -> int:
        """Values, up and down."""
        return 2 * len(self.axis.values)

    def direction(self, visit: int) -> str:
        """`UP` or `DOWN`."""
        return UP if visit < len(self.axis.values) else DOWN

    def place(self, visit: int) -> int:
        """Place of the visited value among the values."""
        return min(visit, self.visits - 1 - visit)

    def value(self, visit: int) -> float:
        """The visited value, in the parameter's unit."""
        return float(self.axis.values[self.place(visit)])

    def scene_at(self, value: object) -> Scene:
        """The scene at a value (ValueError where it is none)."""
        return self.scene.with_parameters({self.axis.name: value})

    def map_of(self, visit: int) -> TurnMap:
        """The turn map at a visit."""
        return TurnMap(self.scene_at(self.value(visit)), self.phase)

    def document(self) -> dict[str, object]:
        """All that decides what is found, as JSON has it."""
        fixed = {name: value for name, value in self.scene.parameters.items() if name != self.axis.name}
        return {"scene": self.scene.name, "set": fixed, "vary": {self.axis.name: self.axis.document()},
                "phase": self.phase, "coordinate": self.coordinate, "most_turns": self.most_turns,
                "exponents": self.exponents, "cuts": self.cuts}


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


def visited(design: Design, folder: Path) -> tuple[pa.Table, tuple[Visit, ...]]:
    """All visits, and their states as a table; blocks that are missing in the folder are computed.

    Raises
    ------
    SimulationError
        If a run cannot go on.
    """
    parameter = BY_NAME[design.axis.name]
    fields = [
        Field("visit", pa.int64(), "1", "number of the visit"),
        Field("direction", pa.string(), "1", "whether the values went up or down"),
        Field(parameter.name, pa.float64(), parameter.unit or "1", parameter.description),
        Field("period", pa.int64(), "1", "turns of the crank after which the motion repeats itself; 0: none up "
              f"to {LONGEST_PERIOD}"),
        Field("settled", pa.bool_(), "1", "false: the motion still changes"),
        Field("after", pa.int64(), "1", "turns that the motion was watched for"),
        Field("mean_speed", pa.float64(), "m/s", "of the body, forwards positive"),
        Field("cut", pa.int64(), "1", "number of the turn"),
        *(Field(name, pa.float64(), STATE_UNITS[name], f"at the crank angle {design.phase:.17g}")
          for name in design.names)]

    def are_own(numbers: Sequence[int], rows: list[dict]) -> bool:
        own = []
        for number in numbers:
            of_visit = [row for row in rows if row["visit"] == number]
            period = of_visit[0]["period"]
            own += [{"visit": number, "direction": design.direction(number), design.axis.name: design.value(number),
                     "period": period, "cut": cut} for cut in range(period or CLOUD)]
        return are(rows, own)

    def visits(numbers: Iterable[int]) -> Results:
        left, last = None, -1
        for number in numbers:
            if number and last != number - 1:
                block = number // _BLOCK - 1
                before = cast(pa.Table, read(study, folder, block, study.points(block)))
                left = _visits_in(design, before)[-1].states[-1]
            one = _visit(design, number, left if number else None)
            left, last = one.states[-1], number
            yield _rows_of(design, one)

    study = Study("values", design.document(), fields, lambda number: [], are_own, 0.0, (), design.visits, _BLOCK)
    blocks = {block: study.points(block) for block in range(study.blocks)}
    tables = stored(study, folder, blocks, visits)
    whole = pa.concat_tables([tables[block].replace_schema_metadata() for block in blocks])
    return whole, tuple(_visits_in(design, whole))


def _visit(design: Design, number: int, left: np.ndarray | None) -> Visit:
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
        speed = float((seen.positions[-1] - seen.positions[0]) / (seen.times[-1] - seen.times[0]))
        motion = SettledMotion(0, seen.states, speed, design.most_turns + CLOUD, tolerance_of(turn_map.scene))
    return Visit(number, motion, settled, motion.states * turn_map.units)


def _within_plates(turn_map: TurnMap, state: np.ndarray) -> np.ndarray:
    """The state with each mass on its rigid plate that has moved into it since the value before."""
    scene, moved = turn_map.scene, state.copy()
    for side in scene.plates:
        if scene[f"effects.{side}_contact"] == "restitution":
            place = turn_map.names.index(f"{side}_position")
            moved[place] = min(moved[place], scene[f"crank.{side}_rod"] + scene[f"{side}.gap"])
    return moved


def _rows_of(design: Design, one: Visit) -> list[dict]:
    """The rows of a visit, one a state."""
    about = {"visit": one.number, "direction": design.direction(one.number),
             design.axis.name: design.value(one.number), "period": one.motion.turns, "settled": one.settled,
             "after": one.motion.after, "mean_speed": one.motion.mean_speed}
    return [{**about, "cut": cut, **dict(zip(design.names, state, strict=True))}
            for cut, state in enumerate(one.states.tolist())]


def _visits_in(design: Design, table: pa.Table) -> list[Visit]:
    """The visits that a block's table holds."""
    columns = {name: table[name].to_numpy() for name in ("visit", "period", "settled", "after", "mean_speed",
                                                         *design.names)}
    found = []
    for number in dict.fromkeys(columns["visit"].tolist()):
        rows = np.flatnonzero(columns["visit"] == number)
        states, first = np.column_stack([columns[name][rows] for name in design.names]), rows[0]
        scene = design.scene_at(design.value(number))
        motion = SettledMotion(int(columns["period"][first]), states / units_of(scene),
                               float(columns["mean_speed"][first]), int(columns["after"][first]), tolerance_of(scene))
        found.append(Visit(number, motion, bool(columns["settled"][first]), states))
    return found


def nature_of(design: Design, settled: tuple[tuple[int, np.ndarray], ...], number: int) -> list[dict]:
    """Measure the visit of a number: all Lyapunov exponents, and K of the 0-1 test; one row.

    `settled` has of each visit the turns after which its motion repeats itself, or 0, and its last state in SI units.
    """
    turn_map = design.map_of(number)
    turns, state = settled[number][0], settled[number][1] / turn_map.units
    exponents = spread = np.full(len(state), math.nan)
    if design.exponents:
        spectrum = (spectrum_of_cycle(turn_map, _turns_from(turn_map, state, turns)) if turns else
                    spectrum_until_known(turn_map, state, design.exponents))
        exponents, spread = spectrum.exponents, spectrum.spread
        turns = turns or (0 if spread.any() else spectrum.turns)
    chaos = math.nan
    if design.cuts:
        seen = _turns_from(turn_map, state, max(design.cuts, _PERIODS * turns))
        chaos = zero_one_test(seen[:, turn_map.names.index(design.coordinate)],
                              tolerance_of(turn_map.scene))
    return [{"visit": number, "period": turns,
             **{f"exponent_{k + 1}": one for k, one in enumerate(exponents.tolist())},
             **{f"spread_{k + 1}": one for k, one in enumerate(spread.tolist())}, "zero_one": chaos}]


def _turns_from(turn_map: TurnMap, state: np.ndarray, turns: int) -> np.ndarray:
    stroboscope = Stroboscope(turn_map)
    stroboscope.begin(state)
    return stroboscope.turns(turns).states


def measured(design: Design, seen: Sequence[Visit], folder: Path, execution: Execution) -> pa.Table:
    """What kind of motion each visit has found, a row each; blocks that are missing in the folder are measured."""
    numbers = range(1, len(design.names) + 1)
    fields = [
        Field("visit", pa.int64(), "1", "number of the visit"),
        Field("period", pa.int64(), "1", "turns after which the motion repeats itself, also many; 0: none found"),
        *(Field(f"exponent_{k}", pa.float64(), "1/s", "Lyapunov exponent; -inf: the direction is gone within a turn")
          for k in numbers),
        *(Field(f"spread_{k}", pa.float64(), "1/s", "half the width of the exponent's 95 % interval; 0 for a periodic "
                "motion") for k in numbers),
        Field("zero_one", pa.float64(), "1", "K of the 0-1 test: near 0 regular, near 1 chaotic")]
    # Robot time [s], about: a derivative takes some fifteen turns, each begun in its own state.
    run_time = (300.0 * design.exponents + design.cuts) * 0.06
    settled = tuple((one.motion.turns, one.states[-1]) for one in seen)
    return computed(Study(
        "motions measured", design.document(), fields, partial(nature_of, design, settled),
        lambda own, rows: are(rows, [{"visit": number} for number in own]), run_time, (design.scene["solver.method"],),
        design.visits, _BLOCK), folder, execution)
