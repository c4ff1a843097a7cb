"""`recover`: what a killed recorder leaves is sealed, with all that was flushed."""

import contextlib
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import IndexType
from mcap.writer import Writer as ForeignWriter
from recorded_bag import POWER, STORAGES, by_mcap, by_rosbags, content
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from vibro_ros.bag.folders import unsealed_bags
from vibro_ros.bag.recorder import Recorder
from vibro_ros.bag.recovery import RecoveryError, recover
from vibro_ros.bag.writer import Storage
from vibro_ros.recordings import recover as executable

ROOT = str(Path(__file__).parents[2])
KILLS = int(os.environ.get("VIBRO_ROS_KILLS", "3"))  # VIBRO_ROS_KILLS=100 for the long version
LONGEST_LOSS = 0.15  # [s] what the issue allows

# Writes for ever and says what it has written, [ns] of the monotonic clock; its own pauses are the machine's.
ENDLESS = """
import sys, time
from pathlib import Path
from vibro_ros.bag.recorder import Recorder, Topic
from vibro_ros.bag.writer import Storage
compression, size, rate = sys.argv[2:]
topics = [Topic("/odom", "nav_msgs/msg/Odometry", 10), Topic("/motor_power", "std_msgs/msg/Float64", 10)]
recorder = Recorder(Path(sys.argv[1]), topics, {"scene": "device"}, storage=Storage(compression, int(size)))
due = time.monotonic()
while True:
    stamp = time.monotonic_ns()
    assert recorder.write("/odom", stamp, stamp.to_bytes(8, "little") * 88)
    assert recorder.write("/motor_power", stamp, bytes.fromhex("00010000") + stamp.to_bytes(8, "little"))
    print(stamp, flush=True)
    due += 1.0 / float(rate)
    time.sleep(max(0.0, due - time.monotonic()))
"""


def killed(folder: Path, storage: Storage, rate: float, after: float) -> list[int]:
    """Record in a process of its own and kill that after so many seconds; the stamps that it wrote."""
    words = [storage.compression, str(storage.max_size), str(rate)]
    child = subprocess.Popen([sys.executable, "-c", ENDLESS, str(folder), *words], stdout=subprocess.PIPE, text=True,
                             env=os.environ | {"PYTHONPATH": ROOT})
    try:
        first = child.stdout.readline()
        time.sleep(after)
    finally:
        child.kill()
        rest, _ = child.communicate()
    assert first
    # a line cut by the kill is no promise of the child's
    return [int(line) for line in [first, *rest.splitlines(keepends=True)] if line.endswith("\n")]


