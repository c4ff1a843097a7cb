"""The contract with rosbags' internals, which `vibro_ros.bag.storage` touches."""

from importlib.metadata import version

import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader

from vibro_ros.bag.storage import FlushedWriter, jazzy_types, reliable_qos

ODOMETRY = "nav_msgs/msg/Odometry"


@pytest.fixture
def writer(tmp_path):
    writer = FlushedWriter(tmp_path / "run")
    writer.open()
    yield writer
    if writer.storage:
        writer.abort()


def announce(writer, topic="/odom", type_name=ODOMETRY):
    return writer.add_connection(topic, type_name, typestore=jazzy_types(), offered_qos_profiles=[reliable_qos(10)])


def records(path, **options):
    found = []
    with path.open("rb") as file, pytest.raises(EndOfFile):  # not sealed yet
        for record in StreamReader(file, **options).records:
            found.append(record)
    return found


def test_rosbags_is_the_version_whose_internals_were_read():
    assert version("rosbags") == "0.11.9"


def test_flush_puts_schemas_and_channels_on_the_disk_before_any_message(writer, tmp_path):
    announce(writer)
    writer.flush()
    kinds = [type(record).__name__ for record in records(tmp_path / "run" / "run_0.mcap")]
    assert kinds == ["Header", "Schema", "Channel"]


def test_flush_puts_every_message_on_the_disk(writer, tmp_path, published):
    odom = announce(writer)
    for i in range(3):
        writer.write(odom, i, published["/odom"](i))
    writer.flush()
    kinds = [type(record).__name__ for record in records(tmp_path / "run" / "run_0.mcap")]
    assert kinds.count("Message") == 3


def test_flush_without_news_writes_nothing(writer, tmp_path):
    announce(writer)
    writer.flush()
    size = (tmp_path / "run" / "run_0.mcap").stat().st_size
    writer.flush()
    assert (tmp_path / "run" / "run_0.mcap").stat().st_size == size


def test_chunk_without_messages_begins_at_zero_as_the_standard_wants(writer, tmp_path):
    announce(writer)
    writer.flush()
    chunk = records(tmp_path / "run" / "run_0.mcap", emit_chunks=True)[1]
    assert (chunk.message_start_time, chunk.message_end_time) == (0, 0)


def test_channel_carries_qos_and_type_hash_as_rosbag2_writes_them(writer, tmp_path):
    announce(writer)
    writer.close()
    with (tmp_path / "run" / "run_0.mcap").open("rb") as file:
        [channel] = make_reader(file).get_summary().channels.values()
    assert channel.metadata["topic_type_hash"] == jazzy_types().hash_rihs01(ODOMETRY)
    [qos] = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert (qos["reliability"], qos["history"], qos["depth"], qos["durability"]) == (
        "reliable", "keep_last", 10, "volatile")


def test_metadata_is_version_9_and_names_the_numbered_file(writer, tmp_path):
    announce(writer)
    writer.close()
    metadata = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (metadata["version"], metadata["storage_identifier"]) == (9, "mcap")
    assert metadata["relative_file_paths"] == ["run_0.mcap"]


def test_empty_bag_is_sealed_readable_and_not_from_the_far_future(writer, tmp_path):
    announce(writer)
    writer.close()
    with (tmp_path / "run" / "run_0.mcap").open("rb") as file:
        statistics = make_reader(file).get_summary().statistics
    assert (statistics.message_count, statistics.message_start_time) == (0, 0)
    metadata = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert metadata["starting_time"] == {"nanoseconds_since_epoch": 0}
    with Reader(tmp_path / "run") as reader:
        assert (reader.message_count, [one.topic for one in reader.connections]) == (0, ["/odom"])


def test_flush_of_a_removed_file_is_an_error(writer, tmp_path):
    announce(writer)
    (tmp_path / "run" / "run_0.mcap").unlink()
    with pytest.raises(FileNotFoundError):
        writer.flush()
