"""The robot's messages as rclpy reads them, for any numbers: units, signs, frames and stamps; and their publication."""

import math

import numpy as np
import pytest
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64, Float64MultiArray

from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.messages.codec import deserialised, first_difference, new_message, serialised
from vibro_ros.messages.frames import ALL, JOINTS, NONE, joints_of
from vibro_ros.messages.robot_messages import RobotMessages, Template
from vibro_ros.messages.topics import SAMPLES, TOPICS
from vibro_ros.ros.node.node import message_class
from vibro_ros.ros.robot.pacing import RobotTime
from vibro_ros.ros.robot.run import RobotPublishers
from vibro_ros.sensors.device import Measurement
from vibro_ros.simulation.samples import EVENT_DTYPE, FIELDS, TIME, Samples

NO_EVENTS = np.empty(0, dtype=EVENT_DTYPE)
EVENTS = np.array([(0.25, "upper_contact", 0.7, 812.5, 3e-4), (0.26, "slip_forward", 0.0, 0.0, 0.0),
                   (0.27, "inclined_contact", 0.1, 3.5, 2e-4)], dtype=EVENT_DTYPE)
SPECIAL = [math.nan, -math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, -2.2e-308, 1.7976931348623157e308]
LAST_STAMP = 2**31 * 10**9 - 1  # [ns] of an int32 of seconds
STAMPS = [0, 1, 999_999_999, 10**9, 1_763_700_000_123_456_789, LAST_STAMP, -1, -2**31 * 10**9]
SENSORS = {"sensors.imu.rate": 800.0, "sensors.encoder.rate": 100.0, "sensors.tracking.rate": 50.0,
           "sensors.current.rate": 100.0}
COUNTS = {"imu": 8, "encoder": 2, "tracking": 4, "current": 2}
"""Numbers in a measurement."""


def stamp_of(time: float) -> int:
    return 10**18 + round(1e9 * time)


def random_cases(seed: int, count: int) -> list[tuple[np.ndarray, int]]:
    """Return samples of ordinary, special and random numbers, including NaN with a payload, and stamps."""
    rng = np.random.default_rng(seed)
    kinds = (lambda: rng.standard_normal(len(FIELDS)), lambda: rng.choice(SPECIAL, len(FIELDS)),
             lambda: np.frombuffer(rng.bytes(8 * len(FIELDS))))
    return [(kinds[i % 3](), STAMPS[i] if i < len(STAMPS) else int(rng.integers(0, LAST_STAMP))) for i in range(count)]


def read(name: str, data: bytes):
    """Return the message as a subscriber receives it; rclpy must serialise it to the same fields and length."""
    message = deserialize_message(data, message_class(TOPICS[name].type))
    written = serialize_message(message)
    assert len(written) == len(data) and first_difference(data, written, TOPICS[name].type) is None, name
    return message


def bits(numbers) -> bytes:
    return np.array(numbers, dtype=float).tobytes()


def assert_header(header, stamp: int, frame: str) -> None:
    assert (header.stamp.sec * 10**9 + header.stamp.nanosec, header.frame_id) == (stamp, frame)


