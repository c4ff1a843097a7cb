"""Events along one period of an orbit: their order, the contacts, near misses, and the distance of the cut from them.

The turn map is analytic between two states whose events have the same order, because flows and jumps are analytic.
Where the order changes, the map has a corner or behaves like the square root of the distance (M. di Bernardo,
C. J. Budd, A. R. Champneys, P. Kowalczyk, Piecewise-smooth Dynamical Systems, Springer 2008, chapters 6 to 8).
"""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from vibro_lab.orbits.turn_map import CELLS, TURN, TurnEnd, TurnMap, direction, events_in_cells, middle_of_longest
from vibro_ros import Simulator

#: Kinds of events, including the ends of contacts, in the order in which they happen.
EventOrder = tuple[str, ...]
LANDING = "landing"
_CONTACT, _ENDS = "_contact", "_ends"
_FLOAT_OFFSETS = np.array([-2.0, 2.0])  # spacings of floats before and after a landing, whose instant is rounded
# Share of the whole time within which events count as simultaneous, as when an impact unloads the ground.
_SIMULTANEOUS = 1e-11
_STOPPED_SPEED = 1e-12  # m/s along the ground: rounding of a body that a landing has stopped
SAMPLES = 1024
"""Samples of a turn in which misses are searched for."""
_EXACT_MISS = 1e-3  # crank radii: a miss nearer than this is computed exactly


@dataclass(frozen=True)
class Passage:
    """Events of an orbit over one period."""

    contacts: tuple[tuple[str, int], ...]  # kinds of contacts, with the number of each
    clear: float  # distance of the cut from the nearest event, as a share of a turn, dimensionless; 0 within a contact
    best: float  # crank angle [rad] of the phase that is farthest from all events
    # Least impact speed of a contact, in units of the machine, as a measure of how close it is to a miss; infinite
    # without contacts. For each contact it is the larger of the speed at which the mass arrives at its plate and the
    # speed that its drive would reverse within half the contact.
    softest: float
    # Least distance [crank radii] by which a mass misses its plate where it turns back, exact where it is below 1e-3;
    # infinite without a miss.
    miss: float
    order: EventOrder  # kinds of the events in their order, beginning at the cut


def passage(turn_map: TurnMap, state: np.ndarray, turns: int) -> Passage:
    """Return the events from `state`, at the cut, over `turns` turns."""
    device = Simulator(turn_map.scene)
    turn_map.put(device, state)
    device.take_events()
    turn_map.advance(device, turns)
    end = device.time
    turn_map.advance(device, turns + 1)  # an event of a contact exists only after the contact has ended
    events = device.take_events()
    events = events[events["time"] < end]
    of_contact = np.char.endswith(events["kind"], _CONTACT)
    contacts = events[of_contact]
    kinds, counts = np.unique(contacts["kind"], return_counts=True)
    begins, lasting = turn_map.shares(state, events["time"], np.where(of_contact, events["duration"], 0.0))
    busy = events_in_cells(begins % 1.0, lasting) > 0.0
    occupied = np.flatnonzero(busy)
    clear = min(occupied.min(), CELLS - 1 - occupied.max()) / CELLS if len(occupied) else 1.0
    best, _ = middle_of_longest(~busy, free=True) if not busy.all() else (0.0, 0.0)
    speeds = np.maximum(contacts["speed"] / turn_map.velocity, 0.5 * TURN * lasting[of_contact])
    miss = _nearest_miss(turn_map, state, np.linspace(0.0, end, turns * SAMPLES + 1), contacts)
    return Passage(tuple(zip(kinds.tolist(), counts.tolist(), strict=True)), float(clear),
                   float((turn_map.phase + direction(turn_map.scene) * best) % TURN), float(speeds.min(initial=np.inf)),
                   miss, end_and_order(turn_map, state, turns)[1])


def end_and_order(turn_map: TurnMap, state: np.ndarray, turns: int) -> tuple[TurnEnd, EventOrder]:
    """Return the end of `turns` turns from `state`, as a call of the map does, and the order of the events until then.
    """
    device = turn_map.device
    turn_map.put(device, state)
    start = device.checkpoint()
    device.take_events()
    turn_map.advance(device, turns)
    end, now, events = device.time, device.state, device.take_events()
    landings = events["time"][events["kind"] == LANDING]
    speeds = np.zeros((len(landings), 2))
    if len(landings):  # an event of a landing does not contain the body's speeds before and after it
        device.restore(start)
        instants = landings[:, None] + _FLOAT_OFFSETS * np.spacing(landings)[:, None]
        speeds = device.sample(instants.ravel()).body_velocity.reshape(-1, 2)
    return TurnEnd(turn_map.read(now), now.body_position, end), event_order(events, end, speeds)


