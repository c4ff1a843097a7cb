"""Recordings of a robot that was put back to its start: what moved, without the jumps of the resets."""

import numpy as np

from vibro_ros.bag.reader import Arrays


def reset_times(joints: Arrays) -> np.ndarray:
    """Times [s] of the first samples after resets, shape (n,): only a reset lowers the crank's angle."""
    return joints["time"][1:][np.diff(joints["crank.position"]) < 0.0]


def changes(time: np.ndarray, values: np.ndarray, resets: np.ndarray) -> np.ndarray:
    """Differences of neighbouring `values`, shape (n - 1,); 0 where a reset lies between the two.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        Samples, and their times [s].
    resets : ndarray, shape (m,)
        From `reset_times`.
    """
    found = np.diff(values)
    after = np.searchsorted(time, resets)
    found[after[(after > 0) & (after < len(time))] - 1] = 0.0
    return found
