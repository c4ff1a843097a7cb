"""Go through an MCAP file record by record, over what is damaged, to where it is torn.

Nothing that a file says of itself is believed: each length is held against the file's own, each chunk is unfolded and
compared with its checksum, and the summary with what was found. What cannot be read is jumped over, to the next record
or, where the records' own lengths are lost, to the next chunk.
"""

from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Header

from vibro_ros.bag.mcap_gathering import INDEX_HEAD, Gathering, Scan
from vibro_ros.bag.mcap_records import HEAD, LARGEST_RECORD, MAGIC, MalformedError, parsed
from vibro_ros.bag.mcap_search import next_chunk
from vibro_ros.bag.mcap_summary import is_footer_reached, is_summary_true

_OF_DATA = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX,
                      Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END})
_NEVER_IN_SUMMARY = frozenset({Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX})
_DATA_END_LENGTH = 4
_LONGEST_HEADER = 2**20  # bytes


class ForeignFileError(ValueError):
    """A file that is no ROS 2 recording; the message says why."""


def scan(file: BinaryIO, size: int) -> Scan:
    """Read the first `size` bytes of an MCAP file as far as they can be read.

    Raises
    ------
    ForeignFileError
        When the file is empty, no MCAP, or not of ROS 2.
    OSError
        When it cannot be read.
    """
    return _Scanner(file, size).run()


class _Scanner:
    """A scan on its way through the file, over what cannot be read."""

    def __init__(self, file: BinaryIO, size: int):
        self._file = file
        self._found = Scan(size=size)
        self._gathering = Gathering(file, self._found)
        self._damage: list[tuple[int, str]] = []  # bytes and reasons, since the last record that is readable

    def run(self) -> Scan:
        found = self._found
        found.end = self._header()
        ended = self._scan_data(found.end)
        self._gathering.finish_chunk(last=not ended)
        if ended:
            self._accept_damage()
            found.end, found.ended = ended, True
            found.sealed = is_summary_true(self._file, ended, found.contents, whole=not found.damaged)
        return found

    def _header(self) -> int:
        """Offset of the first record after the header."""
        if self._found.size == 0:
            raise ForeignFileError("the file is empty, nothing was recorded")
        if self._read(0, len(MAGIC)) != MAGIC[:self._found.size]:
            raise ForeignFileError("not an MCAP file")
        if self._found.size < len(MAGIC) + HEAD.size:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        opcode, length = HEAD.unpack(self._read(len(MAGIC), HEAD.size))
        end = len(MAGIC) + HEAD.size + length
        if opcode != Opcode.HEADER or end > self._found.size or length > _LONGEST_HEADER:
            raise ForeignFileError("the file ends within its header, nothing was recorded")
        try:
            profile = parsed(Header, self._read(end - length, length)).profile
        except MalformedError as error:
            raise ForeignFileError(f"its header cannot be read: {error}") from error
        if profile != "ros2":
            raise ForeignFileError(f"an MCAP file, but not of ROS 2: its profile is {profile!r}")
        return end

    def _scan_data(self, at: int) -> int:
        """Take every record from the offset `at` on; offset of the end of data when the file has its footer, else 0."""
        while True:
            head = self._head(at)
            reason = "not a record"
            if head:
                opcode, length = head
                if opcode == Opcode.DATA_END and is_footer_reached(self._file, at, self._found.size):
                    return at
                reason = self._take(opcode, at, length)
            if reason:
                after = self._beyond(at, head)
                if not after:
                    return 0
                self._damage.append((after - at, f"{reason} at byte {at}"))
                at = after
            else:
                at += HEAD.size + length

    def _head(self, at: int) -> tuple[int, int] | None:
        """Opcode and length of the record at an offset; None where none can be."""
        if at + HEAD.size > self._found.size:
            return None
        opcode, length = HEAD.unpack(self._read(at, HEAD.size))
        if opcode not in _OF_DATA or at + HEAD.size + length > self._found.size:
            return None
        return None if opcode == Opcode.DATA_END and length != _DATA_END_LENGTH else (opcode, length)

    def _beyond(self, at: int, head: tuple[int, int] | None) -> int:
        """Where to go on behind an unreadable record at an offset; 0 when nothing follows."""
        chunk = next_chunk(self._file, at + 1, self._found.size)
        following = at + HEAD.size + head[1] if head else 0
        next_head = self._head(following) if following else None
        if head and next_head and head[0] == Opcode.DATA_END and next_head[0] not in _NEVER_IN_SUMMARY:
            return chunk  # a summary that is torn begins with topics, as data do
        return following if next_head and not 0 < chunk < following else chunk

    def _take(self, opcode: int, offset: int, length: int) -> str:
        """Take a record in; why not, or nothing."""
        try:
            if opcode == Opcode.DATA_END:
                raise MalformedError("an end of data that does not end the file")
            if length > LARGEST_RECORD and opcode != Opcode.ATTACHMENT:
                raise MalformedError(f"a record of {length} bytes, more than {LARGEST_RECORD}")
            if opcode == Opcode.MESSAGE_INDEX:
                self._gathering.see_index(offset, length, self._read(offset + HEAD.size, INDEX_HEAD))
                return ""
            content = b"" if opcode == Opcode.ATTACHMENT else self._read(offset + HEAD.size, length)
            self._gathering.finish_chunk(last=False)
            self._gathering.take_record(opcode, offset, content)
        except MalformedError as error:
            return str(error)
        self._accept_damage()
        self._found.end = offset + HEAD.size + length
        return ""

    def _accept_damage(self) -> None:
        """What lies between readable records stays in the file, unindexed."""
        self._found.damaged += sum(size for size, _ in self._damage)
        self._found.damage = self._found.damage or next((reason for _, reason in self._damage), "")
        self._damage.clear()

    def _read(self, at: int, size: int) -> bytes:
        self._file.seek(at)
        data = self._file.read(size)
        if len(data) < min(size, self._found.size - at):
            raise MalformedError("the file was cut while it was read")
        return data
