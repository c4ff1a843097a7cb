"""A recording whose every number is known exactly."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vibro_ros.bag.recorder import Recorder, Topic
from vibro_ros.messages.codec import new_message, serialised

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


def _message(topic: str, stamp: int, frame: str = "", **fields) -> bytes:
    """A message of a stamped topic; `fields` by their paths, with `__` between the parts."""
    message = new_message(TYPES[topic])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.header.frame_id = frame
    for path, value in fields.items():
        *parents, name = path.split("__")
        owner = message
        for parent in parents:
            owner = getattr(owner, parent)
        setattr(owner, name, value)
    return serialised(message, TYPES[topic])


def _number(value: float) -> bytes:
    message = new_message(TYPES["motor_power"])
    message.data = value
    return serialised(message, TYPES["motor_power"])


def _rows(count: int, gap: tuple[float, float], joints: list[str]):
    """Return (stamp, topic, bytes) of all messages, in order of time."""
    duration = (count - 1) * PERIOD * 1e-9
    yield START, "motor_speed", _number(CRANK_SPEED)
    for i in range(count):
        t, stamp = i * PERIOD * 1e-9, START + i * PERIOD
        if gap[0] < t < gap[1]:
            continue
        yield stamp, "odom", _message("odom", stamp, "odom", child_frame_id="base_link", pose__pose__orientation__w=1.0,
                                      pose__pose__position__x=1.0 + SPEED * t, twist__twist__linear__x=SPEED)
        swing = 0.02 * np.cos(CRANK_SPEED * t)
        known = {"crank": (CRANK_SPEED * t, CRANK_SPEED), "upper_mass": (0.04 + swing, 0.0),
                 "inclined_mass": (0.04 - swing, 0.0), "upper_plate": (0.06, 0.0), "inclined_plate": (0.061, 0.0)}
        position, velocity = zip(*(known[name] for name in joints), strict=True)
        yield stamp, "joint_states", _message("joint_states", stamp, name=list(joints), position=position,
                                              velocity=velocity, effort=np.zeros(len(joints)))
        yield stamp, "ground_contact", _message("ground_contact", stamp, "base_link", wrench__force__z=11.6)
        yield stamp, "motor_power", _number(2.0 + t)
    for frame, impacts in (("upper_plate", UPPER_IMPACTS), ("inclined_plate", INCLINED_IMPACTS)):
        for k in range(impacts):
            stamp = START + round((k + 0.5) / impacts * duration * 1e9)
            yield stamp, "impacts", _message("impacts", stamp, frame, wrench__force__z=1000.0)


@pytest.fixture(scope="session")
def known_run(tmp_path_factory) -> Callable[..., Path]:
    """Fixture: a function that returns a recording with these options. The recording is made at the first request and
    shared, so tests must not change it.

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
    """Fixture: a function that copies a `known_run` into the test's folder."""
    def record(name: str = "run", **options) -> Path:
        return Path(shutil.copytree(known_run(name, **options), tmp_path / name))
    return record
