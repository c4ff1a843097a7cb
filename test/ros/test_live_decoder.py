"""Samples are read from bytes as rclpy would read them, or not at all."""

import struct

import numpy as np
import pytest
from rclpy.serialization import serialize_message

import vibro_ros
from vibro_ros.bag.cdr import jazzy_types
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.ros.live.live_decoder import MOST_ODD, STAMPED, decoders
from vibro_ros.ros.topics.publishers import sample_makers
from vibro_ros.ros.topics.templates import plain_bytes
from vibro_ros.simulation.samples import FIELDS

STAMP = 1_763_700_000_123_456_789
SCENE = vibro_ros.load_scene("device")
NUMBERS = [(-1) ** i * (i + 1) / 7.0 for i in range(len(FIELDS))]


def message(topic: str, numbers=NUMBERS, stamp: int = STAMP, prefix: str = "") -> bytes:
    """As the robot fills it; rclpy leaves bytes between fields to chance."""
    return plain_bytes(sample_makers(SCENE, prefix)[topic](numbers, stamp), ROBOT_TOPICS[topic])


def all_fields(found) -> set[str]:
    return {FIELDS[which] for one in found.values() for which in one.fields}


@pytest.mark.parametrize("prefix", ["", "r1/", "a_long_prefix_of_many_letters/"])
def test_every_number_is_found_where_rclpy_puts_it(prefix):
    found = decoders(SCENE, prefix)
    assert all_fields(found) == set(FIELDS) - {"time", "motor_power"}
    for topic in STAMPED:
        stamps = [STAMP + 5_000_000 * number for number in range(40)]
        numbers = [[value * (number + 1) for value in NUMBERS] for number in range(40)]
        read = found[topic].read([message(topic, *one, prefix) for one in zip(numbers, stamps, strict=True)])
        assert read.stamps.tolist() == stamps and read.chosen == list(range(40))
        assert read.values.tolist() == [[one[which] for which in found[topic].fields] for one in numbers]


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_shipped_scene_s_samples_are_read(name):
    scene, device = vibro_ros.load_scene(name), vibro_ros.Simulator(vibro_ros.load_scene(name))
    device.advance_to(0.01)
    made, found = sample_makers(scene, ""), decoders(scene, "")
    for topic in STAMPED:
        data = plain_bytes(made[topic](device.values.tolist(), STAMP), ROBOT_TOPICS[topic])
        read = found[topic].read([data])
        assert read.values.tolist() == [[device.values[which] for which in found[topic].fields]]


def test_another_byte_order_and_padding_are_read_too():
    found = decoders(SCENE, "")["odom"]
    store, kind = jazzy_types(), ROBOT_TOPICS["odom"]
    big = bytes(store.serialize_cdr(store.deserialize_cdr(message("odom"), kind), kind, little_endian=False))
    of_rclpy = serialize_message(sample_makers(SCENE, "")["odom"](NUMBERS, STAMP))
    read = found.read([big, message("odom"), message("odom") + bytes(3), of_rclpy])
    assert read.chosen == [0, 1, 2, 3]
    assert (read.values == read.values[0]).all()


@pytest.mark.parametrize("topic", STAMPED)
def test_whatever_is_no_sample_of_this_robot_is_left_out(topic):
    good = message(topic)
    found = decoders(SCENE, "")[topic]
    chance = np.random.default_rng(5)
    bad = [b"", b"\0", b"\0\1\0\0", good[:-1], good[:50], good + bytes(8), b"\0\3" + good[2:],
           message(topic, prefix="r2/"), message(topic, [np.nan] * len(FIELDS)),
           message(topic, [-np.inf] * len(FIELDS)),
           good[:4] + struct.pack("<i", -1) + good[8:], good[:8] + struct.pack("<I", 1_000_000_000) + good[12:]]
    bad += [chance.bytes(len(good)) for _ in range(5)]
    for one in bad:
        assert found.read([one]).chosen == [], one
    mixed = [part for one in bad for part in (one, good)]
    assert found.read(mixed).chosen == list(range(1, len(mixed), 2))


def test_a_flood_in_another_form_costs_no_more_than_a_few_messages():
    found = decoders(SCENE, "")["odom"]
    odd = message("odom") + bytes(3)
    read = found.read([*[odd] * 1000, message("odom")])
    assert len(read.chosen) == MOST_ODD + 1 and read.chosen[-1] == 1000


def test_joints_of_another_robot_are_left_out():
    other = sample_makers(SCENE.with_parameters({"effects.upper_mass": False}), "")["joint_states"]
    assert decoders(SCENE, "")["joint_states"].read([serialize_message(other(NUMBERS, STAMP))]).chosen == []