@pytest.mark.parametrize("attempt", range(KILLS))
def test_a_killed_recorder_loses_the_last_moments_only(tmp_path, attempt):
    after = random.Random(time.monotonic_ns()).uniform(0.0, 1.0)
    storage = list(STORAGES.values())[attempt % len(STORAGES)]
    rate = (1000.0, 50.0)[attempt // len(STORAGES) % 2]
    folder = tmp_path / "run"
    written = killed(folder, storage, rate, after)
    with contextlib.suppress(RecoveryError):
        recover(folder)
    assert (folder / "metadata.yaml").exists(), (after, sorted(folder.iterdir()))
    found = by_rosbags(folder)
    assert by_mcap(folder) == found
    power = [int.from_bytes(data[4:], "little") for topic, _, data in found if topic == "/motor_power"]
    odom = [stamp for topic, stamp, _ in found if topic == "/odom"]
    assert power == [stamp for topic, stamp, _ in found if topic == "/motor_power"]
    assert len(odom) - len(power) in (0, 1)
    # the last may be there although the child could not say so any more
    assert power[:len(written)] == written[:len(power)]
    assert len(power) <= len(written) + 1
    # what the machine itself held up is no loss of the recorder's
    pause = max((later - earlier for earlier, later in zip(written, written[1:], strict=False)), default=0)
    owed = [stamp for stamp in written if stamp < written[-1] - LONGEST_LOSS * 1e9 - max(0, pause - 1e9 / rate)]
    assert len(power) >= len(owed), f"killed after {after} s: {len(owed) - len(power)} messages too few"


@pytest.mark.parametrize("storage", STORAGES.values(), ids=STORAGES)
def test_everything_flushed_is_there_and_so_is_what_the_bag_says_of_itself(unsealed, storage):
    folder, sent = unsealed(storage)
    done = recover(folder)
    assert (done.messages, done.cut, done.last, done.was_sealed) == (60, 0, sent[-1][1], False)
    assert by_rosbags(folder) == sent
    with Reader(folder) as reader:
        custom = reader.storage.metadata.custom
        (topic,) = reader.connections
    assert (custom["scene"], custom["written"], custom["recovered"]) == ("device", "60", "true")
    assert topic.digest.startswith("RIHS01_")
    assert topic.ext.offered_qos_profiles[0].depth == 10


def test_lost_metadata_are_made_again_from_sealed_files(tmp_path, published):
    with Recorder(tmp_path / "run", POWER, {"scene": "x"}, storage=Storage(max_duration=0.1)) as recorder:
        for i in range(300):
            recorder.write("/motor_power", i * 1_000_000, published["/motor_power"](i))
    before = content(tmp_path / "run")
    messages = by_rosbags(tmp_path / "run")
    for lost in (None, b"", before["metadata.yaml"][:100]):
        (tmp_path / "run" / "metadata.yaml").unlink()
        if lost is not None:
            (tmp_path / "run" / "metadata.yaml").write_bytes(lost)
        assert recover(tmp_path / "run").messages == 300
        after = content(tmp_path / "run")
        assert {name: data for name, data in after.items() if name.endswith(".mcap")} == {
            name: data for name, data in before.items() if name.endswith(".mcap")}
        assert by_rosbags(tmp_path / "run") == messages


def test_a_bag_that_another_recorder_left_is_sealed(tmp_path, published):
    """rosbags keeps definitions and topics inside of chunks."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(tmp_path / "run", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.open()
    topic = writer.add_connection("/motor_power", "std_msgs/msg/Float64", typestore=store)
    for i in range(40_000):  # a chunk of 1 MiB, and another that is lost
        writer.write(topic, i, published["/motor_power"](1))
    with pytest.raises(RecoveryError, match=f"in use, process {os.getpid()} writes to it"):
        recover(tmp_path / "run")
    writer.abort()
    done = recover(tmp_path / "run")
    assert 20_000 < done.messages < 40_000
    assert [stamp for _, stamp, _ in by_rosbags(tmp_path / "run")] == list(range(done.messages))
    assert len(by_mcap_any(tmp_path / "run" / "run.mcap")) == done.messages


def by_mcap_any(path: Path) -> list[int]:
    with path.open("rb") as file:
        return [message.log_time for _, _, message in make_reader(file).iter_messages()]


@pytest.mark.parametrize("chunked", [True, False])
def test_a_file_without_indexes_is_sealed(tmp_path, chunked):
    (tmp_path / "run").mkdir()
    path = tmp_path / "run" / "run_0.mcap"
    with path.open("wb") as file:
        writer = ForeignWriter(file, chunk_size=100, use_chunking=chunked, index_types=IndexType.NONE)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/x", "cdr", schema)
        for i in range(20):
            writer.add_message(channel, i, bytes(12), i)
    assert recover(tmp_path / "run").messages >= 10
    assert [stamp for _, stamp, _ in by_rosbags(tmp_path / "run")] == by_mcap_any(path)


def test_several_bags_are_sealed_at_once_and_by_their_files(unsealed, capsys):
    one, two = unsealed(name="one")[0], unsealed(name="two")[0]
    (file,) = two.glob("*.mcap")
    assert unsealed_bags(one.parent) == [one, two]
    assert executable.main([str(one), str(file)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == f"{one}: sealed, 60 messages, the last of 2025-11-21 04:40:00.295 UTC; no bytes lost"
    assert told[1].startswith(f"{two}: sealed, 60 messages")
    assert unsealed_bags(one.parent) == []
