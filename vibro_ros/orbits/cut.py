"""Where to cut the turn map: at a phase of the crank where nothing touches and nothing happens.

A cut that lies within a contact, or at an instant where the friction changes, makes the map rough: two states that are
close could be in different modes there.
"""

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.orbits.turn_map import TURN, TurnMap
from vibro_ros.simulation.simulator import Simulator

SEEN = 64
"""Turns that are looked at."""
SETTLED = 200
"""Turns that a scene is given to settle, from its own start, before they are looked at."""
CELLS = 4096
"""Parts of a turn in which events are told apart."""
_CONTACT = "_contact"


def free_phase(scene: Scene, device: Simulator) -> tuple[float, float]:
    """The phase farthest from all events of the coming `SEEN` turns, and the share of a turn that is free around it.

    Parameters
    ----------
    scene : Scene
        What the device simulates.
    device : Simulator
        It has settled; it is advanced by `SEEN` turns.

    Returns
    -------
    float, float
        Crank angle [rad], from 0 to 2 pi, and the share: 0 where every phase of the turn is within a contact, and the
        phase is one that is within the fewest.
    """
    period = TURN / scene["motor.speed"]
    device.take_events()
    begin, angle = device.time, device.state.crank_angle
    device.advance_to(begin + SEEN * period)
    events = device.take_events()
    phase = np.mod((events["time"] - begin) / period + angle / TURN, 1.0)
    of_contact = np.char.endswith(events["kind"], _CONTACT)
    lasting = np.where(of_contact, events["duration"], 0.0) / period
    busy = events_in_cells(phase, lasting)
    return middle_of_longest(busy == busy.min(), free=bool(busy.min() == 0.0))


def free_cut(scene: Scene) -> TurnMap:
    """The turn map of a scene, cut where the motion from its own start is free (ValueError for a crank that stands)."""
    TurnMap(scene)  # refuses a crank that stands
    device = Simulator(scene)
    device.advance_to(SETTLED * TURN / scene["motor.speed"])
    return TurnMap(scene, free_phase(scene, device)[0])


def events_in_cells(phase: np.ndarray, lasting: np.ndarray) -> np.ndarray:
    """How many events fall on each of the `CELLS` of a turn, shape (CELLS,).

    Parameters
    ----------
    phase, lasting : ndarray, shape (events,)
        Where in a turn an event begins, from 0 to 1, and for how much of turns it lasts; dimensionless.
    """
    count = np.zeros(CELLS)
    for first, last in zip(phase * CELLS, (phase + np.minimum(lasting, 1.0)) * CELLS, strict=True):
        count[np.arange(int(first), int(last) + 1) % CELLS] += 1.0
    return count


def middle_of_longest(quiet: np.ndarray, free: bool) -> tuple[float, float]:
    """Middle [rad] of the longest run of cells that are `quiet`, on the circle, and its share of the turn."""
    if quiet.all():
        return 0.0, 1.0
    start = int(np.flatnonzero(~quiet)[0])  # count from where a run cannot go on across
    turned = np.concatenate([[False], np.roll(quiet, -start), [False]])
    edges = np.flatnonzero(turned[1:] != turned[:-1]).reshape(-1, 2)
    first, last = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    middle = (start + 0.5 * (first + last)) / len(quiet) % 1.0
    return TURN * middle, (last - first) / len(quiet) if free else 0.0
