"""What an effect contributes to the modes: states, and the guards that end them."""

from typing import NamedTuple

import numpy as np


class Target(NamedTuple):
    """A state that a guard may lead to.

    Attributes
    ----------
    state : str
        State of the guard's own effect.
    jumps : tuple of (int, ndarray)
        Channels of positions and velocities that change on the way, and their new values as forms of the old ones.
    entries : tuple of ndarray
        Forms that must not be negative before the jump, for the target to be entered.
    friction : str or None
        State of the friction, where a blow changes that as well.
    parts : bool
        Whether it is a shock in which masses that rest on other plates part from them.
    """

    state: str
    jumps: tuple[tuple[int, np.ndarray], ...] = ()
    entries: tuple[np.ndarray, ...] = ()
    friction: str | None = None
    parts: bool = False


class Guard(NamedTuple):
    """A condition that a state keeps: form >= 0.

    Attributes
    ----------
    form : ndarray, shape (channels,)
        The linear form.
    targets : tuple of Target
        What to try, in order, when the form turns negative; the last is taken when none is valid.
    text : str
        The condition in the paper's symbols.
    strike : bool
        Whether this is a blow without duration, which is recorded as a contact at once.
    committed : bool
        Whether the targets' entries alone decide, whatever the targets' own guards say of the point after the jump:
        a landing has happened even if the body lifts off again at once.
    """

    form: np.ndarray
    targets: tuple[Target, ...]
    text: str
    strike: bool = False
    committed: bool = False


def to(*states: str) -> tuple[Target, ...]:
    """Targets without a jump."""
    return tuple(Target(state) for state in states)
