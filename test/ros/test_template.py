"""Bytes filled in place are those of rclpy: for any numbers and stamps, joints, prefixes and namespaces."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64, String

from vibro_ros.bag.cdr import first_difference
from vibro_ros.bag.recorder import Together
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.messages.frames import ALL, ONLY_BASE, Frames
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.ros.topics import messages, outputs
from vibro_ros.ros.topics.outputs import Outputs, makers
from vibro_ros.ros.topics.raw_publisher import RawPublisher
from vibro_ros.ros.topics.sheet import Sheet, checked_template
from vibro_ros.ros.topics.template import Template
from vibro_ros.simulation.samples import EVENT_DTYPE, FIELDS, TIME, Samples

NO_EVENTS = np.empty(0, dtype=EVENT_DTYPE)
SPECIAL = [math.nan, -math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, -2.2e-308, 1.7976931348623157e308]
LAST_STAMP = 2**31 * 10**9 - 1  # [ns] of an int32 of seconds
STAMPS = [0, 1, 999_999_999, 10**9, 1_763_700_000_123_456_789, LAST_STAMP, -1, -2**31 * 10**9]
BOTH = ("upper", "inclined")
SIDES = [((), ()), *(((side,), plates) for side in BOTH for plates in ((), (side,))),
         *((BOTH, plates) for plates in ((), ("upper",), ("inclined",), BOTH))]


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


def assert_same(filled: bytes, message, type_name: str) -> None:
    """Nothing differs but bytes that belong to no field; those are zero, so that equal messages have equal bytes."""
    made = serialize_message(message)
    assert len(filled) == len(made)
    assert first_difference(filled, made, type_name) is None
    aligned = np.array(bytearray(filled)) != np.array(bytearray(made))
    assert not np.array(bytearray(filled))[aligned].any()


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


@pytest.mark.parametrize("length", range(10))
def test_filled_bytes_are_those_of_rclpy_whatever_a_prefix_does_to_alignment(length):
    cases = random_cases(np.random.default_rng(length), 9)
    for guides, plates in SIDES:
        assert_filled_as_made(SimpleNamespace(guides=guides, plates=plates), "äbcdefghij"[:length], cases)


@pytest.mark.parametrize("length", range(8))
@pytest.mark.parametrize("published", [ONLY_BASE, ALL])
def test_filled_transforms_are_those_of_rclpy_for_any_numbers_and_prefix(length, published):
    pytest.importorskip("tf2_msgs.msg", reason="types of tf2_msgs are not built: no compiler")
    rng = np.random.default_rng(length)
    for scene in map(load_scene, ("device", "no_impact")):
        frames = Frames(scene, "äbcdefgh"[:length], published)
        make, count = partial(outputs._transforms, frames), len(FIELDS) + len(frames.turns(0.0))
        sheet = Sheet([checked_template(make, ROBOT_TOPICS["tf"], count, pytest.fail)])
        for values, stamp in random_cases(rng, 12):
            numbers = np.concatenate([values, rng.standard_normal(count - len(FIELDS))])
            sheet.fill(numbers, stamp)
            assert_same(sheet.messages[0].tobytes(), make(numbers.tolist(), stamp), ROBOT_TOPICS["tf"])


@pytest.mark.parametrize("topic", ["odom", "joint_states", "ground_contact", "motor_power"])
def test_rclpy_reads_filled_bytes_as_the_message_that_was_meant(topic):
    make = makers(load_scene("device"), "r1/")[topic]
    sheet = Sheet([template_of(make, ROBOT_TOPICS[topic])])
    for values, stamp in random_cases(np.random.default_rng(2), 40)[::3]:
        message = made(make, values, stamp)
        sheet.fill(values, stamp)
        assert deserialize_message(sheet.messages[0].tobytes(), type(message)) == message


NOT_FILLED = [
    (lambda state, stamp: Float64(data=state.motor_speed + state.motor_power), "std_msgs/msg/Float64", "not those"),
    (lambda state, stamp: Float64(data=abs(state.motor_power)), "std_msgs/msg/Float64", "not those"),
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


def test_nothing_is_said_of_what_can_be_filled():
    for topic, make in makers(load_scene("device"), "").items():
        assert checked_template(partial(made, make), ROBOT_TOPICS[topic], len(FIELDS), pytest.fail)


def test_what_cannot_be_filled_in_place_is_serialised_by_rclpy_and_published_and_recorded(bench, monkeypatch):
    make = NOT_FILLED[0][0]
    monkeypatch.setattr(outputs, "makers", lambda scene, prefix: {**makers(scene, prefix), "motor_power": make})
    publishing, heard, recorded = Outputs(bench.node, load_scene("device")), [], {}
    bench.node.create_subscription(Float64, "motor_power", heard.append, 10)
    bench.spin_until(publishing.publishers["motor_power"].get_subscription_count, "discovery")
    ((values, _),) = random_cases(np.random.default_rng(4), 1)
    publishing.publish(values, NO_EVENTS, 7, lambda time: 7,
                       lambda topic, stamp, data: recorded.update(split(topic, data)))
    bench.spin_until(lambda: heard, "message")
    assert heard == [made(make, values, 7)]
    assert deserialize_message(recorded["/motor_power"], Float64) == heard[0]
    assert list(recorded) == ["/odom", "/joint_states", "/ground_contact", "/motor_power"]


def test_a_publisher_that_is_gone_raises_as_rclpy_does(domain_id):
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = Node("gone", context=context)
    raw = RawPublisher(node.create_publisher(Float64, "power", 10), np.zeros(12, np.uint8))
    raw.publish()
    rclpy.shutdown(context=context)
    with pytest.raises(RuntimeError, match="publish"):
        raw.publish()
    node.destroy_node()


@pytest.mark.parametrize(("namespace", "filled"), [("", True), ("/a/bcd", True), ("", False)])
def test_publisher_and_bag_get_the_same_bytes_of_a_sample_and_its_impacts(bench, namespace, filled, monkeypatch):
    """Filled in place, and where nothing can be filled in place."""
    if not filled:
        monkeypatch.setattr(outputs, "checked_template", lambda *_: None)
    node = Node("robot", context=bench.node.context, namespace=namespace)
    scene, heard, recorded = load_scene("device"), [], []
    publishing = Outputs(node, scene, "r12/")
    for topic in publishing.publishers:
        kind = messages.message_class(ROBOT_TOPICS[topic])
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
    expected += [("impacts", messages.impact(events[k], stamp_of(events[k]["time"]), "r12/")) for k in (0, 2)]
    assert [topic for topic, _, _ in recorded] == [f"{namespace}/{topic}" for topic, _ in expected]
    for (_, _, data), (topic, message) in zip(recorded, expected, strict=True):
        assert first_difference(data, serialize_message(message), ROBOT_TOPICS[topic]) is None
