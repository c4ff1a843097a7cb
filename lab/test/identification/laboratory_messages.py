"""Messages of sensors in a laboratory, from arrays of what they have measured; and a bag of them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.recorder import BagWriter, Storage
from vibro_ros.messages.codec import new_message, serialised
from vibro_ros.messages.topics import TOPICS

START = 1_763_700_000_000_000_000  # ns
Row = tuple[str, int, bytes]  # topic, recorded stamp [ns], message


def stamp(time: float) -> int:
    return START + round(time * 1e9)


def odometry(times: np.ndarray, position: np.ndarray, velocity: np.ndarray,
             variances: tuple[float, float] = (0.0, 0.0), topic: str = "/odom") -> Iterator[Row]:
    """Positions [m] and velocities [m/s] of the body, along x or with rows x, z, and their variances."""
    for time, (x, z), (v, w) in zip(times, _two(position), _two(velocity), strict=True):
        message = _stamped("odom", time)
        message.pose.pose.position.x, message.pose.pose.position.z = x, z
        message.twist.twist.linear.x, message.twist.twist.linear.z = v, w
        message.pose.covariance[::7], message.twist.covariance[::7] = variances
        yield topic, stamp(time), serialised(message, TOPICS["odom"].type)


def tracking(times: np.ndarray, position: np.ndarray, variance: float = 0.0) -> Iterator[Row]:
    """Positions [m] of the body, along x or with rows x, z, and their variance."""
    for time, (x, z) in zip(times, _two(position), strict=True):
        message = _stamped("tracking", time)
        message.pose.pose.position.x, message.pose.pose.position.z = x, z
        message.pose.covariance[::7] = variance
        yield "/tracking", stamp(time), serialised(message, TOPICS["tracking"].type)


def joint_states(times: np.ndarray, joints: Mapping[str, Sequence[np.ndarray]],
                 topic: str = "joint_states") -> Iterator[Row]:
    """Positions, and velocities if there are any, of joints."""
    for i, time in enumerate(times):
        message = _stamped(topic, time)
        message.name = list(joints)
        message.position, message.velocity = ([arrays[part][i] for arrays in joints.values() if part < len(arrays)]
                                              for part in (0, 1))
        yield f"/{topic}", stamp(time), serialised(message, TOPICS[topic].type)


def imu(times: np.ndarray, along: np.ndarray, up: np.ndarray, variance: float = 0.0) -> Iterator[Row]:
    """Specific force [m/s²] along x and z, with its variance."""
    for time, x, z in zip(times, along, up, strict=True):
        message = _stamped("imu/data_raw", time)
        message.linear_acceleration.x, message.linear_acceleration.z = x, z
        message.linear_acceleration_covariance[::4], message.orientation_covariance[0] = variance, -1.0
        yield "/imu/data_raw", stamp(time), serialised(message, TOPICS["imu/data_raw"].type)


def numbers(topic: str, values: Iterable[tuple[float, float]]) -> Iterator[Row]:
    """Pairs of an instant [s] and a number on a topic of numbers, such as a command."""
    for time, value in values:
        message = new_message(TOPICS[topic].type)
        message.data = value
        yield f"/{topic}", stamp(time), serialised(message, TOPICS[topic].type)


def written(folder: Path, *rows: Iterable[Row], custom: Mapping[str, str] | None = None) -> Path:
    """Write a bag of the rows, in the order of their stamps."""
    messages = sorted((row for some in rows for row in some), key=lambda row: row[1])
    names = {topic: next(name for name in TOPICS if topic.endswith(f"/{name}")) for topic, _, _ in messages}
    writer = BagWriter(folder, defined([Topic(topic, TOPICS[name].type, 10) for topic, name in names.items()]),
                       dict(custom or {}), Storage())
    for count, row in enumerate(messages):
        writer.write(*row)
        if count % 1000 == 0:
            writer.flush()
    writer.flush()
    writer.close({})
    return folder


def _two(values: np.ndarray) -> np.ndarray:
    return np.column_stack([values, np.zeros(len(values))]) if np.ndim(values) == 1 else np.transpose(values)


def _stamped(topic: str, time: float) -> object:
    message = new_message(TOPICS[topic].type)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp(time), 10**9)
    return message
