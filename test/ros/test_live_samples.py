"""Samples are read as the robot wrote them, or not at all; messages of one stamp make one row; a count that goes back
is another run, and two in a row are two robots."""

import struct

import numpy as np
import pytest

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.messages.codec import jazzy_types
from vibro_ros.messages.robot_messages import RobotMessages
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.ros.live.robot import Runs
from vibro_ros.ros.live.samples import MOST_WAITING, PATIENCE, STAMPED, Decoder, Joining, Reading
from vibro_ros.simulation.samples import EVENT_DTYPE, FIELDS

STAMP = 1_763_700_000_123_456_789
SCENE = vibro_ros.load_scene("device")
NUMBERS = [(-1) ** i * (i + 1) / 7.0 for i in range(len(FIELDS))]
CURRENT = FIELDS.index("motor_current")
COLUMNS = {"odom": [1, 2], "joint_states": [10, 12], "ground_contact": [13]}  # speed and torque among the second


def message(topic: str, numbers=NUMBERS, stamp: int = STAMP, prefix: str = "", scene=SCENE) -> bytes:
    made = RobotMessages(scene, prefix).of_sample(np.array(numbers), np.empty(0, EVENT_DTYPE), (), stamp, int)
    return dict(made)[topic]


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_number_is_what_the_robot_wrote(name):
    scene = vibro_ros.load_scene(name)
    decoder, found = Decoder(scene, "r1/"), {}
    for topic in decoder.columns:
        stamp, count, values = decoder.read(topic, message(topic, prefix="r1/", scene=scene), 7)
        assert (stamp, count) == (STAMP if topic in STAMPED else 0, 7)
        found |= dict(zip(decoder.columns[topic], values, strict=True))
    assert found == {which: NUMBERS[which] for which in found}
    if name in ("device", "machine"):
        electrical = {"motor_current", "electrical_power"} if name == "device" else set()
        assert {FIELDS[which] for which in found} == set(FIELDS) - {"time", "motor_power", "motor_voltage"} - electrical


def test_another_byte_order_and_padding_are_read_too():
    decoder, (store, kind) = Decoder(SCENE, ""), (jazzy_types(), ROBOT_TOPICS["odom"])
    good = message("odom")
    big = bytes(store.serialize_cdr(store.deserialize_cdr(good, kind), kind, little_endian=False))
    assert decoder.read("odom", big, 3) == decoder.read("odom", good + bytes(3), 3) == decoder.read("odom", good, 3)
    assert decoder.read("odom", good, None).number == STAMP  # a middleware that does not tell counts


@pytest.mark.parametrize("topic", STAMPED)
def test_whatever_is_no_sample_of_this_robot_is_left_out(topic):
    good, decoder, chance = message(topic), Decoder(SCENE, ""), np.random.default_rng(5)
    other = SCENE.with_parameters({"effects.upper_mass": False})
    bad = [b"", b"\0\1\0\0", good[:-1], good[:50], good + bytes(8), b"\0\3" + good[2:], chance.bytes(len(good)),
           message(topic, prefix="r2/"), message(topic, [np.nan] * len(FIELDS)), good + bytes(10**6),
           good[:4] + struct.pack("<i", -1) + good[8:], good[:8] + struct.pack("<I", 1_000_000_000) + good[12:]]
    bad += [message(topic, scene=other)] if topic == "joint_states" else []
    assert [decoder.read(topic, one, 1) for one in bad] == [None] * len(bad)


def readings(**stamps: list[int]) -> dict[str, list[Reading]]:
    """Readings with these stamps, whose values are the stamp plus the field's number."""
    return {topic: [Reading(stamp, 10 * stamp, [float(stamp + column) for column in COLUMNS[topic]])
                    for stamp in stamps.get(topic, [])] for topic in STAMPED}


def together(*stamps: int) -> dict[str, list[Reading]]:
    return readings(**dict.fromkeys(STAMPED, list(stamps)))


def test_a_row_is_what_all_topics_say_of_one_stamp():
    rows = Joining().join(together(5, 6, 7), COLUMNS)
    assert rows.stamps.tolist() == [5, 6, 7] and rows.counts.tolist() == [50, 60, 70]
    row = dict(zip(FIELDS, rows.values[1], strict=True))
    assert row[FIELDS[1]] == 7.0 and row[FIELDS[13]] == 19.0
    assert row["motor_power"] == row["motor_torque"] * row["motor_speed"]


def test_messages_wait_for_those_that_come_later_and_strange_ones_are_given_up():
    joining = Joining()
    assert not len(joining.join(readings(odom=[1, 2, 99], joint_states=[1]), COLUMNS).stamps)
    rows = joining.join(readings(joint_states=[2], ground_contact=[1, 2, 77]), COLUMNS)
    assert rows.stamps.tolist() == [1, 2]
    for stamp in range(1000, 1000 + 2 * PATIENCE):
        assert joining.join(together(stamp), COLUMNS).stamps.tolist() == [stamp]
    assert not len(joining.join(readings(joint_states=[99], ground_contact=[99]), COLUMNS).stamps)


def test_what_has_no_stamp_is_of_the_sample_with_its_number_and_waited_for_where_there_are_numbers():
    columns = {**COLUMNS, "motor_current": [CURRENT]}

    def joined(joining, stamps, numbers):
        found = joining.join({**together(*stamps), "motor_current": [Reading(0, one, [one / 4]) for one in numbers]},
                             columns)
        return list(zip(found.stamps.tolist(), found.values[:, CURRENT].tolist(), strict=True))

    joining = Joining()
    assert joined(joining, [5, 6], [60, 50, -1]) == [(5, 12.5), (6, 15.0)]  # a number is ten times the stamp
    assert joined(joining, [7, 8], [70]) == [(7, 17.5)]
    assert joined(joining, [9], [90]) == [] and joined(joining, [], [80]) == [(8, 20.0), (9, 22.5)]
    found = [joined(joining, [10 + batch], [100 + 10 * batch] if batch else []) for batch in range(PATIENCE + 2)]
    assert found[:PATIENCE] == [[]] * PATIENCE  # the number 100 is lost, and its sample is not
    rows = sum(found, [])
    assert rows[0][0] == 10 and np.isnan(rows[0][1])
    assert rows[1:] == [(stamp, 2.5 * stamp) for stamp in range(11, 12 + PATIENCE)]


def test_a_flood_of_strange_stamps_displaces_no_sample():
    joining = Joining()
    for batch in range(30):
        strange = list(range(10_000 + 5000 * batch, 10_000 + 5000 * batch + 2 * MOST_WAITING))
        rows = joining.join(readings(odom=[*strange, batch], joint_states=[batch], ground_contact=[batch]), COLUMNS)
        assert rows.stamps.tolist() == [batch]


def test_one_setback_is_another_run_and_two_are_two_robots():
    now = [0.0]
    runs = Runs(lambda: now[0])
    assert not runs.restarted(np.array([40, 41, 42]))
    assert not runs.restarted(np.array([], np.int64))
    assert not runs.restarted(np.array([43, 47]))  # some were lost
    now[0] = 10.0
    assert runs.restarted(np.array([1, 2])) and not runs.rivals
    now[0] = 13.0
    assert runs.restarted(np.array([1])) and not runs.rivals
    now[0] = 13.5
    assert runs.restarted(np.array([200])) is False and not runs.rivals
    assert runs.restarted(np.array([2])) and runs.rivals
    now[0] = 15.4
    assert runs.rivals
    now[0] = 15.6
    assert not runs.rivals
    assert runs.restarted(np.array([3, 201, 4, 202, 5])) and runs.rivals
