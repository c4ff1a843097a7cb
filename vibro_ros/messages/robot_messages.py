"""The messages of one robot, as the bytes that are published and recorded; the node and a replay both make them here.

Units are SI; axes follow REP-103: the robot's `base_link` has x forward and z up, and moves in the frame `odom`.
`messages.topics.TOPICS` says which field of a sample fills which field of a message; the code here fills the rest.
rosbags serialises the fixed part of a message once, with zeros in the padding between fields, and a `Template` writes
the numbers of each sample into its bytes. So equal samples have equal bytes, and a replay can compare bytes.
"""

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from operator import itemgetter
from types import MappingProxyType
from typing import Any

import numpy as np

from vibro_ros.messages.codec import ENCAPSULATION, new_message, serialised
from vibro_ros.messages.frames import ALL, JOINTS, NONE, Frames, joints_of
from vibro_ros.messages.topics import SAMPLE, SAMPLES, SENSOR_TOPICS, TOPICS, published_by
from vibro_ros.messages.urdf import BASE, robot_description
from vibro_ros.model.scene import Scene
from vibro_ros.simulation.samples import FIELDS, TIME

SECOND = 1_000_000_000  # ns
_MARK, _STEP, _OTHER = 0x2B5A1300, 0x1100, 0x80  # marks of a template: exact as int32, and distinct as float32, too
PLATES = {"upper_contact": "upper_plate", "inclined_contact": "inclined_plate"}
"""Frame of the plate that is struck, by the kind of the event."""


SAMPLE_LABELS = ("start_seconds", "start_nanoseconds", *FIELDS)
"""Names of the numbers in a message on `~/samples`, in order; its `layout.dim[0].label` lists them, joined by commas.

The first two are the ROS time of robot time 0, in whole seconds and nanoseconds, the others the quantities of
`simulation.samples.Samples`, with robot time as `time`. So a sample's stamp is `stamp_at(start, time)`, to the
nanosecond.
"""


def stamp_at(start: int, time: float) -> int:
    """Return the ROS time [ns] of the simulated `time` [s]; `start` is the ROS time [ns] of simulated time 0."""
    return start + round(time * 1e9)


class Template:
    """Messages, each with its type, of which only `count` numbers vary; one compiled call makes the bytes of all.

    `fill` sets the numbers in the messages: each is written as it is, or negated, any number of times. rosbags
    serialises the messages once, with a mark in place of each number. The marks in the bytes show where each number
    belongs, and in which format, so that no rule of CDR stands here. rosbags then serialises the messages with other
    marks, and RuntimeError is raised unless the template makes the same bytes.
    """

    def __init__(self, messages: Sequence[tuple[Any, str]], fill: Callable[[Sequence[float]], object], count: int):
        marks = [_MARK + i * _STEP for i in range(count)]
        number_by_bytes = {struct.pack(f"<{code}", sign * mark): (code, i, sign)
                           for i, mark in enumerate(marks) for code in "fid" for sign in (1, -1)}
        negated, constants, order, codes, end = list[int](), list[bytes](), list[int](), ["<"], 0

        def add_constant(data: bytes) -> None:
            constants.append(data)
            order.append(-len(constants))  # counted from the end of all values that are packed
            codes.append(f"{len(data)}s")

        fill(marks)
        self._spans: list[tuple[int, int]] = []  # begin and end of each message
        for message, type_name in messages:
            data, begin, at = serialised(message, type_name), 0, ENCAPSULATION
            self._spans.append((end, end := end + len(data)))
            while at < len(data):
                code, index, sign = (number_by_bytes.get(data[at:at + 8]) or number_by_bytes.get(data[at:at + 4])
                                     or ("", 0, 0))
                if code:
                    add_constant(data[begin:at])
                    order.append(index if sign > 0 else count + len(negated))
                    negated += [index] if sign < 0 else []
                    codes.append(code)
                    begin = at + struct.calcsize(code)
                at = max(begin, at + 4)  # every number is at a multiple of 4 bytes
            add_constant(data[begin:])
        self._negated, self._constants = negated, constants[::-1]
        self._in_order, self._pack = itemgetter(*order), struct.Struct("".join(codes)).pack
        fill(other_marks := [mark + _OTHER for mark in marks])
        if self.filled(other_marks) != [serialised(message, type_name) for message, type_name in messages]:
            types = ", ".join(type_name for _, type_name in messages)
            raise RuntimeError(f"{types}: numbers vary that are not copied or negated")

    def filled(self, numbers: Sequence[float]) -> list[bytes]:
        """Return the bytes of each message with these numbers in their places."""
        negated = [-numbers[i] for i in self._negated]
        data = self._pack(*self._in_order([*numbers, *negated, *self._constants]))
        return [data[begin:end] for begin, end in self._spans]


