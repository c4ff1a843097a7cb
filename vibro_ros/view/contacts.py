"""What the events of a simulated motion say of its contacts, and of the instants at which something changes."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.messages.fields import PLATES


class Impact(NamedTuple):
    """A contact: first and last instant [s], side, peak force [N]."""

    time: float
    end: float
    side: str
    peak_force: float


def impacts_of(events: np.ndarray, offset: float) -> list[Impact]:
    """The contacts among events, of dtype `EVENT_DTYPE`; `offset` [s] is added to their times."""
    events = events[np.isin(events["kind"], list(PLATES))]
    times = events["time"] + offset
    return [Impact(time, end, kind.partition("_")[0], force) for time, end, kind, force in zip(
        times.tolist(), (times + events["duration"]).tolist(), events["kind"].tolist(), events["peak_force"].tolist(),
        strict=True)]


def instants_of(events: np.ndarray, offset: float) -> np.ndarray:
    """Instants [s] of events, of dtype `EVENT_DTYPE`, and of the ends of contacts; `offset` [s] is added."""
    times = events["time"] + offset
    return np.concatenate([times, (times + events["duration"])[events["duration"] > 0.0]])


def as_json(impacts: Sequence[Impact]) -> list[dict[str, Any]]:
    """Impacts for a header, by time."""
    return [{**one._asdict(), "peak_force": one.peak_force if math.isfinite(one.peak_force) else None}
            for one in sorted(impacts)]