@pytest.mark.parametrize("name", shipped_scenes())
@pytest.mark.parametrize("prefix", ["", "ä", "r1/", "abcd"])  # of which each moves what follows by some bytes
def test_every_message_has_the_numbers_of_its_sample(name, prefix):
    scene, variances = load_scene(name), (list(range(6)), ())
    messages = RobotMessages(scene, prefix, NONE, variances)
    for values, stamp in random_cases(len(prefix), 15):
        state = Samples(*values.tolist())
        seen = {name: read(name, data) for name, data in messages.of_sample(values, NO_EVENTS, (), stamp, stamp_of)}
        odom, contact, joints = (seen[name] for name in ("odom", "ground_contact", "joint_states"))
        assert_header(odom.header, stamp, f"{prefix}odom")
        assert odom.child_frame_id == f"{prefix}base_link"
        pose, twist = odom.pose.pose, odom.twist.twist
        assert bits([pose.position.x, pose.position.y, pose.position.z, twist.linear.x, twist.linear.y, twist.linear.z]
                    ) == bits([state.body_position, 0.0, state.body_height,
                               state.body_velocity, 0.0, state.body_vertical_velocity])
        assert (pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w) == (0.0, 0.0, 0.0, 1.0)
        assert odom.pose.covariance.reshape(6, 6).tolist() == np.diag(variances[0]).tolist()
        assert not odom.twist.covariance.any()
        assert_header(contact.header, stamp, f"{prefix}base_link")
        force = contact.wrench.force
        assert bits([force.x, force.y, force.z]) == bits([-state.friction_force, 0.0, state.normal_force])
        assert_header(joints.header, stamp, f"{prefix}base_link")
        assert list(joints.name) == joints_of(scene)
        for part, numbers in enumerate((joints.position, joints.velocity, joints.effort)):
            assert bits(numbers) == bits([getattr(state, JOINTS[joint][part]) for joint in joints.name])
        of_motor = {"motor_power", *(("motor_current", "electrical_power") if scene.has_rotor else ())}
        assert set(seen) == {"odom", "ground_contact", "joint_states", *of_motor}
        assert all(bits([seen[name].data]) == bits([getattr(state, name)]) for name in of_motor)


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_message_has_the_bytes_of_rosbags(name):
    """Numbers are written into bytes that rosbags made once; rosbags makes the same bytes of the message in them."""
    scene = load_scene(name)
    on = [sensor for sensor in COUNTS if sensor != "current" or scene.has_rotor]
    scene = scene.with_parameters({f"sensors.{sensor}.rate": 100.0 for sensor in on})
    for prefix, (values, stamp) in zip(["", "ä", "r1/", "abcd"] * 10, random_cases(7, 40), strict=True):
        messages = RobotMessages(scene, prefix)
        rng = np.random.default_rng(abs(stamp))
        measured = [Measurement(sensor, rng.random(), 10.0**rng.uniform(-9.0, 9.0) * rng.normal(size=COUNTS[sensor]))
                    for sensor in on for _ in range(2)]
        made = [*messages.once(max(stamp, 0)), *messages.of_sample(values, EVENTS, measured, stamp, stamp_of),
                (SAMPLES, messages.whole_sample(values, stamp, 12.5))]
        assert {topic for topic, _ in made} == {*messages.topics, SAMPLES}
        for topic, data in made:
            kind = TOPICS[topic].type
            assert data == serialised(deserialised(data, kind), kind), topic


def test_a_template_that_would_change_numbers_is_refused():
    message = new_message("geometry_msgs/msg/Vector3")

    def fill(numbers):
        message.x, message.y = numbers[0], 2.0 * numbers[1]

    with pytest.raises(RuntimeError, match="geometry_msgs/msg/Vector3: numbers vary that are not copied or negated"):
        Template([(message, "geometry_msgs/msg/Vector3")], fill, 2)


def test_impacts_and_measurements_have_their_own_stamps_and_fields():
    scene = load_scene("machine").with_parameters(SENSORS)
    messages, ((values, stamp),) = RobotMessages(scene, "r1/", NONE), random_cases(5, 1)
    read_by = {"imu": np.arange(1.0, 9.0), "encoder": np.array([1.5, 2.5]), "current": np.array([1.5, 30.0]),
               "tracking": np.array([1.0, 2.0, 3.0, 4.0])}
    measured = [Measurement(sensor, 0.5, numbers) for sensor, numbers in read_by.items()]
    seen = [(name, read(name, data)) for name, data in messages.of_sample(values, EVENTS, measured, stamp, stamp_of)]
    upper, inclined = (message for name, message in seen if name == "impacts")
    for message, event, plate in ((upper, EVENTS[0], "upper_plate"), (inclined, EVENTS[2], "inclined_plate")):
        assert_header(message.header, stamp_of(event["time"]), f"r1/{plate}")
        force = message.wrench.force
        assert (force.x, force.y, force.z) == (0.0, 0.0, event["peak_force"])
    of_sensors = dict(seen[-4:])
    for name, frame in (("imu/data_raw", "imu_link"), ("encoder", "base_link"), ("battery", "base_link"),
                        ("tracking", "odom")):
        assert_header(of_sensors[name].header, stamp_of(0.5), f"r1/{frame}")
    imu, encoder, battery, tracking = (of_sensors[name] for name in ("imu/data_raw", "encoder", "battery", "tracking"))
    assert imu.linear_acceleration.z == 3.0 and imu.angular_velocity.x == 4.0
    assert imu.linear_acceleration_covariance.tolist() == (7.0 * np.eye(3)).ravel().tolist()
    assert imu.angular_velocity_covariance.tolist() == (8.0 * np.eye(3)).ravel().tolist()
    assert imu.orientation_covariance[0] == -1.0
    assert (list(encoder.name), list(encoder.position), list(encoder.velocity)) == (["crank"], [1.5], [2.5])
    assert np.isnan(encoder.effort).all() and np.isnan(battery.percentage)
    assert (battery.voltage, battery.current, battery.present) == (30.0, -1.5, True)
    assert np.flatnonzero(tracking.pose.covariance).tolist() == [0, 7, 14]