class RobotMessages:
    """Makes all messages that a robot publishes; `topics` has the names of its topics in `TOPICS`.

    `prefix` begins the name of every frame. `transforms` says which ones are published: `NONE`, `ONLY_BASE` or `ALL` of
    `messages.frames`. `variances` are the diagonals of the covariances of pose and twist in `odom`, none or 6 numbers
    each. `control` has the resolved names of `joint_commands` and `joint_states`, for a block in the URDF by which
    ros2_control commands the robot; the block is left out if this is empty.
    """

    def __init__(self, scene: Scene, prefix: str = "", transforms: str = ALL,
                 variances: Sequence[Sequence[float]] = ((), ()), control: Mapping[str, str] = MappingProxyType({})):
        self._scene, self._prefix, self._control = scene, prefix, control
        self.topics = published_by(scene, transforms)
        self._sampled = tuple(name for name in self.topics if TOPICS[name].when == SAMPLE)
        self._sample = self._sample_template(transforms, variances)
        self._impacts = {kind: self._template("impacts", _fill_impact, 1, prefix + PLATES[kind]) for kind in PLATES}
        self._measured: dict[str, Template] = {}
        whole = new_message(TOPICS[SAMPLES].type)
        dimension = new_message("std_msgs/msg/MultiArrayDimension")
        dimension.label, dimension.size, dimension.stride = ",".join(SAMPLE_LABELS), *[len(SAMPLE_LABELS)] * 2
        whole.layout.dim = [dimension]
        self._whole = Template([(whole, TOPICS[SAMPLES].type)], partial(setattr, whole, "data"), len(SAMPLE_LABELS))

    def _sample_template(self, transforms: str, variances: Sequence[Sequence[float]]) -> Template:
        """Return the template of the messages of a sample; its numbers are the fields, the stamp, in s and ns, and the
        turns of the frames."""
        scene, prefix = self._scene, self._prefix
        stamp = new_message("builtin_interfaces/msg/Time")  # the sample's stamp, shared by all its headers
        self._frames = Frames(scene, stamp, prefix, transforms) if transforms != NONE else None
        messages = {name: self._new_message(name) for name in self._sampled}
        for name in self._sampled:
            if TOPICS[name].frame:
                messages[name].header.stamp = stamp
        odom, states, joints = messages["odom"], messages["joint_states"], joints_of(scene)
        odom.child_frame_id = prefix + BASE
        for part, diagonal in zip((odom.pose, odom.twist), variances, strict=True):
            part.covariance[::7][:len(diagonal)] = diagonal
        states.name = joints
        if self._frames:
            messages["tf"].transforms = self._frames.moving
        places = [(*_place(messages[name], path), FIELDS.index(field.lstrip("-")), field.startswith("-"))
                  for name in self._sampled for path, field in TOPICS[name].numbers.items()]

        def fill(numbers: Sequence[float]) -> None:
            for part, name, index, negated in places:
                setattr(part, name, -numbers[index] if negated else numbers[index])
            states.position, states.velocity, states.effort = (
                [numbers[FIELDS.index(JOINTS[joint][part])] for joint in joints] for part in range(3))
            stamp.sec, stamp.nanosec, *turns = numbers[len(FIELDS):]
            if self._frames:
                self._frames.fill(numbers, turns)

        turns = self._frames.turns([0.0] * len(FIELDS)) if self._frames else ()
        return Template([(messages[name], TOPICS[name].type) for name in self._sampled], fill,
                        len(FIELDS) + 2 + len(turns))

    def once(self, stamp: int) -> Iterator[tuple[str, bytes]]:
        """Yield topic (its name in `TOPICS`) and message of all that is published once, at ROS time `stamp` [ns]."""
        description = self._new_message("robot_description")
        description.data = robot_description(self._scene, self._control)
        yield "robot_description", serialised(description, TOPICS["robot_description"].type)
        if self._frames and self._frames.fixed:
            for transform in self._frames.fixed:
                transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(stamp, SECOND)
            transforms = self._new_message("tf_static")
            transforms.transforms = self._frames.fixed
            yield "tf_static", serialised(transforms, TOPICS["tf_static"].type)

    def of_sample(self, values: np.ndarray, events: np.ndarray, measurements: Sequence, stamp: int,
                  stamp_of: Callable[[float], int]) -> list[tuple[str, bytes]]:
        """Return topic (its name in `TOPICS`) and message of all that is published with a sample, in order.

        `values` are those of `Simulator.values`, shape (len(FIELDS),). Each contact among the `events` since the
        previous sample, of `Simulator.take_events`, gives a message, and so does each of the `measurements`, of
        `SensedSimulator.take_measurements`. `stamp` is the ROS time [ns] of the sample; `stamp_of` returns that of a
        time [s] of the device's clock.
        """
        numbers = values.tolist()
        turns = self._frames.turns(numbers) if self._frames else ()
        numbers += [*divmod(stamp, SECOND), *turns]
        messages = list(zip(self._sampled, self._sample.filled(numbers), strict=True))
        for time, kind, _, peak_force, _ in events.tolist():
            if kind in PLATES:
                numbers = [*divmod(stamp_of(time), SECOND), peak_force]
                messages.append(("impacts", self._impacts[kind].filled(numbers)[0]))
        for sensor, time, read in measurements:
            if sensor not in self._measured:
                self._measured[sensor] = self._template(SENSOR_TOPICS[sensor], MEASUREMENTS[sensor], len(read))
            numbers = [*divmod(stamp_of(time), SECOND), *read.tolist()]
            messages.append((SENSOR_TOPICS[sensor], self._measured[sensor].filled(numbers)[0]))
        return messages

    def whole_sample(self, values: np.ndarray, start: int, time: float) -> bytes:
        """Return all quantities of a sample as one message on `~/samples`.

        `start` is the ROS time [ns] of robot time 0. `time` [s] is the robot time of the sample and replaces the
        device's own time in the message, because a reset does not turn robot time back.
        """
        numbers = [*divmod(start, SECOND), *values.tolist()]
        numbers[len(SAMPLE_LABELS) - len(FIELDS) + TIME] = time
        return self._whole.filled(numbers)[0]

    def _new_message(self, name: str) -> Any:
        message, topic = new_message(TOPICS[name].type), TOPICS[name]
        if topic.frame:
            message.header.frame_id = self._prefix + topic.frame
        for path, value in topic.constants.items():
            setattr(*_place(message, path), value)
        return message

    def _template(self, name: str, fill: Callable[[Any, Sequence[float]], None], count: int,
                  frame: str = "") -> Template:
        """Return the template of a topic's messages; its numbers are a stamp, in s and ns, and `count` others."""
        message = self._new_message(name)
        message.header.frame_id = frame or message.header.frame_id

        def fill_all(numbers: Sequence[float]) -> None:
            message.header.stamp.sec, message.header.stamp.nanosec, *read = numbers
            fill(message, read)

        return Template([(message, TOPICS[name].type)], fill_all, 2 + count)


