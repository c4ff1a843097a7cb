"""A peer that knows nothing of ROS: a plain participant of Cyclone DDS, another vendor's middleware.

`python cyclone_peer.py SPEED` publishes SPEED [rad/s] on `motor_speed` as soon as a robot listens, and prints a line of
JSON for each message on `odom`: stamp [ns], frames, x [m] and forward velocity [m/s]. It runs until it is killed.

The types are written by hand, as somebody without ROS has to write them from the definitions. On the wire a field that
is a message has no other bytes than the fields of that message, so that the types are written without nesting. ROS 2
puts `rt/` before the names of topics and `dds_::`, `_` around the names of types.
"""

import json
import os
import sys
import time
from dataclasses import dataclass

LOCALHOST = ("<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
             "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
             "<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers>"
             "</Discovery></Domain></CycloneDDS>")
os.environ["CYCLONEDDS_URI"] = LOCALHOST  # as ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST for ROS

from cyclonedds.core import Policy, Qos  # noqa: E402 (reads the environment when it is imported)
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import IdlStruct  # noqa: E402
from cyclonedds.idl.types import array, float64, int32, uint32  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1000))
POLL = 0.005  # s, between two looks at what has come


@dataclass
class Float64(IdlStruct, typename="std_msgs::msg::dds_::Float64_"):
    data: float64


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    seconds: int32
    nanoseconds: uint32
    frame_id: str
    child_frame_id: str
    pose: array[float64, 7]  # x, y, z, and a quaternion
    pose_covariance: array[float64, 36]
    twist: array[float64, 6]  # linear, angular
    twist_covariance: array[float64, 36]


def show(message: Odometry) -> None:
    """Print what the test compares; numbers in JSON keep every bit."""
    print(json.dumps([message.seconds * 10**9 + message.nanoseconds, message.frame_id, message.child_frame_id,
                      message.pose[0], message.twist[0]]), flush=True)


def run(domain: int, speed: float) -> None:
    participant = DomainParticipant(domain)
    writer = DataWriter(participant, Topic(participant, "rt/motor_speed", Float64, qos=RELIABLE), qos=RELIABLE)
    reader = DataReader(participant, Topic(participant, "rt/odom", Odometry, qos=RELIABLE), qos=RELIABLE)
    while not writer.get_matched_subscriptions():
        time.sleep(POLL)
    writer.write(Float64(speed))
    while True:
        for message in reader.take(1000):
            show(message)
        time.sleep(POLL)


if __name__ == "__main__":
    run(int(os.environ["ROS_DOMAIN_ID"]), float(sys.argv[1]))
