"""Messages as a publisher serialises them, bags made of them, and readers that share no code with the recorder."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from recorded_bag import POWER
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from vibro_ros.bag.metadata import defined
from vibro_ros.bag.recorder import BagWriter, Storage

START = 1_763_700_000_000_000_000  # ns, an instant in 2025


@pytest.fixture
def folder(tmp_path) -> Path:
    return tmp_path / "run"


@pytest.fixture
def start_ns() -> int:
    return START


def _stamped(message, stamp_ns: int, frame: str):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    message.header.frame_id = frame
    return message


@pytest.fixture
def published() -> dict[str, Callable[[int], bytes]]:
    """Return messages by topic: the i-th as rclpy publishes it, stamped START + i ms, with numbers made from i."""
    def odom(i: int) -> bytes:
        message = _stamped(Odometry(child_frame_id="base_link"), START + i * 1_000_000, "odom")
        message.pose.pose.position.x, message.pose.pose.orientation.w = 0.1 * i, 1.0
        message.twist.twist.linear.x, message.twist.twist.angular.z = -0.5 * i, 2.0 * i
        return serialize_message(message)

    def joint_states(i: int) -> bytes:
        message = JointState(name=["crank", "upper_mass"], position=[0.1 * i, 0.06],
                             velocity=[100.0, -1.0 * i], effort=[0.5, 0.25])
        return serialize_message(_stamped(message, START + i * 1_000_000, ""))

    def impacts(i: int) -> bytes:
        message = _stamped(WrenchStamped(), START + i * 1_000_000 - 1, ("upper_plate", "inclined_plate")[i % 2])
        message.wrench.force.z, message.wrench.torque.y = 900.0 + i, 0.5
        return serialize_message(message)

    return {"/odom": odom, "/joint_states": joint_states, "/impacts": impacts,
            "/motor_power": lambda i: serialize_message(Float64(data=0.25 * i))}


def _recorded(path: Path) -> Iterator[tuple[str, int, bytes]]:
    topics = {}
    with path.open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if type(record).__name__ == "Channel":
                    topics[record.id] = record.topic
                if isinstance(record, Message):
                    yield topics[record.channel_id], record.log_time, record.data
        except EndOfFile:
            return


@pytest.fixture
def recorded() -> Callable[[Path], list[tuple[str, int, bytes]]]:
    """Return a function that reads (topic, stamp, data) of a whole or cut MCAP file with the package `mcap`."""
    return lambda path: list(_recorded(path))


@pytest.fixture
def unsealed(tmp_path, published, start_ns):
    """Make the folder of a recorder that was killed after 60 messages; return the folder and the messages."""
    def make(storage: Storage = Storage(), samples: int = 60, name: str = "run") -> tuple[Path, list]:  # noqa: B008
        folder = tmp_path / name
        sent = [("/motor_power", start_ns + i * 5_000_000, published["/motor_power"](i)) for i in range(samples)]
        writer = BagWriter(folder, defined(POWER), {"scene": "device"}, storage)
        for i, message in enumerate(sent):
            writer.write(*message)
            if i in (samples // 2, samples - 1):
                writer.flush()  # a chunk of its own
        writer.abandon()
        return folder, sent
    return make
