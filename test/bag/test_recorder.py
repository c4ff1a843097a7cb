"""The recorder: complete and byte-identical bags, and counted drops."""

import contextlib
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Message
from mcap.stream_reader import StreamReader
from real_processes import wait_until
from recorded_bag import METADATA, POWER, TOPICS, by_mcap, by_rosbags, mcap_file
from rosbags.interfaces import QosReliability
from rosbags.rosbag2 import Reader

from vibro_ros.bag.metadata import Topic
from vibro_ros.bag.recorder import LAST_STAMP, BagWriter, Recorder

MESSAGES = int(os.environ.get("VIBRO_ROS_MESSAGES", "4000"))  # VIBRO_ROS_MESSAGES=7000000 for the long version


@pytest.fixture
def sent(published, start_ns) -> list[tuple[str, int, bytes]]:
    """Return 400 messages, from every topic in turn, in the order of their stamps."""
    return [(topic, start_ns + i * 1_000_000 + k, message(i))
            for i in range(400) for k, (topic, message) in enumerate(published.items())]


@pytest.fixture
def sealed(folder, sent) -> Path:
    with Recorder(folder, TOPICS, METADATA) as recorder:
        assert all([recorder.write(*message) for message in sent])
    assert (recorder.written, recorder.dropped, recorder.fault) == (len(sent), 0, None)
    return folder


def test_rosbags_and_mcap_read_every_message_byte_for_byte_in_order(sealed, sent, recorded):
    assert by_rosbags(sealed) == by_mcap(sealed) == recorded(mcap_file(sealed)) == sent


def test_bag_keeps_types_qos_and_custom_data(sealed):
    with Reader(sealed) as reader:
        offered = {connection.topic: (connection.msgtype, connection.ext.offered_qos_profiles[0])
                   for connection in reader.connections}
        assert {topic: (kind, qos.depth) for topic, (kind, qos) in offered.items()} == {
            topic.name: (topic.type_name, topic.qos_depth) for topic in TOPICS}
        assert {qos.reliability for _, qos in offered.values()} == {QosReliability.RELIABLE}
        assert reader.storage.metadata.custom == METADATA | {"written": "1600", "dropped": "0", "lost": "0"}


def test_last_message_before_a_silence_reaches_the_disk(folder, published, start_ns, recorded):
    message = ("/motor_power", start_ns, published["/motor_power"](1))
    with Recorder(folder, POWER, METADATA) as recorder:
        recorder.write(*message)
        wait_until(lambda: recorder.written == 1, "the recorder")
        assert recorded(mcap_file(folder)) == [message]


@pytest.mark.parametrize("stamp", [-1, 1.5, None, True, "1", LAST_STAMP + 1, 2**64])
def test_invalid_messages_are_refused_and_counted(folder, published, recorded, stamp):
    data = published["/motor_power"](1)
    with Recorder(folder, POWER, METADATA) as recorder:
        assert recorder.write("/motor_power", 7, data)
        assert not recorder.write("/motor_power", stamp, data)
        assert not recorder.write("/odom", 1, data)  # no topic of this bag
        assert not recorder.write("/motor_power", 1, "text")
        assert recorder.write("/motor_power", LAST_STAMP, data)
        assert recorder.dropped == 3
    assert (recorder.written, recorder.fault) == (2, None)
    assert recorded(mcap_file(folder)) == [("/motor_power", 7, data), ("/motor_power", LAST_STAMP, data)]


def test_a_full_queue_drops_and_counts_and_takes_inputs_when_it_drops_others(folder, published, monkeypatch):
    """A replay can compute dropped samples again, but not a dropped command."""
    gate, write = threading.Event(), BagWriter.write
    monkeypatch.setattr(BagWriter, "write", lambda *message: gate.wait(30.0) and write(*message))
    data, command = published["/motor_power"](1), Topic("/motor_speed", "std_msgs/msg/Float64", 10, is_input=True)
    with Recorder(folder, [*POWER, command], METADATA, backlog=3) as recorder, contextlib.ExitStack() as before_close:
        before_close.callback(gate.set)
        assert recorder.write("/motor_power", 0, data)
        wait_until(lambda: recorder.backlog == 0, "the recorder")
        taken = [[recorder.write(topic.name, stamp, data) for topic in (*POWER, command)] for stamp in range(1, 6)]
        assert taken == [[True, True], [True, True], [False, True], [False, True], [False, False]]
        assert (recorder.backlog, recorder.dropped) == (6, 4)
    assert (recorder.written, recorder.dropped, recorder.fault) == (7, 4, None)


def test_close_is_idempotent_ends_the_thread_and_ends_writing(folder, published):
    threads_before = threading.active_count()
    recorder = Recorder(folder, POWER, METADATA)
    recorder.write("/motor_power", 1, published["/motor_power"](1))
    recorder.close()
    sealed = mcap_file(folder).read_bytes()
    recorder.close()
    assert not recorder.write("/motor_power", 2, published["/motor_power"](2))
    assert threading.active_count() == threads_before
    assert (recorder.written, recorder.dropped, recorder.fault) == (1, 1, None)
    assert mcap_file(folder).read_bytes() == sealed


def test_writers_in_several_threads_lose_nothing(folder, published):
    data, share = published["/motor_power"](1), MESSAGES // 4

    def write(begin: int) -> None:
        for stamp in range(begin, begin + share):
            while recorder.is_backlogged:
                time.sleep(0.001)
            recorder.write("/motor_power", stamp, data)

    with Recorder(folder, POWER, METADATA) as recorder:
        threads = [threading.Thread(target=write, args=[k * share]) for k in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert (recorder.written, recorder.dropped, recorder.lost) == (4 * share, 0, 0)
    read = np.zeros(4 * share, dtype=int)
    with mcap_file(folder).open("rb") as file:
        for record in StreamReader(file).records:
            if isinstance(record, Message) and record.data == data:
                read[record.log_time] += 1
    assert (read == 1).all()
