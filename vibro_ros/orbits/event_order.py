"""The order of the events along a passage: where it is the same, the turn map is smooth.

Between two states with the same events in the same order the turn map is analytic, because flows and jumps are. Where
the order changes, the map has a corner or the root of a distance (M. di Bernardo, C. J. Budd, A. R. Champneys,
P. Kowalczyk, Piecewise-smooth Dynamical Systems, Springer 2008, chapters 6 to 8).
"""

import math
from collections import Counter

import numpy as np

#: Kinds of events, and of contacts that end, in the order in which they happen.
EventOrder = tuple[str, ...]
LANDING = "landing"
_CONTACT, _ENDS = "_contact", "_ends"
_SAME = 1e-11  # part of the time in which events happen at once, and in no order: a blow unloads the ground
_STOPPED = 1e-12  # m/s along the ground: rounding of a body that a landing has stopped


def event_order(events: np.ndarray, until: float, speeds: np.ndarray) -> EventOrder:
    """The order of what happens before the time `until` [s].

    Parameters
    ----------
    events : ndarray, shape (events,)
        As `Simulator.take_events` gives them.
    until : float
        Time [s].
    speeds : ndarray, shape (landings, 2)
        Of the body along the ground before and after each landing [m/s]: a landing after which the body slips on is
        another event than one that stops it, or turns it round.
    """
    happened = list(zip(events["time"].tolist(), events["kind"].tolist(), strict=True))
    ends = [(time + duration, kind + _ENDS) for (time, kind), duration in
            zip(happened, events["duration"].tolist(), strict=True) if kind.endswith(_CONTACT)]
    left = iter(speeds.tolist())
    happened = [(time, _landing(*next(left)) if kind == LANDING else kind) for time, kind in happened]
    at_once: list[list[tuple[float, str]]] = [[(-math.inf, "")]]
    for time, kind in sorted(happened + ends):
        if time >= until:
            break
        if time - at_once[-1][-1][0] > _SAME * until:
            at_once.append([])
        at_once[-1].append((time, kind))
    return tuple(kind for group in at_once[1:] for kind in sorted(kind for _, kind in group))


def _landing(before: float, after: float) -> str:
    if abs(after) < _STOPPED:
        return f"{LANDING}_stops"
    return f"{LANDING}_{'turns' if before * after < 0.0 else 'slips'}_{'forward' if after > 0.0 else 'backward'}"


def same_order(one: EventOrder, other: EventOrder) -> bool:
    """Whether two passages have the same events in the same order, wherever on the circle the cut lies."""
    if one == other:
        return True
    n = len(one)
    return n == len(other) and any(one[k:] + one[:k] == other for k in range(1, n))


def contacts_of(order: EventOrder) -> Counter[str]:
    """How many contacts of each plate, and landings of the body, a passage has."""
    return Counter(LANDING if kind.startswith(LANDING) else kind for kind in order
                   if kind.endswith(_CONTACT) or kind.startswith(LANDING))


def change_in_words(before: EventOrder, after: EventOrder) -> str:
    """What is different, such as ``stick appears, slip_forward appears`` or ``other order of landing, stick``."""
    gained, lost = Counter(after) - Counter(before), Counter(before) - Counter(after)
    words = [f"{kind} {what}" for counted, what in ((lost, "vanishes"), (gained, "appears"))
             for kind in sorted(counted) if not kind.endswith(_ENDS) or len(lost) + len(gained) == 1]
    if words:
        return ", ".join(words)
    turned = min((before[k:] + before[:k] for k in range(len(before))),
                 key=lambda order: sum(a != b for a, b in zip(order, after, strict=True)))
    moved = dict.fromkeys(a for a, b in zip(turned, after, strict=True) if a != b)
    return f"other order of {', '.join(moved)}"
