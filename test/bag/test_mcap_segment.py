"""One MCAP file as rosbag2 writes it, and the records that readers believe."""

from zlib import crc32

import lz4.frame
import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Chunk, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader

from vibro_ros.bag.mcap_scan import MalformedError, chunk_content, parsed
from vibro_ros.bag.mcap_segment import CHUNK_SIZE, HEAD, McapSegment, packed, zstd
from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.messages.codec import jazzy_types

ODOMETRY = "nav_msgs/msg/Odometry"
TOPICS = defined([Topic("/odom", ODOMETRY, 10), Topic("/motor_power", "std_msgs/msg/Float64", 10)])


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run_0.mcap"


@pytest.fixture
def segment(path):
    segment = McapSegment(path, TOPICS, "early", "none")
    yield segment
    segment.abandon()


def records(path, **options):
    found = []
    with path.open("rb") as file, pytest.raises(EndOfFile):  # not sealed yet
        for record in StreamReader(file, **options).records:
            found.append(record)
    return found


def summary(path):
    with path.open("rb") as file:
        return make_reader(file).get_summary()


def chunk(records: bytes, compression: str = "", data: bytes | None = None, crc: int | None = None) -> Chunk:
    return Chunk(compression=compression, data=records if data is None else data, message_start_time=0,
                 message_end_time=0, uncompressed_crc=crc32(records) if crc is None else crc,
                 uncompressed_size=len(records))


@pytest.mark.parametrize("compression, pack", [("", bytes), ("zstd", zstd.compress), ("lz4", lz4.frame.compress)])
def test_chunks_of_every_compression_are_read(compression, pack):
    assert chunk_content(chunk(b"data" * 9, compression, pack(b"data" * 9))) == b"data" * 9


@pytest.mark.parametrize("damaged", [
    chunk(b"data", crc=1),
    chunk(b"data", "zstd", b"data"),
    chunk(b"data", "lz4", b"data"),
    chunk(b"data", "bz2", b"packed", crc=0),
], ids=["checksum", "zstd", "lz4", "unknown"])
def test_a_damaged_chunk_is_one_kind_of_error(damaged):
    with pytest.raises(MalformedError, match="a chunk "):
        chunk_content(damaged)


def test_a_record_is_read_whole_or_not_at_all():
    """The library takes what is left of a text for all of it."""
    content = packed(Schema(id=1, data=b"float64 data", encoding="ros2msg", name="x/msg/X"))[HEAD.size:]
    assert parsed(Schema, content).data == b"float64 data"
    for size in range(len(content)):
        with pytest.raises(MalformedError):
            parsed(Schema, content[:size])
    with pytest.raises(MalformedError):
        parsed(Schema, content.replace(b"ros2msg", b"ros2\xff\xff\xff"))
    with pytest.raises(MalformedError):
        parsed(Chunk, packed(chunk(b"data"))[HEAD.size:].replace((4).to_bytes(8, "little"), b"\xff" * 8))


def test_flush_puts_every_message_on_the_disk(segment, path, published):
    for i in range(3):
        segment.write(1, i, published["/odom"](i))
    assert segment.stored == 0
    segment.flush()
    assert segment.stored == 3
    assert [record.data for record in records(path) if type(record).__name__ == "Message"] == [
        published["/odom"](i) for i in range(3)]


def test_a_long_silence_of_flush_does_not_fill_the_memory(segment, path):
    for i in range(3):
        segment.write(1, i, bytes(CHUNK_SIZE))
    assert segment.stored == 3


def test_chunks_have_a_checksum_and_an_index_of_every_message(segment, path, published):
    for i in range(10):
        segment.write(1 + i % 2, i, published["/odom"](i))
    segment.flush()
    segment.seal("late")
    with path.open("rb") as file:
        assert len(list(make_reader(file, validate_crcs=True).iter_messages())) == 10
    with path.open("rb") as file:
        chunk = next(record for record in StreamReader(file, emit_chunks=True).records
                     if type(record).__name__ == "Chunk")
    assert chunk.uncompressed_crc != 0
    (index,) = summary(path).chunk_indexes
    assert (index.message_start_time, index.message_end_time, sorted(index.message_index_offsets)) == (0, 9, [1, 2])
    assert summary(path).statistics.channel_message_counts == {1: 5, 2: 5}


def test_channel_carries_qos_and_type_hash_as_rosbag2_writes_them(segment, path):
    segment.seal("late")
    channel = summary(path).channels[1]
    assert channel.metadata["topic_type_hash"] == jazzy_types().hash_rihs01(ODOMETRY)
    [qos] = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert (qos["reliability"], qos["history"], qos["depth"], qos["durability"]) == (
        "reliable", "keep_last", 10, "volatile")


def test_empty_file_is_sealed_readable_and_not_from_the_far_future(segment, path):
    segment.seal("late")
    statistics = summary(path).statistics
    assert (statistics.message_count, statistics.message_start_time, statistics.message_end_time) == (0, 0, 0)
    with Reader(path) as reader:
        assert (reader.message_count, [one.topic for one in reader.connections]) == (0, ["/odom", "/motor_power"])
