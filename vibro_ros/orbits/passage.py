"""What happens along one passage of an orbit: its events in their order, its contacts, how far from them the cut lies.

Between two states with the same events in the same order the turn map is analytic, because flows and jumps are. Where
the order changes, the map has a corner or the root of a distance (M. di Bernardo, C. J. Budd, A. R. Champneys,
P. Kowalczyk, Piecewise-smooth Dynamical Systems, Springer 2008, chapters 6 to 8).
"""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from vibro_ros.orbits.turn_map import CELLS, TURN, TurnEnd, TurnMap, direction, events_in_cells, middle_of_longest
from vibro_ros.simulation.simulator import Simulator

#: Kinds of events, and of contacts that end, in the order in which they happen.
EventOrder = tuple[str, ...]
LANDING = "landing"
_CONTACT, _ENDS = "_contact", "_ends"
_BESIDE = np.array([-2.0, 2.0])  # spacings of floats before and after a landing, whose instant is rounded
_SAME = 1e-11  # part of the time in which events happen at once, and in no order: a blow unloads the ground
_STOPPED = 1e-12  # m/s along the ground: rounding of a body that a landing has stopped
SAMPLES = 1024
"""Of a turn, among which a mass is looked for that turns back before its plate."""
_NEAR = 1e-3  # crank radii: a nearer miss is looked at closely


@dataclass(frozen=True)
class Passage:
    """Events of an orbit.

    Attributes
    ----------
    contacts : tuple of (str, int)
        Kinds of contacts, and how many there are of each.
    clear : float
        Distance of the cut from the nearest event, as a share of a turn, dimensionless; 0 within a contact.
    best : float
        Crank angle [rad] of the phase that is farthest from all events.
    softest : float
        Least speed, in units of the machine, that separates a contact from a miss: that at which a mass arrives at its
        plate, or that which its drive would turn back within half the contact; infinite without contacts.
    miss : float
        Least distance [crank radii] by which a mass misses its plate where it turns back, exact where it is below 1e-3;
        infinite without a miss.
    order : tuple of str
        Its events in their order, counted from the cut.
    """

    contacts: tuple[tuple[str, int], ...]
    clear: float
    best: float
    softest: float
    miss: float
    order: EventOrder


def passage(turn_map: TurnMap, state: np.ndarray, turns: int) -> Passage:
    """What happens from `state`, at the cut, over `turns` turns."""
    device = Simulator(turn_map.scene)
    turn_map.put(device, state)
    device.take_events()
    device.advance_to((turns + 1) * turn_map.period)  # a contact is known when it has ended
    events = device.take_events()
    events = events[events["time"] < turns * turn_map.period]
    of_contact = np.char.endswith(events["kind"], _CONTACT)
    kinds, counts = np.unique(events["kind"][of_contact], return_counts=True)
    lasting = np.where(of_contact, events["duration"], 0.0) / turn_map.period
    busy = events_in_cells(events["time"] / turn_map.period % 1.0, lasting) > 0.0
    occupied = np.flatnonzero(busy)
    clear = min(occupied.min(), CELLS - 1 - occupied.max()) / CELLS if len(occupied) else 1.0
    best, _ = middle_of_longest(~busy, free=True) if not busy.all() else (0.0, 0.0)
    contacts = events[of_contact]
    speeds = np.maximum(contacts["speed"] / turn_map.units.max(), 0.5 * TURN * contacts["duration"] / turn_map.period)
    return Passage(tuple(zip(kinds.tolist(), counts.tolist(), strict=True)), float(clear),
                   float((turn_map.phase + direction(turn_map.scene) * best) % TURN), float(speeds.min(initial=np.inf)),
                   _nearest_miss(turn_map, state, turns, contacts), ordered(turn_map, state, turns)[1])


def ordered(turn_map: TurnMap, state: np.ndarray, turns: int = 1) -> tuple[TurnEnd, EventOrder]:
    """Where `turns` turns lead from `state`, as a call of the map, with the order of the events on the way."""
    device, end = turn_map.device, turns * turn_map.period
    turn_map.put(device, state)
    start = device.checkpoint()
    device.take_events()
    device.advance_to(end)
    now, events = device.state, device.take_events()
    landings = events["time"][events["kind"] == LANDING]
    speeds = np.zeros((len(landings), 2))
    if len(landings):  # the body's speed before and after a landing is not in its event
        device.restore(start)
        beside = landings[:, None] + _BESIDE * np.spacing(landings)[:, None]
        speeds = device.sample(beside.ravel()).body_velocity.reshape(-1, 2)
    return TurnEnd(turn_map.read(now), now.body_position), event_order(events, end, speeds)


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


def _nearest_miss(turn_map: TurnMap, state: np.ndarray, turns: int, contacts: np.ndarray) -> float:
    """`Passage.miss`: the nearest turning points among samples, and between their neighbours the exact one."""
    device, least = Simulator(turn_map.scene), np.inf
    turn_map.put(device, state)
    times = np.linspace(0.0, turns * turn_map.period, turns * SAMPLES + 1)
    run = device.sample(times)
    for side in turn_map.scene.plates:
        gap = getattr(run, f"{side}_plate_position") - getattr(run, f"{side}_position")
        of_side = contacts[contacts["kind"] == side + _CONTACT]
        for number in np.flatnonzero((gap[1:-1] <= gap[:-2]) & (gap[1:-1] < gap[2:]) & (gap[1:-1] < least)):
            first, last = times[number], times[number + 2]
            touches = (of_side["time"] <= last) & (of_side["time"] + of_side["duration"] >= first)
            if gap[number + 1] > 0.0 and not touches.any():
                least = min(least, _least_gap(turn_map, state, side, first, last)
                            if gap[number + 1] < _NEAR * turn_map.units.min() else float(gap[number + 1]))
    return max(0.0, least) / turn_map.units.min()


def _least_gap(turn_map: TurnMap, state: np.ndarray, side: str, first: float, last: float) -> float:
    """Distance [m] of a mass from its plate where it turns back between two instants [s]."""
    device = Simulator(turn_map.scene)

    def apart(time: float, what: str) -> float:
        turn_map.put(device, state)
        device.advance_to(time)
        return getattr(device.state, f"{side}_plate_{what}") - getattr(device.state, f"{side}_{what}")

    turns_back = apart(first, "velocity") < 0.0 < apart(last, "velocity")
    turn = brentq(apart, first, last, args=("velocity",), xtol=1e-12) if turns_back else first
    return max(0.0, apart(turn, "position"))
