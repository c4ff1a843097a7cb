"""Messages of samples are read exactly or refused. Another start, or time that goes back, is another run; two
alternating starts are two robots.
"""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.messages.codec import jazzy_types
from vibro_ros.messages.robot_messages import RobotMessages
from vibro_ros.messages.topics import SAMPLES, TOPICS
from vibro_ros.ros.live.robot import LONGEST, LONGEST_RUN, SECOND, Runs, read_sample
from vibro_ros.simulation.samples import FIELDS, TIME

START = 1_763_700_000_123_456_789
KIND = TOPICS[SAMPLES].type
NUMBERS = np.array([(-1) ** i * (i + 1) / 7.0 for i in range(len(FIELDS))])
GOOD = RobotMessages(vibro_ros.load_scene("machine")).whole_sample(NUMBERS, START, 12.5)


def test_every_number_is_what_the_robot_wrote_in_any_byte_order():
    store, expected = jazzy_types(), NUMBERS.copy()
    expected[TIME] = 12.5  # robot time, not the device's
    other_order = store.serialize_cdr(store.deserialize_cdr(GOOD, KIND), KIND, little_endian=False)
    for data in (GOOD, GOOD + bytes(3), bytes(other_order)):
        start, values = read_sample(data)
        assert start == START and values.tolist() == expected.tolist()


def changed(**fields: object) -> bytes:
    """Return a valid message with other values of a field, given by its name, or of `label`."""
    store = jazzy_types()
    message = store.deserialize_cdr(GOOD, KIND)
    message.layout.dim[0].label = fields.pop("label", message.layout.dim[0].label)
    data, names = message.data.copy(), message.layout.dim[0].label.split(",")
    for name, value in fields.items():
        data[names.index(name)] = value
    message.data = data
    return bytes(store.serialize_cdr(message, KIND))


@pytest.mark.parametrize("bad", [
    b"", b"\0\1\0\0", GOOD[:-1], GOOD[:50], GOOD + bytes(8), b"\0\3" + GOOD[2:], GOOD + bytes(LONGEST),
    np.random.default_rng(5).bytes(len(GOOD)), changed(label="start_seconds,start_nanoseconds,time"),
    changed(body_position=np.nan), changed(electrical_power=np.inf), changed(time=-1.0), changed(time=LONGEST_RUN),
    changed(start_seconds=-1.0), changed(start_seconds=2.0**31), changed(start_nanoseconds=float(SECOND)),
    changed(start_seconds=np.nan)])
def test_what_is_no_sample_is_left_out(bad):
    assert read_sample(bad) is None


def test_one_change_of_start_is_another_run_and_two_are_two_robots():
    now = [0.0]
    runs = Runs(lambda: now[0])
    assert not runs.restarted([7, 7, 7], [40.0, 41.0, 42.0])
    assert not runs.restarted([], [])
    assert not runs.restarted([7, 7], [43.0, 47.0])  # some were lost
    now[0] = 10.0
    assert runs.restarted([8, 8], [50.0, 51.0]) and not runs.rivals
    now[0] = 13.0
    assert runs.restarted([8], [0.0]) and not runs.rivals  # robot time drives ROS time: each start is at 0
    now[0] = 13.5
    assert not runs.restarted([8], [200.0]) and not runs.rivals
    assert runs.restarted([8], [2.0]) and runs.rivals
    now[0] = 15.4
    assert runs.rivals
    now[0] = 15.6
    assert not runs.rivals
    assert runs.restarted([8, 9, 8, 9, 8], [3.0, 201.0, 4.0, 202.0, 5.0]) and runs.rivals
