"""The files of a bag: in time order, without overlap, within the limits, with one metadata.yaml for all."""

from datetime import datetime
from itertools import islice
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from recorded_bag import METADATA, POWER, by_rosbags
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from vibro_ros.bag.folders import bag_folders
from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.recorder import CHUNK_SIZE, BagWriter, Recorder, Storage
from vibro_ros.bag.stream import BagStream
from vibro_ros.messages.codec import jazzy_types
from vibro_ros.messages.topics import TOPICS as ROBOT_TOPICS
from vibro_ros.recordings.recover import recover

TOPICS = defined([Topic("/odom", "nav_msgs/msg/Odometry", 10), Topic("/motor_power", "std_msgs/msg/Float64", 10)])
PERIOD = 5_000_000  # ns
FLUSHED = 20_000  # bytes, at most, between two flushes
ENDING = 40_000  # bytes, at most, of topics, index and metadata at a file's end
SPLITS = {
    "size": Storage(max_size=100_000),
    "duration": Storage(max_duration=0.5),
    "size and duration": Storage(max_size=150_000, max_duration=0.3),
}


def write(folder: Path, storage: Storage, published, start_ns, samples: int = 400) -> list[tuple[str, int, bytes]]:
    """Record two topics with the same stamps and a flush every 0.1 s; returns what was written."""
    writer = BagWriter(folder, TOPICS, {"scene": "device"}, storage)
    sent = []
    for i in range(samples):
        for topic in ("/odom", "/motor_power"):
            sent.append((topic, start_ns + i * PERIOD, published[topic](i)))
            writer.write(*sent[-1])
        if i % 20 == 0:
            writer.flush()
    writer.flush()
    writer.close({"written": str(writer.stored)})
    return sent


def metadata(folder: Path) -> dict:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


@pytest.mark.parametrize("later", [Stores.ROS2_KILTED, Stores.ROS2_LYRICAL])
def test_later_distributions_have_the_same_definitions(later):
    store = get_typestore(later)
    for kind in {topic.type for topic in ROBOT_TOPICS.values()}:
        assert store.hash_rihs01(kind) == jazzy_types().hash_rihs01(kind)


@pytest.mark.parametrize("storage", SPLITS.values(), ids=SPLITS)
def test_a_split_bag_holds_every_message_in_files_that_do_not_overlap(tmp_path, published, start_ns, storage):
    folder = tmp_path / "run"
    sent = write(folder, storage, published, start_ns)
    assert by_rosbags(folder) == sent
    files = metadata(folder)["files"]
    assert len(files) > 2
    assert [file["path"] for file in files] == [f"run_{i}.mcap" for i in range(len(files))]
    assert metadata(folder)["relative_file_paths"] == [file["path"] for file in files]
    end = 0
    for file in files:
        with (folder / file["path"]).open("rb") as data:
            reader = make_reader(data, validate_crcs=True)
            *_, inside = reader.iter_metadata()  # what the bag says of itself is in each
            stamps = [message.log_time for _, _, message in reader.iter_messages()]
        about = yaml.safe_load(inside.metadata["serialized_metadata"])
        assert (about["relative_file_paths"], about["custom_data"]["scene"]) == ([file["path"]], "device")
        assert min(stamps) > end
        end = max(stamps)
        assert (file["starting_time"], file["duration"], file["message_count"]) == (
            {"nanoseconds_since_epoch": min(stamps)}, {"nanoseconds": end - min(stamps)}, len(stamps))
        if storage.max_size:
            assert (folder / file["path"]).stat().st_size <= storage.max_size + FLUSHED + ENDING
        if storage.max_duration:
            assert end - min(stamps) <= storage.max_duration * 1e9
    names = {path.name for path in folder.iterdir()}
    assert names == {"metadata.yaml", *(file["path"] for file in files)}