def event_order(events: np.ndarray, until: float, speeds: np.ndarray) -> EventOrder:
    """Order of the `events`, from `Simulator.take_events`, before the time `until` [s].

    `speeds`, shape (landings, 2), are those of the body along the ground before and after each landing [m/s]. Landings
    after which the body slips on, stops, or slips the other way are different kinds of events.
    """
    happened = list(zip(events["time"].tolist(), events["kind"].tolist(), strict=True))
    ends = [(time + duration, kind + _ENDS) for (time, kind), duration in
            zip(happened, events["duration"].tolist(), strict=True) if kind.endswith(_CONTACT)]
    landing_speeds = iter(speeds.tolist())
    happened = [(time, _landing(*next(landing_speeds)) if kind == LANDING else kind) for time, kind in happened]
    at_once: list[list[tuple[float, str]]] = [[(-math.inf, "")]]
    for time, kind in sorted(happened + ends):
        if time >= until:
            break
        if time - at_once[-1][-1][0] > _SIMULTANEOUS * until:
            at_once.append([])
        at_once[-1].append((time, kind))
    return tuple(kind for group in at_once[1:] for kind in sorted(kind for _, kind in group))


def _landing(speed: float, speed_after: float) -> str:
    if abs(speed_after) < _STOPPED_SPEED:
        return f"{LANDING}_stops"
    change = "turns" if speed * speed_after < 0.0 else "slips"
    return f"{LANDING}_{change}_{'forward' if speed_after > 0.0 else 'backward'}"


def same_order(order: EventOrder, other: EventOrder) -> bool:
    """Whether two passages have the same events in the same cyclic order; their cuts may differ."""
    if order == other:
        return True
    n = len(order)
    return n == len(other) and any(order[k:] + order[:k] == other for k in range(1, n))


def contacts_of(order: EventOrder) -> Counter[str]:
    """Numbers of contacts of each plate, and of landings of the body, in a passage."""
    return Counter(LANDING if kind.startswith(LANDING) else kind for kind in order
                   if kind.endswith(_CONTACT) or kind.startswith(LANDING))


def change_in_words(order: EventOrder, other: EventOrder) -> str:
    """Change of an order as text, such as ``stick vanishes, landing appears`` or ``other order of landing, stick``."""
    gained, lost = Counter(other) - Counter(order), Counter(order) - Counter(other)
    words = [f"{kind} {change}" for counted, change in ((lost, "vanishes"), (gained, "appears"))
             for kind in sorted(counted) if not kind.endswith(_ENDS) or len(lost) + len(gained) == 1]
    if words:
        return ", ".join(words)
    turned = min((order[k:] + order[:k] for k in range(len(order))),
                 key=lambda rotated: sum(a != b for a, b in zip(rotated, other, strict=True)))
    changed = dict.fromkeys(a for a, b in zip(turned, other, strict=True) if a != b)
    return f"other order of {', '.join(changed)}"


def _nearest_miss(turn_map: TurnMap, state: np.ndarray, times: np.ndarray, contacts: np.ndarray) -> float:
    """`Passage.miss`, from samples at `times` [s]; computed exactly where a sample is near."""
    device, least, near = Simulator(turn_map.scene), math.inf, _EXACT_MISS * turn_map.length
    turn_map.put(device, state)
    run = device.sample(times)
    for side in turn_map.scene.plates:
        gap = getattr(run, f"{side}_plate_position") - getattr(run, f"{side}_position")
        of_side = contacts[contacts["kind"] == side + _CONTACT]
        for number in np.flatnonzero((gap[1:-1] <= gap[:-2]) & (gap[1:-1] < gap[2:])):
            first, last, distance = float(times[number]), float(times[number + 2]), float(gap[number + 1])
            touches = (of_side["time"] <= last) & (of_side["time"] + of_side["duration"] >= first)
            if distance > 0.0 and not touches.any():
                least = min(least, _least_gap(turn_map, state, side, first, last) if distance < near else distance)
    return least / turn_map.length


def _least_gap(turn_map: TurnMap, state: np.ndarray, side: str, first: float, last: float) -> float:
    """Distance [m] of a mass from its plate where it turns back between two instants [s]; 0 where it touches."""
    device = Simulator(turn_map.scene)

    def apart(time: float, quantity: str) -> float:
        turn_map.put(device, state)
        device.advance_to(time)
        return getattr(device.state, f"{side}_plate_{quantity}") - getattr(device.state, f"{side}_{quantity}")

    turns_back = apart(first, "velocity") < 0.0 < apart(last, "velocity")
    turn = brentq(apart, first, last, args=("velocity",), xtol=1e-12) if turns_back else first
    return max(0.0, apart(turn, "position"))
