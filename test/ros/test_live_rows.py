"""Messages of one stamp make one row; a publisher that counts anew is another run, and two are two robots."""

import numpy as np

from vibro_ros.ros.live.live_decoder import STAMPED, Readings
from vibro_ros.ros.live.live_rows import PATIENCE, Joining, Runs
from vibro_ros.simulation.samples import FIELDS

PLACES = {"odom": [1, 2], "joint_states": [10, 12], "ground_contact": [13]}  # speed and torque among the second


def readings(**stamps: list[int]) -> dict:
    """Readings with these stamps, whose values are the stamp plus the field's number."""
    found = {}
    for topic in STAMPED:
        own = np.array(stamps.get(topic, []), np.int64)
        values = own[:, None] + np.array(PLACES[topic], float) if len(own) else np.empty((0, len(PLACES[topic])))
        found[topic] = Readings(own, values, list(range(len(own)))), own * 10
    return found


def together(*stamps: int) -> dict:
    return readings(**dict.fromkeys(STAMPED, list(stamps)))


def test_a_row_is_what_all_topics_say_of_one_stamp():
    rows = Joining().join(together(5, 6, 7), PLACES)
    assert rows.stamps.tolist() == [5, 6, 7] and rows.counts.tolist() == [50, 60, 70]
    row = dict(zip(FIELDS, rows.values[1], strict=True))
    assert row[FIELDS[1]] == 7.0 and row[FIELDS[13]] == 19.0
    assert row["motor_power"] == row["motor_torque"] * row["motor_speed"]


def test_messages_wait_for_those_that_come_later_and_strange_ones_are_given_up():
    joining = Joining()
    assert not len(joining.join(readings(odom=[1, 2, 99], joint_states=[1]), PLACES).stamps)
    rows = joining.join(readings(joint_states=[2], ground_contact=[1, 2, 77]), PLACES)
    assert rows.stamps.tolist() == [1, 2]
    for stamp in range(1000, 1000 + 2 * PATIENCE):
        assert joining.join(together(stamp), PLACES).stamps.tolist() == [stamp]
    assert joining.given_up == 2


def test_a_flood_of_strange_stamps_displaces_no_sample():
    joining = Joining()
    for batch in range(30):
        strange = list(range(10_000 + 5000 * batch, 15_000 + 5000 * batch))
        rows = joining.join(readings(odom=[*strange, batch], joint_states=[batch], ground_contact=[batch]), PLACES)
        assert rows.stamps.tolist() == [batch]


def test_of_two_messages_with_one_stamp_the_first_counts():
    found = together(4)
    first, counts = found["odom"]
    found["odom"] = Readings(np.array([4, 4]), np.concatenate([first.values, first.values + 100.0]), [0, 1]), \
        np.array([1, 2])
    rows = Joining().join(found, PLACES)
    assert rows.stamps.tolist() == [4] and rows.values[0, 1] == 5.0


def test_one_setback_is_another_run_and_two_are_two_robots():
    now = [0.0]
    runs = Runs(lambda: now[0])
    assert not runs.begins_anew(np.array([40, 41, 42]))
    assert not runs.begins_anew(np.array([], np.int64))
    assert not runs.begins_anew(np.array([43, 47]))  # some were lost
    now[0] = 10.0
    assert runs.begins_anew(np.array([1, 2])) and not runs.rivals
    now[0] = 13.0
    assert runs.begins_anew(np.array([1])) and not runs.rivals
    now[0] = 13.5
    assert runs.begins_anew(np.array([200])) is False and not runs.rivals
    assert runs.begins_anew(np.array([2])) and runs.rivals
    now[0] = 15.4
    assert runs.rivals
    now[0] = 15.6
    assert not runs.rivals
    assert runs.begins_anew(np.array([3, 201, 4, 202, 5])) and runs.rivals
