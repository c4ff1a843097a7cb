"""A live robot's samples from the messages of its topics, which anybody may publish anything on.

Messages wait in DDS until the view looks: an executor's turn costs 0.15 to 0.5 ms, and a node that shows 30 pictures a
second has no use for a turn for each of 3000 messages a second; taken together, a message costs some 10 us.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.messages.codec import deserialised
from vibro_ros.messages.frames import JOINTS, ODOM, joints_of
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.messages.urdf import BASE
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import FIELDS

STAMPED = ("odom", "joint_states", "ground_contact")
"""Topics that together have every sample's numbers, each with the sample's stamp."""
NUMBERED = ("motor_current", "electrical_power")
"""Topics of a robot with a dc motor, which have every sample's numbers and no stamp: a message that its publisher gave
the number of a message of `odom` is of the same sample."""
SECOND = 1_000_000_000
"""Nanoseconds of a stamp's second."""
LONGEST = 10_000
"""Bytes of the longest message that is read; a robot's have a thousand."""
PATIENCE = 15
"""Batches after which a message whose stamp another topic has not had is given up: half a second."""
MOST_WAITING = 3000
"""Stamps of such messages that wait at most."""
_BODY = ("body_position", "body_height", "body_velocity", "body_vertical_velocity")
_GROUND = ("friction_force", "normal_force")
_SPEED, _TORQUE, _POWER = (FIELDS.index(name) for name in ("motor_speed", "motor_torque", "motor_power"))


class Reading(NamedTuple):
    """What one message says: stamp [ns], its number by its publisher, values in the order of `Decoder.columns`."""

    stamp: int
    number: int
    values: list[float]


class Decoder:
    """Reads the messages of a robot of a known scene, whatever library and byte order wrote them.

    The names of the robot's frames begin with `prefix`. `columns` says which of `FIELDS` the messages of each of
    `STAMPED` have, and of `NUMBERED` for a dc motor.
    """

    def __init__(self, scene: Scene, prefix: str):
        self._joints, self._base = joints_of(scene), prefix + BASE
        self._frames = {"odom": prefix + ODOM, "joint_states": self._base, "ground_contact": self._base}
        joints = [JOINTS[joint][part] for part in range(3) for joint in self._joints]
        self.columns = {topic: [FIELDS.index(name) for name in names]
                        for topic, names in zip(STAMPED, (_BODY, joints, _GROUND), strict=True)}
        if scene.has_rotor:
            self.columns |= {name: [FIELDS.index(name)] for name in NUMBERED}

    def read(self, topic: str, data: bytes, number: int | None) -> Reading | None:
        """What a message of a topic of `columns` says; None if it is no sample of this robot.

        Without its publisher's `number` it counts by its stamp; without either it has the number -1, as no other has.
        """
        try:
            message = deserialised(data if len(data) <= LONGEST else b"", ROBOT_TOPICS[topic])
        except ValueError:
            return None
        if topic in NUMBERED:
            return Reading(0, -1 if number is None else number, [message.data]) if math.isfinite(message.data) else None
        stamp, values = message.header.stamp, self._values(topic, message)
        if (message.header.frame_id != self._frames[topic] or stamp.sec < 0 or stamp.nanosec >= SECOND
                or len(values) != len(self.columns[topic]) or not all(map(math.isfinite, values))):
            return None
        time = stamp.sec * SECOND + stamp.nanosec
        return Reading(time, time if number is None else number, values)

    def _values(self, topic: str, message: Any) -> list[float]:
        """Its numbers; none if frames or joints are another robot's."""
        if topic == "odom" and message.child_frame_id == self._base:
            place, speed = message.pose.pose.position, message.twist.twist.linear
            return [place.x, place.z, speed.x, speed.z]
        parts = (message.position, message.velocity, message.effort) if topic == "joint_states" else ()
        if parts and message.name == self._joints and all(len(part) == len(self._joints) for part in parts):
            return np.concatenate(parts).tolist()
        if topic == "ground_contact":
            return [-message.wrench.force.x, message.wrench.force.z]
        return []


class Rows(NamedTuple):
    """Samples, in the order in which their odometry came.

    `stamps` are ROS time [ns], `counts` those of the odometry's publisher, both of int and shape (n,); in `values`,
    shape (n, len(FIELDS)), `time` is 0.
    """

    stamps: np.ndarray
    counts: np.ndarray
    values: np.ndarray


@dataclass
class _Row:
    batch: int  # in which the first reading came
    order: int = 0  # of the odometry
    parts: dict[str, Reading] = field(default_factory=dict)


class Joining:
    """Joins what the topics say of one stamp.

    A stranger's message on one topic, with a stamp that no other topic has, finds no partner and does no harm.
    """

    def __init__(self):
        self._waiting: dict[int, _Row] = {}  # by stamp
        self._complete: deque[_Row] = deque()  # but for what is joined by number
        self._numbered: dict[int, dict[str, Reading]] = {}  # by number
        self._batch, self._number = 0, count()

    def join(self, readings: Mapping[str, Sequence[Reading]], columns: Mapping[str, Sequence[int]]) -> Rows:
        """Rows that are complete by now. Of two messages of a topic with one stamp the first counts.

        `motor_power` has no stamp to join it by. It is the motor's torque times its speed. What a topic of `NUMBERED`
        does not say is NaN; it is waited for as long as for a stamp, where the middleware numbers messages.
        """
        self._batch += 1
        complete: list[_Row] = []
        for topic in set(NUMBERED) & set(readings):
            for one in readings[topic]:
                self._numbered.setdefault(one.number, {})[topic] = one
        for number in list(self._numbered)[:-MOST_WAITING]:
            del self._numbered[number]
        for topic in STAMPED:
            for one in readings[topic]:
                row = self._waiting.setdefault(one.stamp, _Row(self._batch))
                if topic in row.parts:
                    continue
                row.parts[topic] = one
                if topic == "odom":
                    row.order = next(self._number)
                if len(row.parts) == len(STAMPED):
                    complete.append(self._waiting.pop(one.stamp))
        for stamp in list(self._waiting):  # give up the oldest
            if self._waiting[stamp].batch > self._batch - PATIENCE and len(self._waiting) <= MOST_WAITING:
                break
            del self._waiting[stamp]
        complete.sort(key=lambda row: row.order)
        self._complete.extend(complete)
        complete = list(self._with_numbered(columns))
        values = np.zeros((len(complete), len(FIELDS)))
        for number, row in enumerate(complete):
            for topic, of_topic in columns.items():
                values[number, of_topic] = row.parts[topic].values if topic in row.parts else np.nan
        with np.errstate(over="ignore"):
            values[:, _POWER] = values[:, _TORQUE] * values[:, _SPEED]
        odometry = [row.parts["odom"] for row in complete]
        return Rows(np.array([one.stamp for one in odometry], np.int64),
                    np.array([one.number for one in odometry], np.int64), values)

    def _with_numbered(self, columns: Mapping[str, Sequence[int]]) -> Iterator[_Row]:
        """Rows in their order, as long as nothing has to be waited for."""
        while self._complete:
            row = self._complete[0]
            number, stamp = row.parts["odom"].number, row.parts["odom"].stamp
            row.parts |= self._numbered.pop(number, {})
            if number != stamp and row.batch > self._batch - PATIENCE and not columns.keys() <= row.parts.keys():
                break
            yield self._complete.popleft()