def test_full_chunks_are_written_without_a_flush(tmp_path, start_ns):
    writer = BagWriter(tmp_path / "run", TOPICS, {}, Storage())
    for i in range(4):
        writer.write("/odom", start_ns + i, bytes(CHUNK_SIZE))
    assert writer.stored >= 3
    writer.close({})


def test_an_empty_bag_has_no_duration(tmp_path):
    BagWriter(tmp_path / "run", TOPICS, {}, Storage()).close({})
    with Reader(tmp_path / "run") as reader:
        assert (reader.message_count, reader.duration) == (0, 0)
        assert [connection.topic for connection in reader.connections] == ["/odom", "/motor_power"]


def test_metadata_are_those_of_rosbag2_in_jazzy(tmp_path, published, start_ns):
    folder = tmp_path / "run"
    sent = write(folder, Storage(max_duration=1.0), published, start_ns)
    about = metadata(folder)
    assert (about["version"], about["storage_identifier"], about["ros_distro"]) == (9, "mcap", "jazzy")
    assert about["starting_time"] == {"nanoseconds_since_epoch": start_ns}
    assert about["duration"] == {"nanoseconds": 399 * PERIOD}
    assert about["message_count"] == len(sent) == 800
    assert (about["compression_format"], about["compression_mode"]) == ("", "")  # a chunk's is not the bag's
    assert about["custom_data"] == {"scene": "device", "written": "800"}
    odom = about["topics_with_message_count"][0]
    assert odom["message_count"] == 400
    assert odom["topic_metadata"]["type_description_hash"] == jazzy_types().hash_rihs01("nav_msgs/msg/Odometry")
    [qos] = odom["topic_metadata"]["offered_qos_profiles"]
    assert (qos["reliability"], qos["history"], qos["depth"], qos["durability"], qos["liveliness"]) == (
        "reliable", "keep_last", 10, "volatile", "automatic")


@pytest.mark.parametrize("given", [{}, {"max_size": 400_000}], ids=str)
def test_the_oldest_files_go_before_a_bag_exceeds_its_limit(tmp_path, published, start_ns, given):
    folder, limit = tmp_path / "run", 1_000_000
    writer = BagWriter(folder, TOPICS, {}, Storage(max_bytes=limit, **given))
    count = 2000  # about 1.6 MB
    for i in range(count):
        writer.write("/odom", start_ns + i * PERIOD, published["/odom"](i))
        if i % 50 == 0:
            writer.flush()
            assert sum(path.stat().st_size for path in folder.iterdir()) <= limit
    writer.flush()
    writer.close({})
    assert 0.3 * limit < sum(path.stat().st_size for path in folder.iterdir()) <= limit
    stamps = [stamp for _, stamp, _ in by_rosbags(folder)]
    assert stamps == [start_ns + i * PERIOD for i in range(count - len(stamps), count)]
    custom = metadata(folder)["custom_data"]
    assert int(custom["discarded_messages"]) == count - len(stamps)
    assert int(custom["discarded_files"]) > 0
    assert metadata(folder)["relative_file_paths"][0].startswith(f"run_{custom['discarded_files']}.")


def test_each_file_begins_with_the_messages_that_are_published_once(tmp_path, published, start_ns):
    folder, said = tmp_path / "run", published["/motor_power"](7)
    topics = [Topic("/odom", "nav_msgs/msg/Odometry", 10), Topic("/motor_power", "std_msgs/msg/Float64", 1, True)]
    with Recorder(folder, topics, {}, storage=SPLITS["size"]) as recorder:
        recorder.announce({}, [("/motor_power", said)])
        for i in range(400):
            recorder.write("/odom", start_ns + i * PERIOD, published["/odom"](i))
    files = [folder / file["path"] for file in metadata(folder)["files"]]
    assert len(files) > 1
    messages = by_rosbags(folder)
    firsts = [file["starting_time"]["nanoseconds_since_epoch"] for file in metadata(folder)["files"]]
    assert [message for message in messages if message[0] == "/motor_power"] == [
        ("/motor_power", first, said) for first in firsts]
    assert [stamp for topic, stamp, _ in messages if topic == "/odom"] == [start_ns + i * PERIOD for i in range(400)]
    assert (recorder.written, recorder.dropped, recorder.lost) == (400 + len(files), 0, 0)


