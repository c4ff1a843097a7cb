"""The modes of a choice of effects: every combination of the effects' states, and what depends on these states alone.

The scenes of a sweep over lengths, masses or stiffnesses have the same effects, so that they share one `ModeSet`.
"""

import functools
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.model.automaton import Target
from vibro_ros.model.contact import CompliantContact, RigidContact
from vibro_ros.model.friction import Friction
from vibro_ros.solver.system import NOTHING

#: Kinds of events that a change of mode records, by their number.
MODE_EVENTS = ("stick", "slip_forward", "slip_backward", "unloaded", "loaded", "lift_off", "landing")
# Events by the state of the friction that begins, and by the state that ends, where they are not the new state's name.
_ENTERING, _LEAVING = {"airborne": "lift_off"}, {"unloaded": "loaded", "airborne": "landing"}


@dataclass(frozen=True)
class Mode:
    """One state of every effect.

    Attributes
    ----------
    states : tuple of str
        States of the contacts, in the order of `Forms.plates`, then that of the friction.
    closed : frozenset of str
        Guides whose compliant plates are in contact.
    resting : frozenset of str
        Guides whose masses rest on rigid plates.
    """

    states: tuple[str, ...]
    closed: frozenset[str]
    resting: frozenset[str]

    @property
    def friction(self) -> str:
        """State of the friction."""
        return self.states[-1]

    @property
    def pressing(self) -> frozenset[str]:
        """Guides whose masses press on their plates."""
        return self.closed | self.resting


class Context(NamedTuple):
    """What the guards of an effect's state depend on; modes with the same context have the same guards.

    Attributes
    ----------
    effect : int
        Index of the effect in `Mode.states`.
    state : str
        Its state.
    others : tuple
        What counts of the states of the other effects.
    """

    effect: int
    state: str
    others: tuple[Any, ...]


class ModeSet:
    """The modes of a choice of effects; made by `mode_set`, once for all scenes with these effects.

    Attributes
    ----------
    modes : tuple of Mode
        All modes, by their numbers.
    pressing : dict of str to ndarray of bool, shape (modes,)
        By guide with a plate: the modes in which its mass presses on the plate.
    friction : ndarray of int, shape (modes,)
        State of the friction, as an index in the friction's states.
    airborne : ndarray of bool, shape (modes,)
        The modes in which the body is in the air.
    inclined_closed : ndarray of int, shape (modes,)
        1 in the modes in which the inclined mass presses on its compliant plate, else 0.
    moving : tuple of (tuple, tuple)
        For each set of masses that move together in some modes, as indices of arrays by mode and guide: the rows of
        these masses, shape (modes, masses), and the blocks that couple them, shape (modes, masses, masses).
    contexts : tuple of tuple of Context
        By mode, the context of each effect.
    first_with : dict of Context to int
        The first mode with a context.
    event_kind : ndarray, shape (modes before, modes after)
        Kinds of events, by the states of the friction before and after.
    mode_after_ramp_change : ndarray, shape (modes, plates)
        Modes that follow when a plate's speed changes, because a mass may part from the plate.
    """

    def __init__(self, guides: tuple[str, ...], plates: tuple[str, ...],
                 kinds: tuple[type[CompliantContact | RigidContact], ...], states: tuple[tuple[str, ...], ...],
                 contact_changes_ground_force: bool):
        self.modes = tuple(Mode(of_mode, _sides_in("closed", plates, of_mode), _sides_in("resting", plates, of_mode))
                           for of_mode in itertools.product(*states))
        self._number_by_states = {mode.states: m for m, mode in enumerate(self.modes)}
        self.pressing = {side: np.array([side in mode.pressing for mode in self.modes]) for side in plates}
        self.friction = np.array([states[-1].index(mode.friction) for mode in self.modes])
        self.airborne = np.array([mode.friction == "airborne" for mode in self.modes])
        self.inclined_closed = np.array([int("inclined" in mode.closed) for mode in self.modes])
        self.moving = tuple(self._moving(guides))
        self.contexts = tuple(tuple(_contexts(mode, kinds, contact_changes_ground_force)) for mode in self.modes)
        self.first_with = {context: m for m, contexts in reversed(list(enumerate(self.contexts)))
                           for context in contexts}
        self.event_kind = self._event_kinds()
        self.mode_after_ramp_change = self._modes_after_ramp_changes(len(plates))

    def number(self, states: tuple[str, ...]) -> int:
        """Number of the mode with these states."""
        return self._number_by_states[states]

    def target_mode(self, mode: Mode, effect: int, target: Target) -> int:
        """Number of the mode to which a target of an effect leads from `mode`."""
        states = ["open" if target.frees_resting_masses and state == "resting" else state for state in mode.states]
        states[effect] = target.state
        if target.friction:
            states[-1] = target.friction
        return self.number(tuple(states))

    def _moving(self, guides: tuple[str, ...]) -> Iterator[tuple[tuple, tuple]]:
        """The groups of `moving`; a mode in which every mass rests is in none."""
        for resting in dict.fromkeys(mode.resting for mode in self.modes):
            moving = [i for i, side in enumerate(guides) if side not in resting]
            modes = [m for m, mode in enumerate(self.modes) if mode.resting == resting]
            if moving:
                yield np.ix_(modes, moving), np.ix_(modes, moving, moving)

    def _event_kinds(self) -> np.ndarray:
        table = np.full((len(self.modes), len(self.modes)), NOTHING)
        for before, after in itertools.permutations(range(len(self.modes)), 2):
            old, new = self.modes[before].friction, self.modes[after].friction
            event = _LEAVING.get(old) or _ENTERING.get(new, new)
            if old != new and event in MODE_EVENTS:
                table[before, after] = MODE_EVENTS.index(event)
        return table

    def _modes_after_ramp_changes(self, plates: int) -> np.ndarray:
        table = np.empty((len(self.modes), plates), dtype=np.int64)
        for m, mode in enumerate(self.modes):
            for k in range(plates):
                new = list(mode.states)
                new[k] = "open" if mode.states[k] == "resting" else mode.states[k]
                table[m, k] = self.number(tuple(new))
        return table


def _sides_in(wanted: str, plates: tuple[str, ...], states: tuple[str, ...]) -> frozenset[str]:
    """Guides whose contacts are in the state `wanted`."""
    return frozenset(side for side, state in zip(plates, states, strict=False) if state == wanted)


def _contexts(mode: Mode, kinds: tuple[type[CompliantContact | RigidContact], ...],
              contact_changes_ground_force: bool) -> Iterator[Context]:
    for k, kind in enumerate(kinds):
        yield Context(k, mode.states[k], kind.context(mode.friction, mode.resting))
    closed = mode.closed & {"inclined"} if contact_changes_ground_force else frozenset[str]()
    yield Context(len(kinds), mode.friction, Friction.context(mode.friction, mode.resting, closed))


#: The `ModeSet` of guides, plates, classes of their contacts, states (those of each contact, then of the friction), and
#: whether the forms of N and F_in depend on the contact of the inclined plate.
mode_set = functools.lru_cache(maxsize=64)(ModeSet)
