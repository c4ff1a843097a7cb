"""The words in which an effect tells its states: the guards that end a state, and the targets that may follow."""

from typing import NamedTuple

import numpy as np


class Target(NamedTuple):
    """A state that a guard may lead to.

    Attributes
    ----------
    state : str
        State of the guard's own effect.
    jumps : tuple of (int, ndarray)
        Channels of the positions and velocities that change on the way to the target, each with a form, shape
        (channels,), that gives the new value from the channels before the jump.
    entries : tuple of ndarray
        Forms, shape (channels,), that must not be negative before the jump for the target to be entered.
    friction : str or None
        State of the friction, where a blow changes the friction as well.
    frees_resting_masses : bool
        Whether the jump is a shock in which masses that rest on other plates part from these plates.
    """

    state: str
    jumps: tuple[tuple[int, np.ndarray], ...] = ()
    entries: tuple[np.ndarray, ...] = ()
    friction: str | None = None
    frees_resting_masses: bool = False


class Guard(NamedTuple):
    """A condition that holds while a state lasts: form >= 0.

    Attributes
    ----------
    form : ndarray, shape (channels,)
        The linear form.
    targets : tuple of Target
        The targets to try, in order, when the form turns negative; the last one is entered if none is valid.
    text : str
        The condition in the paper's symbols, with `{force}` for the force of a compliant plate.
    is_blow : bool
        Whether the guard ends in a blow without duration, which is recorded as a contact at once.
    entries_decide : bool
        Whether a target is valid by its entries alone, even if its own guards fail after the jump. A landing is such a
        guard, because the body has landed even if it lifts off again at once.
    """

    form: np.ndarray
    targets: tuple[Target, ...]
    text: str
    is_blow: bool = False
    entries_decide: bool = False


def without_jump(*states: str) -> tuple[Target, ...]:
    """Targets for these states, in their order, whose positions and velocities do not change."""
    return tuple(Target(state) for state in states)
