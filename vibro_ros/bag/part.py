"""What each file of a bag offers to readers, whatever its format."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from vibro_ros.bag.metadata import FileInformation, TopicInformation

Message = tuple[str, int, bytes]
"""Topic, recorded stamp [ns], serialised message."""

CDR = "cdr"


@dataclass
class PartContents:
    """What one file holds.

    Attributes
    ----------
    information : FileInformation
        Its name, times, and readable messages by topic.
    topics : list of TopicInformation
        Each topic of `information`, once.
    custom : mapping of str to str
        Custom data that the file keeps inside.
    ordered : bool
        Whether every message is at least as late as the one before.
    flaws : list of str
        What of it is not read, one line each.
    """

    information: FileInformation
    topics: list[TopicInformation]
    custom: Mapping[str, str] = field(default_factory=dict)
    ordered: bool = True
    flaws: list[str] = field(default_factory=list)


class Part(Protocol):
    """A file of a bag that was looked through; it is open only while it is read.

    Attributes
    ----------
    contents : PartContents
        What it holds.
    is_sealed : bool
        Whether it has its ending, which tells the same.
    damaged : int
        Bytes of it that cannot be read, behind which others can.
    """

    contents: PartContents
    is_sealed: bool
    damaged: int

    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """The messages of some topics, as they lie in the file (OSError when it cannot be opened any more).

        What can no longer be read is added to the flaws.
        """
