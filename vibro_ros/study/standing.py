"""How long the body stood still, and how long it was in the air: from the instants of its events, hence exact.

An event tells which state of the body begins, but `loaded` and `landing` tell only which one ends: the body may slip
afterwards or stand. There, and at the first instant, the body's speed in the middle of the stretch up to the next event
decides, because a body that sticks has the speed 0 to the last bit.
"""

import numpy as np

from vibro_ros.simulation.samples import Samples
from vibro_ros.simulation.simulator import Simulator

_STANDS, _MOVES = ("stick",), ("slip_forward", "slip_backward", "unloaded", "lift_off")
_TELLS_NOT = ("loaded", "landing")


def standing_and_airborne(device: Simulator, checkpoint: np.ndarray, before: Samples[float], events: np.ndarray,
                          end: float) -> tuple[float, float]:
    """Times [s] that the body stood still on the ground, and was in the air.

    Parameters
    ----------
    device : Simulator
        The device, which is left at some instant of the time where what begins is not told.
    checkpoint : ndarray, shape (n,)
        Of the device at the first instant.
    before : Samples of float
        The device at the first instant, SI units.
    events : structured ndarray, shape (n,)
        What `Simulator.take_events` gave between the first instant and `end` [s].
    """
    events = events[np.isin(events["kind"], (*_STANDS, *_MOVES, *_TELLS_NOT))]
    events = events[np.argsort(events["time"], kind="stable")]
    kinds = np.concatenate([[_first_kind(before, events)], events["kind"]])
    times = np.concatenate([[before.time], events["time"], [end]])
    lengths = np.maximum(np.diff(times), 0.0)
    stands = np.isin(kinds, _STANDS)
    open_ones = np.flatnonzero(np.isin(kinds, _TELLS_NOT) & (lengths > 0.0))
    if len(open_ones):
        device.restore(checkpoint)
        middles = times[open_ones] + lengths[open_ones] / 2.0
        stands[open_ones] = device.sample(np.maximum(middles, before.time)).body_velocity == 0.0
    return float(lengths[stands].sum()), float(lengths[kinds == "lift_off"].sum())


def _first_kind(before: Samples[float], events: np.ndarray) -> str:
    """An event that may have led to the state of the body at the first instant."""
    if len(events):
        return "lift_off" if events["kind"][0] == "landing" else "loaded"
    return "lift_off" if before.body_height > 0.0 else "loaded"
