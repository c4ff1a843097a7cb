"""Rows of samples: what messages of one stamp on several topics say together; and where another run begins."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from vibro_ros.ros.live.live_decoder import STAMPED, Readings
from vibro_ros.simulation.samples import FIELDS

PATIENCE = 15
"""Batches after which a message whose stamp no other topic has had is given up: half a second."""
MOST_WAITING = 3000
"""Such messages of one topic that wait at most."""
RIVALRY = 2.0
"""Time [s] within which a publisher begins to count anew once at most; a robot needs about a second to start."""
_SPEED, _TORQUE, _POWER = (FIELDS.index(name) for name in ("motor_speed", "motor_torque", "motor_power"))


class Rows(NamedTuple):
    """Samples, in the order in which they came.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        ROS time [ns].
    counts : ndarray of int, shape (n,)
        What the publisher of the odometry has counted; the stamps where the middleware does not tell.
    values : ndarray, shape (n, len(FIELDS))
        All quantities; `time` is 0.
    """

    stamps: np.ndarray
    counts: np.ndarray
    values: np.ndarray


class Joining:
    """Joins what the topics say of one stamp.

    A stranger's message on one topic, with a stamp that no other topic has, finds no partner and does no harm.

    Attributes
    ----------
    given_up : int
        Messages that found no partner.
    """

    def __init__(self):
        self.given_up = 0
        self._waiting: dict[str, list[tuple[int, Readings, np.ndarray]]] = {topic: [] for topic in STAMPED}
        self._batch = 0

    def join(self, readings: Mapping[str, tuple[Readings, np.ndarray]], fields: Mapping[str, list[int]]) -> Rows:
        """Rows that are complete by now; each topic brings its readings and their publisher's counts.

        `motor_power` has no stamp to join it by. It is the motor's torque times its speed.
        """
        self._batch += 1
        for topic, (reading, counts) in readings.items():
            if len(reading.stamps):
                self._waiting[topic].append((self._batch, reading, counts))
        stamps = {topic: np.concatenate([np.empty(0, np.int64), *(one.stamps for _, one, _ in waiting)])
                  for topic, waiting in self._waiting.items()}
        odom = stamps["odom"]
        complete = np.ones(len(odom), bool)
        for topic in STAMPED[1:]:
            complete &= np.isin(odom, stamps[topic])
        _, first = np.unique(odom, return_index=True)
        chosen = np.intersect1d(np.flatnonzero(complete), first)  # of two with one stamp the first; in their order
        values = np.zeros((len(chosen), len(FIELDS)))
        for topic, waiting in self._waiting.items():
            if len(chosen):
                distinct, places = np.unique(stamps[topic], return_index=True)
                of_topic = np.concatenate([one.values for _, one, _ in waiting])
                values[:, fields[topic]] = of_topic[places[np.searchsorted(distinct, odom[chosen])]]
        values[:, _POWER] = values[:, _TORQUE] * values[:, _SPEED]
        counts = np.concatenate([np.empty(0, np.int64), *(one for _, _, one in self._waiting["odom"])])[chosen]
        self._forget(odom[chosen])
        return Rows(odom[chosen], counts, values)

    def _forget(self, joined: np.ndarray) -> None:
        """Keep only messages whose stamp was not joined, and that wait neither too long nor with too many others."""
        for topic, waiting in self._waiting.items():
            kept = []
            room = MOST_WAITING
            for batch, reading, counts in reversed(waiting):
                left = ~np.isin(reading.stamps, joined)
                number = int(left.sum())
                if number and (batch <= self._batch - PATIENCE or number > room):
                    self.given_up += number
                elif number:
                    room -= number
                    kept.append((batch, Readings(reading.stamps[left], reading.values[left], []), counts[left]))
            self._waiting[topic] = kept[::-1]


class Runs:
    """Tells the samples of one run from those of the next, and one robot from two.

    A robot that is started anew counts its messages from 1. Two robots that publish on the same topics make the count
    go back again and again.

    Parameters
    ----------
    now : callable
        The clock [s].

    """

    def __init__(self, now: Callable[[], float] = time.monotonic):
        self._now, self._last = now, -1
        self._setbacks: deque[float] = deque(maxlen=2)

    @property
    def rivals(self) -> bool:
        """Whether two robots have been heard lately."""
        return len(self._setbacks) == 2 and (self._setbacks[1] - self._setbacks[0] < RIVALRY
                                             and self._now() - self._setbacks[1] < RIVALRY)

    def begins_anew(self, counts: np.ndarray) -> bool:
        """Take note of what came; whether another run has begun with it."""
        if not len(counts):
            return False
        setbacks = np.flatnonzero(np.diff(np.concatenate([[self._last], counts])) <= 0)
        self._last = int(counts[-1])
        self._setbacks.extend([self._now()] * min(len(setbacks), 2))
        return len(setbacks) > 0
