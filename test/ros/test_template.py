"""Bytes filled in place are those of rclpy: for any numbers and stamps, joints, prefixes and namespaces."""

import math
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64, String

from vibro_ros.bag.cdr import first_difference
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.ros import messages
from vibro_ros.ros.outputs import Outputs, makers
from vibro_ros.ros.template import Template, serialiser
from vibro_ros.simulation.samples import EVENT_DTYPE, Samples

NAMES = [field.name for field in fields(Samples)]
SPECIAL = [math.nan, -math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, -2.2e-308, 1.7976931348623157e308]
LAST_STAMP = 2**31 * 10**9 - 1  # [ns] of an int32 of seconds
STAMPS = [0, 1, 999_999_999, 10**9, 1_763_700_000_123_456_789, LAST_STAMP, -1, -2**31 * 10**9]
BOTH = ("upper", "inclined")
SIDES = [((), ()), *(((side,), plates) for side in BOTH for plates in ((), (side,))),
         *((BOTH, plates) for plates in ((), ("upper",), ("inclined",), BOTH))]


def random_cases(rng: np.random.Generator, count: int) -> list[tuple[Samples, int]]:
    """Samples of plain, special and any other numbers, NaN with a payload among them; and stamps."""
    cases = []
    for number in range(count):
        values = rng.standard_normal(len(NAMES))
        if number % 3 == 1:
            values = rng.choice(SPECIAL, len(NAMES))
        elif number % 3 == 2:
            values = np.frombuffer(rng.bytes(8 * len(NAMES)))
        stamp = STAMPS[number] if number < len(STAMPS) else int(rng.integers(0, LAST_STAMP))
        cases.append((Samples(*map(float, values)), stamp))
    return cases


def assert_same(filled: bytes, message, type_name: str) -> None:
    """Nothing differs but bytes that belong to no field; those are zero, so that equal messages have equal bytes."""
    made = serialize_message(message)
    assert len(filled) == len(made)
    assert first_difference(filled, made, type_name) is None
    aligned = np.array(bytearray(filled)) != np.array(bytearray(made))
    assert not np.array(bytearray(filled))[aligned].any()


def assert_filled_as_made(scene, prefix: str, cases) -> None:
    for topic, make in makers(scene, prefix).items():
        template = Template(make, ROBOT_TOPICS[topic])
        for state, stamp in cases:
            assert_same(template.fill(state, stamp), make(state, stamp), ROBOT_TOPICS[topic])


@pytest.mark.parametrize("name", shipped_scenes())
def test_filled_bytes_are_those_of_rclpy_for_any_numbers_and_stamps(name):
    assert_filled_as_made(load_scene(name), "", random_cases(np.random.default_rng(1), 60))


@pytest.mark.parametrize("length", range(10))
def test_filled_bytes_are_those_of_rclpy_whatever_a_prefix_does_to_alignment(length):
    cases = random_cases(np.random.default_rng(length), 9)
    for guides, plates in SIDES:
        assert_filled_as_made(SimpleNamespace(guides=guides, plates=plates), "äbcdefghij"[:length], cases)


@pytest.mark.parametrize("topic", ["odom", "joint_states", "ground_contact", "motor_power"])
def test_rclpy_reads_filled_bytes_as_the_message_that_was_meant(topic):
    make = makers(load_scene("device"), "r1/")[topic]
    template = Template(make, ROBOT_TOPICS[topic])
    for state, stamp in random_cases(np.random.default_rng(2), 40)[::3]:
        message = make(state, stamp)
        assert deserialize_message(template.fill(state, stamp), type(message)) == message


def test_a_message_filled_again_is_a_copy_of_its_own():
    template = Template(makers(load_scene("device"), "")["odom"], ROBOT_TOPICS["odom"])
    (one, other) = random_cases(np.random.default_rng(3), 2)
    first = template.fill(*one)
    assert template.fill(*other) != first == template.fill(*one)
    assert type(first) is bytes  # what publishers and bags take


@pytest.mark.parametrize(("make", "type_name", "reason"), [
    (lambda state, stamp: Float64(data=state.motor_speed + state.motor_power), "std_msgs/msg/Float64", "not those"),
    (lambda state, stamp: Float64(data=abs(state.motor_power)), "std_msgs/msg/Float64", "not those"),
    (lambda state, stamp: Float64(data=1e-3 * stamp), "std_msgs/msg/Float64", "not those"),
    (lambda state, stamp: String(data="later" * (state.time > 0.0)), "std_msgs/msg/String", "length"),
    (lambda state, stamp: Float64(data=state.time), "std_msgs/msg/String", "are no std_msgs/msg/String"),
])
def test_what_cannot_be_filled_in_place_is_serialised_by_rclpy_and_said(make, type_name, reason):
    said = []
    serialise = serialiser(make, type_name, said.append)
    (warning,) = said
    assert reason in warning
    for state, stamp in random_cases(np.random.default_rng(4), 30)[::3]:
        made = make(state, stamp)
        assert deserialize_message(serialise(state, stamp), type(made)) == made


def test_nothing_is_said_of_what_can_be_filled():
    for topic, make in makers(load_scene("device"), "").items():
        serialiser(make, ROBOT_TOPICS[topic], pytest.fail)


@pytest.mark.parametrize("namespace", ["", "/a/bcd"])
def test_publisher_and_bag_get_the_same_bytes_of_a_sample_and_its_impacts(bench, namespace):
    node = Node("robot", context=bench.node.context, namespace=namespace)
    scene, heard, recorded = load_scene("device"), [], []
    outputs = Outputs(node, scene, "r12/")
    for topic in outputs.publishers:
        kind = messages.message_class(ROBOT_TOPICS[topic])
        bench.node.create_subscription(kind, f"{namespace}/{topic}", lambda data, topic=topic: heard.append((
            f"{namespace}/{topic}", data)), 10, raw=True)
    bench.spin_until(lambda: all(one.get_subscription_count() for one in outputs.publishers.values()), "discovery")
    events = np.array([(0.25, "upper_contact", 0.7, 812.5, 3e-4), (0.26, "slip_forward", 0.0, 0.0, 0.0),
                       (0.27, "inclined_contact", 0.1, 3.5, 2e-4)], dtype=EVENT_DTYPE)
    ((state, _),) = random_cases(np.random.default_rng(5), 1)

    def stamp_of(time: float) -> int:
        return 10**18 + round(1e9 * time)

    outputs.publish(state, events, stamp_of, lambda topic, stamp, data: recorded.append((topic, stamp, data)))
    bench.spin_until(lambda: len(heard) == len(recorded), "messages")
    node.destroy_node()
    assert sorted(heard) == sorted((topic, data) for topic, _, data in recorded)
    assert {stamp for _, stamp, _ in recorded} == {stamp_of(state.time)}
    made = {**makers(scene, "r12/")}
    expected = [(topic, make(state, stamp_of(state.time))) for topic, make in made.items()]
    expected += [("impacts", messages.impact(events[k], stamp_of(events[k]["time"]), "r12/")) for k in (0, 2)]
    assert [topic for topic, _, _ in recorded] == [f"{namespace}/{topic}" for topic, _ in expected]
    for (_, _, data), (topic, message) in zip(recorded, expected, strict=True):
        assert first_difference(data, serialize_message(message), ROBOT_TOPICS[topic]) is None
