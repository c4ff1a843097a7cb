"""The tables of guards, of the modes that may follow, and of the jumps on the way.

A guard has numbers, which are its forms and jumps, and places in the tables. The places are the same in all scenes of a
sweep, as long as the guards lead to the same states and have equal forms in the same places. So the places are found
once for the guards' *outlines*, which are guards with numbers of rows and matrices instead of forms and jumps.
"""

import functools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from vibro_ros.model.automaton import Guard, Target
from vibro_ros.model.forms import Form, Forms
from vibro_ros.model.mode_set import ModeSet
from vibro_ros.model.modes import ModeBuilder
from vibro_ros.solver.system import NOTHING, UNCHECKED, terms


def guard_tables(builder: ModeBuilder) -> dict[str, np.ndarray]:
    """Fields of `System` for guards, their candidates and the jumps on the way; equal forms share a row."""
    rows, matrices, forms = _Numbering(), _Numbering(), builder.forms
    outlines = tuple(tuple(_outline(guard, rows, matrices, forms) for guard in builder.guards_in(context))
                     for context in builder.mode_set.first_with)
    places = _places(builder.mode_set, outlines)
    channels = forms.channels
    row = np.array([rows.arrays[number] for number in places.rows]).reshape(len(places.rows), channels.count)
    matrix = np.array([matrices.arrays[number] for number in places.matrices])
    return {**places.tables, "row": row, "row_terms": terms(row), "driven": _reads_driven(row, forms),
            "jump_matrix": matrix.reshape(len(matrix), 2 * channels.coordinates, channels.count)}


class _Numbering:
    """Different arrays, numbered as they come."""

    def __init__(self) -> None:
        self.arrays: list[np.ndarray] = []
        self._number_by_bytes: dict[bytes, int] = {}

    def number(self, array: np.ndarray) -> int:
        """Return the number of `array`."""
        number = self._number_by_bytes.setdefault(array.tobytes(), len(self.arrays))
        if number == len(self.arrays):
            self.arrays.append(array)
        return number


class _TargetOutline(NamedTuple):
    target: Target  # without forms
    entries: tuple[int, ...]
    jump: int


class _GuardOutline(NamedTuple):
    row: int
    targets: tuple[_TargetOutline, ...]
    is_blow: bool
    entries_decide: bool


def _outline(guard: Guard, rows: _Numbering, matrices: _Numbering, forms: Forms) -> _GuardOutline:
    row, targets = _row(guard.form, rows), []
    for target in guard.targets:
        jump = matrices.number(_jump_matrix(target.jumps, forms)) if target.jumps else NOTHING
        entries = tuple([_row(form, rows) for form in target.entries])
        without_forms = Target(target.state, (), (), target.friction, target.frees_resting_masses)
        targets.append(_TargetOutline(without_forms, entries, jump))
    return _GuardOutline(row, tuple(targets), guard.is_blow, guard.entries_decide)


def _row(form: Form, rows: _Numbering) -> int:
    return rows.number(form + 0.0)  # no -0.0, whose bytes differ


def _jump_matrix(jumps: Iterable[tuple[int, Form]], forms: Forms) -> np.ndarray:
    """Matrix of positions and velocities after a jump, shape (2 coordinates, channels), times the channels before."""
    rows = forms.units[:2 * forms.channels.coordinates].copy()
    for channel, form in jumps:
        rows[channel] = form
    return rows


class _Places(NamedTuple):
    """Tables with numbers of rows and matrices; and these, by their numbers in the outlines, in the tables' order."""

    tables: dict[str, np.ndarray]
    rows: list[int]
    matrices: list[int]


@functools.lru_cache(maxsize=64)
def _places(mode_set: ModeSet, outlines: tuple[tuple[_GuardOutline, ...], ...]) -> _Places:
    """Places of guards in the tables; `outlines` are in the order of `ModeSet.first_with`."""
    by_context = dict(zip(mode_set.first_with, outlines, strict=True))
    guards = [[(context.effect, guard) for context in contexts for guard in by_context[context]]
              for contexts in mode_set.contexts]
    targets = [target for of_mode in guards for _, guard in of_mode for target in guard.targets]
    most_targets = max((len(guard.targets) for of_mode in guards for _, guard in of_mode), default=1)
    shape = (len(guards), max(1, max(map(len, guards))))
    guard_row, guard_effect, blow_monitor = (np.full(shape, NOTHING) for _ in range(3))
    candidate, jump = (np.full((*shape, most_targets), NOTHING) for _ in range(2))
    entry = np.full((*shape, most_targets, max((len(target.entries) for target in targets), default=0)), NOTHING)
    rows, matrices = dict[int, int](), dict[int, int]()
    for m, of_mode in enumerate(guards):
        for g, (effect, guard) in enumerate(of_mode):
            guard_row[m, g] = rows.setdefault(guard.row, len(rows))
            guard_effect[m, g] = UNCHECKED if guard.entries_decide else effect
            blow_monitor[m, g] = effect if guard.is_blow else NOTHING
            for c, outline in enumerate(guard.targets):
                candidate[m, g, c] = mode_set.target_mode(mode_set.modes[m], effect, outline.target)
                for e, row in enumerate(outline.entries):
                    entry[m, g, c, e] = rows.setdefault(row, len(rows))
                if outline.jump != NOTHING:
                    jump[m, g, c] = matrices.setdefault(outline.jump, len(matrices))
    tables = {"guard": guard_row, "guard_effect": guard_effect, "candidate": candidate, "entry": entry, "jump": jump,
              "blow_monitor": blow_monitor}
    return _Places(tables, list(rows), list(matrices))


def _reads_driven(row: np.ndarray, forms: Forms) -> np.ndarray:
    """Whether each row reads a coordinate of the body, shape (rows,)."""
    at, driven = forms.channels, range(forms.channels.dynamic, forms.channels.coordinates)
    return np.any(row[:, [channel(i) for channel in (at.position, at.velocity) for i in driven]], axis=1)
