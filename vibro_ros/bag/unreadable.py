"""What of a bag cannot be read, in sentences; above all messages that are not what their topic says."""

from collections.abc import Sequence
from dataclasses import dataclass

from vibro_ros.process.untrusted import one_line

MOST_FLAWS = 20
"""Sentences on what cannot be read that people are shown."""


def not_read(flaws: Sequence[str]) -> list[str]:
    """The first `MOST_FLAWS` sentences on what cannot be read, as lines for people, and how many more there are."""
    more = [f"not read: {len(flaws) - MOST_FLAWS} more"] if len(flaws) > MOST_FLAWS else []
    return [*(f"not read: {one_line(flaw)}" for flaw in flaws[:MOST_FLAWS]), *more]


@dataclass
class _Counted:
    count: int
    index: int
    stamp: int
    reason: str


class Unreadable:
    """Counts unreadable messages, and keeps the first of each topic."""

    def __init__(self) -> None:
        self._topics: dict[str, _Counted] = {}

    def add(self, topic: str, index: int, stamp: int, reason: object) -> None:
        """Count one: its topic, number on that topic in the bag from 0, recorded stamp [ns], and what is wrong."""
        known = self._topics.setdefault(topic, _Counted(0, index, stamp, str(reason)))
        known.count += 1

    def lines(self) -> list[str]:
        """A sentence for each topic."""
        return [f"{topic}: {one.count} unreadable message{'s' if one.count > 1 else ''}, the first is number "
                f"{one.index} at {one.stamp} ns: {one.reason}" for topic, one in self._topics.items()]