def test_rclpy_publishes_bytes_by_its_handle(bench):
    """`publish_raw` and `get_subscription_count` of a handle are not documented, so this test fails if rclpy changes or
    removes them; `Publisher.publish` and `Publisher.get_subscription_count` do the same in twice the time.
    """
    publisher, heard = bench.node.create_publisher(Float64, "numbers", 10), []
    bench.node.create_subscription(Float64, "numbers", heard.append, 10)
    bench.spin_until(lambda: publisher.handle.get_subscription_count() == 1, "match")
    publisher.handle.publish_raw(serialize_message(Float64(data=1.5)))
    bench.spin_until(lambda: heard == [Float64(data=1.5)], "message")


@pytest.mark.parametrize("namespace", ["", "/a/bcd"])
def test_publisher_and_bag_get_the_same_bytes_of_a_sample_and_its_impacts(bench, namespace):
    node = Node("robot", context=bench.node.context, namespace=namespace)
    scene, heard, recorded = load_scene("device"), [], []
    publishing = RobotPublishers(node, scene, "r12/")
    for topic in publishing.publishers:
        bench.node.create_subscription(
            message_class(TOPICS[topic].type), f"{namespace}/{topic}",
            lambda data, topic=topic: heard.append((f"{namespace}/{topic}", data)), 10, raw=True)
    bench.spin_until(lambda: all(publisher.get_subscription_count() for publisher in publishing.publishers.values()),
                     "discovery")
    ((values, _),) = random_cases(5, 1)
    robot_time = RobotTime(200.0, stamp_of(0.0))
    robot_time.ticks, sampled = 70, stamp_of(0.35)
    publishing.publish(values, EVENTS, robot_time, lambda *message: recorded.append(message))
    bench.spin_until(lambda: len(heard) == len(recorded), "messages")
    node.destroy_node()
    assert sorted(heard) == sorted((topic, data) for topic, _, data in recorded)
    assert {stamp for _, stamp, _ in recorded} == {sampled}
    expected = RobotMessages(scene, "r12/", NONE).of_sample(values, EVENTS, (), sampled, stamp_of)
    assert [(topic, data) for topic, _, data in recorded] == [(f"{namespace}/{name}", data) for name, data in expected]


def test_a_subscriber_of_samples_gets_every_quantity_by_its_name(bench):
    publishing, heard = RobotPublishers(bench.node, load_scene("machine")), []
    bench.node.create_subscription(Float64MultiArray, "bench/samples", heard.append, 10)
    ((values, _),) = random_cases(3, 1)
    robot_time = RobotTime(200.0, stamp_of(0.0))
    robot_time.ticks = 70
    robot_time.restart()  # which turns only the device's own time back

    def published() -> bool:
        publishing.publish(values, NO_EVENTS, robot_time, lambda *message: None)
        return bool(heard)

    bench.spin_until(published, "a sample")
    message = heard[0]
    names = message.layout.dim[0].label.split(",")
    assert message.layout.dim[0].size == message.layout.dim[0].stride == len(names) == len(message.data)
    sample = dict(zip(names, message.data, strict=True))
    assert (sample.pop("start_seconds"), sample.pop("start_nanoseconds")) == divmod(stamp_of(0.0), 10**9)
    assert tuple(sample) == FIELDS and sample.pop("time") == 0.35 and TIME == 0
    assert bits(list(sample.values())) == bits(values[1:])


def test_every_row_of_the_table_makes_a_message():
    """Each path of a row is a field of the message, and each source is a field of a sample."""
    messages = RobotMessages(load_scene("machine").with_parameters(SENSORS), "", ALL)
    assert set(messages.topics) == {name for name, topic in TOPICS.items() if topic.when in ("sample", "event", "once")}
    fields = [field.lstrip("-") for topic in TOPICS.values() for field in topic.numbers.values()]
    assert len(fields) == len(set(fields)) == 9 and set(fields) < set(FIELDS)
