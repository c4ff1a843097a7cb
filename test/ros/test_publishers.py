"""The robot's messages: units, signs and frames; and bytes filled in place are those of rclpy for any numbers."""

import dataclasses
import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64, String

from vibro_ros.bag.cdr import first_difference
from vibro_ros.bag.recorder import Together
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.messages import fields
from vibro_ros.messages.fields import ALL, ONLY_BASE, Frames
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.ros.topics import publishers
from vibro_ros.ros.topics.publishers import RobotPublishers, filled, makers, message_class
from vibro_ros.ros.topics.templates import Sheet, Template, checked_template
from vibro_ros.simulation.samples import EVENT_DTYPE, FIELDS, TIME, Samples

NO_EVENTS = np.empty(0, dtype=EVENT_DTYPE)
SPECIAL = [math.nan, -math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, -2.2e-308, 1.7976931348623157e308]
LAST_STAMP = 2**31 * 10**9 - 1  # [ns] of an int32 of seconds
STAMPS = [0, 1, 999_999_999, 10**9, 1_763_700_000_123_456_789, LAST_STAMP, -1, -2**31 * 10**9]
BOTH = ("upper", "inclined")
SIDES = [((), ()), *(((side,), plates) for side in BOTH for plates in ((), (side,))),
         *((BOTH, plates) for plates in ((), ("upper",), ("inclined",), BOTH))]
STAMP = 1_763_700_000_123_456_789  # [ns]
JOINTS = ["crank", "inclined_mass", "upper_plate"]
# numpy scalars, as the simulator may give them: rclpy would serialise them to garbage where they are not cast
STATE = Samples(**{field.name: np.float32(i + 0.5) for i, field in enumerate(dataclasses.fields(Samples))})


def through_dds(message):
    """What a subscriber gets."""
    return deserialize_message(serialize_message(message), type(message))


def assert_stamped(message, frame: str) -> None:
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_763_700_000, 123_456_789)
    assert message.header.frame_id == frame


def test_odometry_is_along_x_above_the_ground():
    message = through_dds(filled("odom", fields.fill_odometry, STATE, STAMP))
    assert_stamped(message, "odom")
    assert message.child_frame_id == "base_link"
    pose, twist = message.pose.pose, message.twist.twist
    assert (pose.position.x, pose.position.y, pose.position.z) == (STATE.body_position, 0.0, STATE.body_height)
    assert (pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w) == (0.0, 0.0, 0.0, 1.0)
    assert (twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.z) == (
        STATE.body_velocity, 0.0, STATE.body_vertical_velocity, 0.0)


def test_joints_have_position_velocity_and_effort():
    message = through_dds(filled("joint_states", fields.fill_joint_states, STATE, JOINTS, STAMP))
    assert_stamped(message, "base_link")
    assert list(message.name) == JOINTS
    assert list(message.position) == [STATE.crank_angle, STATE.inclined_position, STATE.upper_plate_position]
    assert list(message.velocity) == [STATE.motor_speed, STATE.inclined_velocity, STATE.upper_plate_velocity]
    assert list(message.effort) == [STATE.motor_torque, STATE.inclined_drive_force, STATE.upper_plate_force]


def test_the_ground_pushes_the_body_against_the_friction_of_the_paper():
    message = through_dds(filled("ground_contact", fields.fill_ground_contact, STATE, STAMP))
    assert_stamped(message, "base_link")
    force = message.wrench.force
    assert (force.x, force.y, force.z) == (-STATE.friction_force, 0.0, STATE.normal_force)


@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_an_impact_pushes_its_plate_outwards(side):
    (event,) = np.array([(0.25, f"{side}_contact", 0.7, 812.5, 3e-4)], dtype=EVENT_DTYPE)
    message = through_dds(filled("impacts", fields.fill_impact, event, STAMP))
    assert_stamped(message, f"{side}_plate")
    force, torque = message.wrench.force, message.wrench.torque
    assert (force.x, force.y, force.z) == (0.0, 0.0, 812.5)
    assert (torque.x, torque.y, torque.z) == (0.0, 0.0, 0.0)


def test_power_is_a_plain_number():
    assert through_dds(filled("motor_power", fields.fill_motor_power, STATE)).data == STATE.motor_power