def test_messages_out_of_order_do_not_make_files_overlap(tmp_path, published, start_ns):
    folder = tmp_path / "run"
    writer = BagWriter(folder, TOPICS, {}, Storage(max_duration=0.1))
    for i in (0, 30, 20, 10, 40):  # x 5 ms: 30 begins a file, 20 and 10 come late
        writer.write("/motor_power", start_ns + i * PERIOD, published["/motor_power"](i))
    writer.flush()
    writer.close({})
    assert len(by_rosbags(folder)) == 5


@pytest.mark.parametrize("wrong, reason", [
    ({"max_size": 10}, "record.max_size: 10 is too small; give 0 for no limit, or at least 100000 bytes"),
    ({"max_duration": 0.01}, "record.max_duration: 0.01 is too small; give 0 for no limit, or at least 0.1 s"),
    ({"max_bytes": 1000}, "record.max_bytes: 1000 is too small"),
    ({"max_bytes": 1_000_000, "max_size": 900_000}, "record.max_size: 900000 does not fit twice"),
])
def test_invalid_limits_are_refused(wrong, reason):
    with pytest.raises(ValueError, match=reason):
        Storage(**wrong)


def test_later_custom_data_are_in_killed_and_in_sealed_bags(tmp_path):
    for name, killed in (("killed", True), ("sealed", False)):
        writer = BagWriter(tmp_path / name, defined(POWER), {"scene": "device", "start": "1"}, Storage())
        writer.describe({"start": "5"})
        writer.write("/motor_power", 7, bytes(12))
        writer.flush()
        if killed:
            writer.abandon()
            recover(tmp_path / name)
        else:
            writer.close({"lost": "0"})
        metadata = BagStream(tmp_path / name).metadata
        assert (metadata["scene"], metadata["start"]) == ("device", "5")


def test_a_recorder_describes_before_the_messages_that_follow(tmp_path):
    with Recorder(tmp_path / "run", POWER, {"start": "1"}) as recorder:
        recorder.announce({"start": "5"}, [])
        assert recorder.write("/motor_power", 7, bytes(12))
    data = next((tmp_path / "run").glob("*.mcap")).read_bytes()
    assert BagStream(tmp_path / "run").metadata["start"] == "5"
    assert data.index(b"start: '5'") < data.index((7).to_bytes(8, "little") * 2)  # its two stamps


def test_existing_folder_is_never_written_to(folder):
    folder.mkdir()
    (folder / "precious").write_text("data")
    with pytest.raises(FileExistsError, match="exists already; a recording never overwrites"):
        Recorder(folder, POWER, METADATA)
    assert [path.name for path in folder.iterdir()] == ["precious"]


def test_folder_that_cannot_be_made_is_a_one_line_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"^cannot record to .*file/run: Not a directory; give a folder") as raised:
        Recorder(tmp_path / "file" / "run", POWER, METADATA)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("topics", "reason"), [
    ([Topic("/x", "no_such_msgs/msg/Thing", 10)], "/x: unknown message type 'no_such_msgs/msg/Thing'"),
    ([*POWER, *POWER], "/motor_power: given twice"),
])
def test_bad_topics_are_refused_before_anything_is_made(folder, topics, reason):
    with pytest.raises(ValueError, match=reason):
        Recorder(folder, topics, METADATA)
    assert not folder.exists()


def test_two_recordings_in_one_second_get_two_folders(tmp_path):
    now = datetime(2026, 11, 21, 10, 20, 30)
    first = "vibro_robot_2026_11_21-10_20_30"
    names = [folder.name for folder in islice(bag_folders(tmp_path, now), 3)]
    assert names == [first, f"{first}_2", f"{first}_3"]
