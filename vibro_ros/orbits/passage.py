"""What happens along one passage of an orbit: its contacts, and how far from all events the cut lies."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from vibro_ros.orbits.cut import CELLS, events_in_cells, middle_of_longest
from vibro_ros.orbits.event_order import EventOrder
from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

SAMPLES = 1024
"""Of a turn, among which a mass is looked for that turns back before its plate."""
_NEAR = 1e-3  # crank radii: a nearer miss is looked at closely
_CONTACT = "_contact"


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
        Its events in their order, counted from the cut; see `event_order`.
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
                   float((turn_map.phase + best) % TURN), float(speeds.min(initial=np.inf)),
                   _nearest_miss(turn_map, state, turns, contacts), turn_map.ordered(state, turns)[1])


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

    def at(time: float) -> Samples[float]:
        turn_map.put(device, state)
        device.advance_to(time)
        return device.state

    def leaving(time: float) -> float:
        now = at(time)
        return getattr(now, f"{side}_plate_velocity") - getattr(now, f"{side}_velocity")

    turn = brentq(leaving, first, last, xtol=1e-12) if leaving(first) < 0.0 < leaving(last) else first
    now = at(turn)
    return max(0.0, getattr(now, f"{side}_plate_position") - getattr(now, f"{side}_position"))