def test_a_prefix_begins_the_name_of_every_frame_as_it_is():
    (event,) = np.array([(0.25, "upper_contact", 0.7, 812.5, 3e-4)], dtype=EVENT_DTYPE)
    odometry = filled("odom", fields.fill_odometry, STATE, STAMP, "r1/")
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("r1/odom", "r1/base_link")
    assert not odometry.pose.covariance.any() and not odometry.twist.covariance.any()
    joints = filled("joint_states", fields.fill_joint_states, STATE, JOINTS, STAMP, "r1/")
    assert (joints.header.frame_id, list(joints.name)) == ("r1/base_link", JOINTS)
    assert filled("ground_contact", fields.fill_ground_contact, STATE, STAMP, "r1_").header.frame_id == "r1_base_link"
    assert filled("impacts", fields.fill_impact, event, STAMP, "r1/").header.frame_id == "r1/upper_plate"


def random_cases(rng: np.random.Generator, count: int) -> list[tuple[np.ndarray, int]]:
    """Samples of plain, special and any other numbers, NaN with a payload among them; and stamps."""
    cases = []
    for number in range(count):
        values = rng.standard_normal(len(FIELDS))
        if number % 3 == 1:
            values = rng.choice(SPECIAL, len(FIELDS))
        elif number % 3 == 2:
            values = np.frombuffer(rng.bytes(8 * len(FIELDS)))
        stamp = STAMPS[number] if number < len(STAMPS) else int(rng.integers(0, LAST_STAMP))
        cases.append((values, stamp))
    return cases


def made(make, values, stamp: int):
    return make(Samples(*map(float, values)), stamp)


def split(topic, data: bytes) -> list[tuple[str, bytes]]:
    return list(topic.split(data)) if isinstance(topic, Together) else [(topic, data)]


def template_of(make, type_name: str) -> Template:
    return Template(lambda numbers, stamp: made(make, numbers, stamp), type_name, len(FIELDS))


def assert_same(data: bytes, message, type_name: str) -> None:
    """Nothing differs but bytes that belong to no field; those are zero, so that equal messages have equal bytes."""
    made = serialize_message(message)
    assert len(data) == len(made)
    assert first_difference(data, made, type_name) is None
    aligned = np.array(bytearray(data)) != np.array(bytearray(made))
    assert not np.array(bytearray(data))[aligned].any()


def assert_filled_as_made(scene, prefix: str, cases) -> None:
    wanted = makers(scene, prefix)
    sheet = Sheet([template_of(make, ROBOT_TOPICS[topic]) for topic, make in wanted.items()])
    for values, stamp in cases:
        sheet.fill(values, stamp)
        for message, (topic, make) in zip(sheet.messages, wanted.items(), strict=True):
            assert_same(message.tobytes(), made(make, values, stamp), ROBOT_TOPICS[topic])


@pytest.mark.parametrize("name", shipped_scenes())
def test_filled_bytes_are_those_of_rclpy_for_any_numbers_and_stamps(name):
    assert_filled_as_made(load_scene(name), "", random_cases(np.random.default_rng(1), 60))


@pytest.mark.parametrize("length", (0, 1, 2, 5))
def test_filled_bytes_are_those_of_rclpy_whatever_a_prefix_does_to_alignment(length):
    cases = random_cases(np.random.default_rng(length), 9)
    for guides, plates in SIDES:
        scene = SimpleNamespace(guides=guides, plates=plates, has_rotor=False)
        assert_filled_as_made(scene, "äbcdefghij"[:length], cases)


@pytest.mark.parametrize("length", (0, 3))
@pytest.mark.parametrize("published", [ONLY_BASE, ALL])
def test_filled_transforms_are_those_of_rclpy_for_any_numbers_and_prefix(length, published):
    pytest.importorskip("tf2_msgs.msg", reason="types of tf2_msgs are not built: no compiler")
    rng = np.random.default_rng(length)
    for scene in map(load_scene, ("device", "no_impact")):
        frames = Frames(scene, "äbcdefgh"[:length], published)
        make, count = partial(publishers._transforms, frames), len(FIELDS) + len(frames.turns(0.0))
        sheet = Sheet([checked_template(make, ROBOT_TOPICS["tf"], count, pytest.fail)])
        for values, stamp in random_cases(rng, 12):
            numbers = np.concatenate([values, rng.standard_normal(count - len(FIELDS))])
            sheet.fill(numbers, stamp)
            assert_same(sheet.messages[0].tobytes(), make(numbers.tolist(), stamp), ROBOT_TOPICS["tf"])


