"""What happens along one passage of an orbit: its contacts, and how far from all events the cut lies."""

from dataclasses import dataclass

import numpy as np

from vibro_ros.orbits.cut import middle_of_longest
from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.simulator import Simulator

CELLS = 4096
"""Parts of a turn in which events are told apart."""
SAMPLES = 1024
"""Of a turn, among which a mass is looked for that turns back before its plate."""
_CONTACT = "_contact"


@dataclass(frozen=True)
class Passage:
    """Events of an orbit.

    Attributes
    ----------
    contacts : tuple of (str, int)
        Kinds of contacts, and how many there are of each.
    clear : float
        Distance of the cut from the nearest event, as a share of a turn; 0 within a contact.
    best : float
        Crank angle [rad] of the phase that is farthest from all events.
    softest : float
        Least speed, in units of the machine, that separates a contact from a miss: that at which a mass arrives at its
        plate, or that which its drive would turn back within half the contact; infinite without contacts.
    miss : float
        Least distance [crank radii] by which a mass misses its plate where it turns back; infinite without a miss.
    """

    contacts: tuple[tuple[str, int], ...]
    clear: float
    best: float
    softest: float
    miss: float


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
    begin = events["time"] / turn_map.period
    end = begin + np.where(of_contact, events["duration"], 0.0) / turn_map.period
    busy = np.zeros(CELLS, dtype=bool)
    for first, last in zip(begin % 1.0 * CELLS, (begin % 1.0 + np.minimum(end - begin, 1.0)) * CELLS, strict=True):
        busy[np.arange(int(first), int(last) + 1) % CELLS] = True
    occupied = np.flatnonzero(busy)
    clear = min(occupied.min(), CELLS - 1 - occupied.max()) / CELLS if len(occupied) else 1.0
    best, _ = middle_of_longest(~busy, free=True) if not busy.all() else (0.0, 0.0)
    contacts = events[of_contact]
    speeds = np.maximum(contacts["speed"] / turn_map.units.max(), 0.5 * TURN * contacts["duration"] / turn_map.period)
    return Passage(tuple(zip(kinds.tolist(), counts.tolist(), strict=True)), float(clear),
                   float((turn_map.phase + best) % TURN), float(speeds.min(initial=np.inf)),
                   _nearest_miss(turn_map, state, turns))


def _nearest_miss(turn_map: TurnMap, state: np.ndarray, turns: int) -> float:
    """`Passage.miss`, from samples: a parabola joins the highest with its neighbours."""
    device, least = Simulator(turn_map.scene), np.inf
    turn_map.put(device, state)
    run = device.sample(np.linspace(0.0, turns * turn_map.period, turns * SAMPLES + 1))
    for side in turn_map.scene.plates:
        gap = getattr(run, f"{side}_plate_position") - getattr(run, f"{side}_position")
        before, middle, after = gap[:-2], gap[1:-1], gap[2:]
        turning = (middle > 0.0) & (middle <= before) & (middle < after) & (before > 0.0) & (after > 0.0)
        curvature = (before - 2.0 * middle + after)[turning]
        misses = middle[turning] - (after - before)[turning] ** 2 / (8.0 * curvature)
        least = min(least, float(misses.min(initial=np.inf)))
    return max(0.0, least) / turn_map.units.min()
