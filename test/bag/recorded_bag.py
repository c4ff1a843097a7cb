"""Messages that the tests record, and the contents of a bag's folder by readers that share no code with the package."""

import contextlib
import resource
from pathlib import Path

from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from vibro_ros.bag.recorder import Storage, Topic

TOPICS = (
    Topic("/odom", "nav_msgs/msg/Odometry", 10),
    Topic("/joint_states", "sensor_msgs/msg/JointState", 10),
    Topic("/impacts", "geometry_msgs/msg/WrenchStamped", 1000),
    Topic("/motor_power", "std_msgs/msg/Float64", 10),
)
POWER = TOPICS[3:]
METADATA = {"scene": "device", "parameters": "guide.angle: 0.87", "version": "0.1", "start": "2026-11-21T10:00:00"}
STORAGES = {"mcap": Storage(), "zstd": Storage(compression="zstd"), "split": Storage(max_size=100_000)}


def mcap_file(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


def by_rosbags(folder: Path) -> list[tuple[str, int, bytes]]:
    with Reader(folder) as reader:
        messages = [(connection.topic, stamp, bytes(data)) for connection, stamp, data in reader.messages()]
        assert len(messages) == reader.message_count == sum(connection.msgcount for connection in reader.connections)
    return messages


def by_mcap(folder: Path) -> list[tuple[str, int, bytes]]:
    messages_of_files = []
    for path in sorted(folder.glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2])):
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            messages = [(channel.topic, message.log_time, message.data) for _, channel, message in
                        reader.iter_messages()]
            assert len(messages) == reader.get_summary().statistics.message_count
        messages_of_files += messages
    return messages_of_files


def torn(folder: Path) -> dict[str, bytes]:
    """Return the files that `recover` has cut off and kept."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.torn*"))}


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@contextlib.contextmanager
def no_file_larger_than(size: int):
    """Make writes beyond so many bytes of a file fail, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