NOT_FILLED = [
    (lambda state, stamp: Float64(data=state.motor_speed + state.motor_power), "std_msgs/msg/Float64", "not those"),
    (lambda state, stamp: Float64(data=1e-3 * stamp), "std_msgs/msg/Float64", "not those"),
    (lambda state, stamp: String(data="later" * (state.time > 0.0)), "std_msgs/msg/String", "length"),
    (lambda state, stamp: Float64(data=state.time), "std_msgs/msg/String", "are no std_msgs/msg/String"),
]


@pytest.mark.parametrize(("make", "type_name", "reason"), NOT_FILLED)
def test_what_cannot_be_filled_in_place_is_said(make, type_name, reason):
    said = []
    assert checked_template(partial(made, make), type_name, len(FIELDS), said.append) is None
    (warning,) = said
    assert reason in warning
    assert "rclpy serialises every message" in warning


def test_what_cannot_be_filled_in_place_is_serialised_by_rclpy_and_published_and_recorded(bench, monkeypatch):
    make = NOT_FILLED[0][0]
    monkeypatch.setattr(publishers, "makers", lambda scene, prefix, _: {**makers(scene, prefix), "motor_power": make})
    publishing, heard, recorded = RobotPublishers(bench.node, load_scene("device")), [], {}
    bench.node.create_subscription(Float64, "motor_power", heard.append, 10)
    bench.spin_until(publishing.publishers["motor_power"].get_subscription_count, "discovery")
    ((values, _),) = random_cases(np.random.default_rng(4), 1)
    publishing.publish(values, NO_EVENTS, 7, lambda time: 7,
                       lambda topic, stamp, data: recorded.update(split(topic, data)))
    bench.spin_until(lambda: heard, "message")
    assert heard == [made(make, values, 7)]
    assert deserialize_message(recorded["/motor_power"], Float64) == heard[0]
    assert list(recorded) == ["/odom", "/joint_states", "/ground_contact", "/motor_power"]


@pytest.mark.parametrize(("namespace", "in_place"), [("", True), ("/a/bcd", True), ("", False)])
def test_publisher_and_bag_get_the_same_bytes_of_a_sample_and_its_impacts(bench, namespace, in_place, monkeypatch):
    """Filled in place, and where nothing can be filled in place."""
    if not in_place:
        monkeypatch.setattr(publishers, "checked_template", lambda *_: None)
    node = Node("robot", context=bench.node.context, namespace=namespace)
    scene, heard, recorded = load_scene("device"), [], []
    publishing = RobotPublishers(node, scene, "r12/")
    for topic in publishing.publishers:
        kind = message_class(ROBOT_TOPICS[topic])
        bench.node.create_subscription(kind, f"{namespace}/{topic}", lambda data, topic=topic: heard.append((
            f"{namespace}/{topic}", data)), 10, raw=True)
    bench.spin_until(lambda: all(one.get_subscription_count() for one in publishing.publishers.values()), "discovery")
    events = np.array([(0.25, "upper_contact", 0.7, 812.5, 3e-4), (0.26, "slip_forward", 0.0, 0.0, 0.0),
                       (0.27, "inclined_contact", 0.1, 3.5, 2e-4)], dtype=EVENT_DTYPE)
    ((values, _),) = random_cases(np.random.default_rng(5), 1)

    def stamp_of(time: float) -> int:
        return 10**18 + round(1e9 * time)

    publishing.publish(values, events, stamp_of(values[TIME]), stamp_of, lambda topic, stamp, data: recorded.extend(
        (name, stamp, message) for name, message in split(topic, data)))
    bench.spin_until(lambda: len(heard) == len(recorded), "messages")
    node.destroy_node()
    assert sorted(heard) == sorted((topic, data) for topic, _, data in recorded)
    sampled = stamp_of(values[TIME])
    assert {stamp for _, stamp, _ in recorded} == {sampled}
    expected = [(topic, made(make, values, sampled)) for topic, make in makers(scene, "r12/").items()]
    expected += [("impacts", filled("impacts", fields.fill_impact, event, stamp_of(event["time"]), "r12/"))
                 for event in (events[0], events[2])]
    assert [topic for topic, _, _ in recorded] == [f"{namespace}/{topic}" for topic, _ in expected]
    for (_, _, data), (topic, message) in zip(recorded, expected, strict=True):
        assert first_difference(data, serialize_message(message), ROBOT_TOPICS[topic]) is None