def _fill_impact(message: Any, read: Sequence[float]) -> None:
    """Fill in the peak force [N]."""
    message.wrench.force.z = read[0]


def fill_imu(message: Any, read: Sequence[float]) -> None:
    """Fill in specific force [m/s²] and angular rate [rad/s] with their variances (REP-145), without orientation."""
    force, rate = message.linear_acceleration, message.angular_velocity
    force.x, force.y, force.z, rate.x, rate.y, rate.z, *variances = read
    message.orientation_covariance[0] = -1.0  # REP-145: no orientation
    for covariance, variance in zip((message.linear_acceleration_covariance, message.angular_velocity_covariance),
                                    variances, strict=True):
        covariance[::4] = variance


def fill_encoder(message: Any, read: Sequence[float]) -> None:
    """Fill in angle [rad] and speed [rad/s] of the crank; an encoder measures no effort: NaN, as in ros2_control."""
    message.name = ["crank"]
    message.position, message.velocity, message.effort = [read[0]], [read[1]], [math.nan]


def fill_battery(message: Any, read: Sequence[float]) -> None:
    """Fill in voltage [V] and current [A] of the supply, negative while it discharges; the rest is unknown (NaN)."""
    drawn, message.voltage = read
    message.current, message.present = -drawn, True
    message.temperature = message.charge = message.capacity = message.design_capacity = message.percentage = math.nan


def fill_tracking(message: Any, read: Sequence[float]) -> None:
    """Fill in the position of the body [m] in the frame `odom`, with its variances; the body does not turn."""
    position, covariance = message.pose.pose.position, message.pose.covariance
    position.x, position.y, position.z, variance = read
    covariance[0] = covariance[7] = covariance[14] = variance


MEASUREMENTS: Mapping[str, Callable[[Any, Sequence[float]], None]] = {
    "imu": fill_imu, "encoder": fill_encoder, "current": fill_battery, "tracking": fill_tracking}
"""For each sensor of `sensors.device`: the function that fills its message with the values of a `Measurement`."""


def _place(message: Any, path: str) -> tuple[Any, str]:
    """Return the object that holds the field at a dotted path in a message, and the field's name."""
    *parents, last = path.split(".")
    for parent in parents:
        message = getattr(message, parent)
    return message, last
