"""Reading of MCAP records: each is read as written or refused with one kind of error, within a bound of memory."""

import subprocess
import sys
from zlib import crc32

import lz4.frame
import pytest
import zstandard
from hostile_bags import HEAD, OF_MCAP
from mcap.opcode import Opcode
from mcap.records import Chunk, Schema
from mcap.writer import Writer
from recorded_bag import POWER, mcap_file

from vibro_ros.bag.mcap_file import DamagedError, McapFile, records_in, unfolded
from vibro_ros.bag.mcap_writer import record_bytes
from vibro_ros.bag.reader import BagError, load_bag
from vibro_ros.bag.recorder import Recorder, Storage


def chunk(records: bytes, compression: str = "", data: bytes | None = None, crc: int | None = None) -> Chunk:
    return Chunk(compression=compression, data=records if data is None else data, message_start_time=0,
                 message_end_time=0, uncompressed_crc=crc32(records) if crc is None else crc,
                 uncompressed_size=len(records))


@pytest.mark.parametrize("compression, pack", [("", bytes), ("zstd", zstandard.compress), ("lz4", lz4.frame.compress)])
def test_chunks_of_every_compression_are_read(compression, pack):
    assert unfolded(chunk(b"data" * 9, compression, pack(b"data" * 9))) == b"data" * 9


@pytest.mark.parametrize("damaged", [
    chunk(b"data", crc=1),
    chunk(b"data", "zstd", b"data"),
    chunk(b"data", "lz4", b"data"),
    chunk(b"data", "bz2", b"packed", crc=0),
], ids=["checksum", "zstd", "lz4", "unknown"])
def test_a_damaged_chunk_is_one_kind_of_error(damaged):
    with pytest.raises(DamagedError, match="a chunk "):
        unfolded(damaged)


def test_a_record_that_ends_beyond_its_chunk_is_one_kind_of_error():
    whole = record_bytes(Schema(id=1, data=b"float64 data", encoding="ros2msg", name="x/msg/X"))
    assert list(records_in(whole)) == [(Opcode.SCHEMA, HEAD.size, len(whole))]
    for size in range(1, len(whole)):
        with pytest.raises(DamagedError, match="a record ends too early"):
            list(records_in(whole[:size]))
    with pytest.raises(DamagedError, match="not a record"):
        list(records_in(whole + bytes(HEAD.size)))


def foreign(path, profile, *channels):
    """Write a file of another program: `channels` are topic, message encoding, name and encoding of the schema."""
    path.parent.mkdir()
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile, "another")
        for topic, encoding, name, schema_encoding in channels:
            schema = writer.register_schema(name, schema_encoding, b"float64 data")
            writer.add_message(writer.register_channel(topic, encoding, schema), 5, bytes(12), 5)
        writer.finish()


@pytest.mark.parametrize("profile", ["", "ros2", "of another program"])
def test_a_file_with_channels_of_ros_2_is_read_whatever_its_profile_is(tmp_path, profile):
    foreign(tmp_path / "run" / "run_0.mcap", profile, ("/motor_power", "cdr", "std_msgs/msg/Float64", "ros2msg"),
            ("/scan", "protobuf", "foxglove.LaserScan", "protobuf"))
    bag = load_bag(tmp_path / "run")
    assert bag["motor_power"]["value"].tolist() == [0.0]
    assert any("messages on /scan are not read: their channel has no type of ROS 2" in flaw for flaw in bag.flaws)


def test_a_file_without_a_channel_of_ros_2_is_refused_with_its_encodings(tmp_path):
    foreign(tmp_path / "run" / "run_0.mcap", "", ("/scan", "protobuf", "foxglove.LaserScan", "protobuf"),
            ("/text", "json", "text", "jsonschema"))
    with pytest.raises(BagError, match="nothing in it can be read: run_0.mcap: an MCAP file, but not of ROS 2: its "
                                       "profile is '', and its messages are encoded as json, protobuf, not as CDR"):
        load_bag(tmp_path / "run")


def test_the_summary_of_a_sealed_file_names_topics_whose_chunk_is_damaged(tmp_path, published):
    with Recorder(tmp_path / "run", POWER, {}, storage=Storage()) as recorder:
        recorder.write("/motor_power", 1, published["/motor_power"](1))
    path = mcap_file(tmp_path / "run")
    data = bytearray(path.read_bytes())
    data[data.index(b"float64 data")] ^= 1
    path.write_bytes(data)
    assert [topic.name for topic in McapFile(path).topics] == ["/motor_power"]


MEASURED = """
import resource, sys
from pathlib import Path
from vibro_ros.bag.mcap_file import McapFile
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    McapFile(Path(sys.argv[1]))
except ValueError as error:  # its header may be damaged
    print(error, file=sys.stderr)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""
LARGEST = 100.0  # MB, beyond what the imports take


@pytest.mark.parametrize("name", ["bomb", "bomb that lies", "many bombs", "bomb of lz4", "a size of 2^63",
                                  "length 10000000000", "length ffffffffffffffff"])
def test_hostile_lengths_take_no_memory(unsealed, name):
    folder, _ = unsealed()
    OF_MCAP[name](folder)
    took = subprocess.run([sys.executable, "-c", MEASURED, str(mcap_file(folder))], capture_output=True, text=True,
                          check=True).stdout
    assert float(took) < LARGEST
