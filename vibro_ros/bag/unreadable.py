"""Messages of a bag that are not what their topic says."""

from dataclasses import dataclass


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
