"""A recording whose every number is known exactly."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from vibro_ros.bag.recorder import Recorder, Topic

START = 1_763_700_000_000_000_000  # ns
PERIOD = 5_000_000  # ns
TYPES = {
    "odom": "nav_msgs/msg/Odometry", "joint_states": "sensor_msgs/msg/JointState",
    "ground_contact": "geometry_msgs/msg/WrenchStamped", "impacts": "geometry_msgs/msg/WrenchStamped",
    "motor_power": "std_msgs/msg/Float64", "motor_speed": "std_msgs/msg/Float64",
}
JOINTS = ["crank", "upper_mass", "inclined_mass", "upper_plate", "inclined_plate"]
SPEED = -0.25  # m/s, body
CRANK_SPEED = 20 * np.pi  # rad/s: 10 turns a second
UPPER_IMPACTS, INCLINED_IMPACTS = 60, 30


class _Messages:
    """Serialised messages of one instant t [s] after START."""

    def __init__(self) -> None:
        self._store = get_typestore(Stores.ROS2_JAZZY)

    def _make(self, name: str, /, **fields):
        return self._store.types[name](**fields)

    def _bytes(self, name: str, /, **fields) -> bytes:
        return bytes(self._store.serialize_cdr(self._make(TYPES[name], **fields), TYPES[name]))

    def _header(self, stamp: int, frame: str = ""):
        seconds, nanoseconds = divmod(stamp, 10**9)
        time = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        return self._make("std_msgs/msg/Header", stamp=time, frame_id=frame)

    def _vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0):
        return self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def odom(self, stamp: int, x: float, speed: float) -> bytes:
        position = self._make("geometry_msgs/msg/Point", x=x, y=0.0, z=0.0)
        orientation = self._make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = self._make("geometry_msgs/msg/Pose", position=position, orientation=orientation)
        twist = self._make("geometry_msgs/msg/Twist", linear=self._vector(speed), angular=self._vector())
        return self._bytes(
            "odom", header=self._header(stamp, "odom"), child_frame_id="base_link",
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)))

    def joint_states(self, stamp: int, position: list[float], velocity: list[float], names: list[str]) -> bytes:
        return self._bytes("joint_states", header=self._header(stamp), name=names, position=np.array(position),
                           velocity=np.array(velocity), effort=np.zeros(len(names)))

    def wrench(self, stamp: int, frame: str, z: float) -> bytes:
        wrench = self._make("geometry_msgs/msg/Wrench", force=self._vector(z=z), torque=self._vector())
        return self._bytes("impacts", header=self._header(stamp, frame), wrench=wrench)

    def number(self, value: float) -> bytes:
        return self._bytes("motor_power", data=value)


def _rows(count: int, gap: tuple[float, float], joints: list[str]):
    """(stamp, topic, bytes) of everything, in order of time."""
    messages = _Messages()
    duration = (count - 1) * PERIOD * 1e-9
    yield START, "motor_speed", messages.number(CRANK_SPEED)
    for i in range(count):
        t, stamp = i * PERIOD * 1e-9, START + i * PERIOD
        if gap[0] < t < gap[1]:
            continue
        yield stamp, "odom", messages.odom(stamp, 1.0 + SPEED * t, SPEED)
        swing = 0.02 * np.cos(CRANK_SPEED * t)
        known = {"crank": (CRANK_SPEED * t, CRANK_SPEED), "upper_mass": (0.04 + swing, 0.0),
                 "inclined_mass": (0.04 - swing, 0.0), "upper_plate": (0.06, 0.0), "inclined_plate": (0.061, 0.0)}
        position, velocity = zip(*(known[name] for name in joints), strict=True)
        yield stamp, "joint_states", messages.joint_states(stamp, position, velocity, joints)
        yield stamp, "ground_contact", messages.wrench(stamp, "base_link", 11.6)
        yield stamp, "motor_power", messages.number(2.0 + t)
    for frame, impacts in (("upper_plate", UPPER_IMPACTS), ("inclined_plate", INCLINED_IMPACTS)):
        for k in range(impacts):
            stamp = START + round((k + 0.5) / impacts * duration * 1e9)
            yield stamp, "impacts", messages.wrench(stamp, frame, 1000.0)


@pytest.fixture(scope="session")
def known_run(tmp_path_factory) -> Callable[..., Path]:
    """Gives a recording of these options, made when first asked for; it is shared, so nobody may change it.

    A body at SPEED, a crank at CRANK_SPEED, a power of 2 W + 1 W/s · t and evenly spread impacts.
    """
    made: dict[str, Path] = {}

    def give(name: str = "run", **options) -> Path:
        key = f"{name} {sorted(options.items())}"
        if key not in made:
            made[key] = tmp_path_factory.mktemp("known") / name
            _record(made[key], **options)
        return made[key]
    return give


def _record(folder: Path, count: int = 801, gap: tuple[float, float] = (0.0, 0.0), namespace: str = "",
            without: tuple[str, ...] = (), joints: list[str] = JOINTS) -> None:
    topics = [Topic(f"{namespace}/{topic}", kind, 10) for topic, kind in TYPES.items() if topic not in without]
    rows = sorted(_rows(count, gap, joints), key=lambda row: row[0]) if count else []
    with Recorder(folder, topics, {"scene": "device"}) as recorder:
        written = [recorder.write(f"{namespace}/{topic}", stamp, data) for stamp, topic, data in rows
                   if topic not in without]
    assert all(written) and recorder.fault is None


@pytest.fixture
def record_run(known_run, tmp_path) -> Callable[..., Path]:
    """Gives a copy of a `known_run` in the test's folder."""
    def record(name: str = "run", **options) -> Path:
        return Path(shutil.copytree(known_run(name, **options), tmp_path / name))
    return record
