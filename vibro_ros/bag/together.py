"""Messages that come together: side by side in one piece of bytes, which costs the caller as much as one message."""

from collections.abc import Iterator, Sequence


class Together:
    """Where the messages of some topics stand in a piece of bytes, the same each time.

    Parameters
    ----------
    places : sequence of (str, int, int)
        Of each message: its topic, and where it begins and ends.
    """

    def __init__(self, places: Sequence[tuple[str, int, int]]):
        self.places = tuple(places)

    def split(self, data: bytes) -> Iterator[tuple[str, bytes]]:
        """Topic and message, one after the other."""
        return ((topic, data[begin:end]) for topic, begin, end in self.places)
