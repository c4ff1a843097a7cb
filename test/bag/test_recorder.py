"""The recorder: complete and byte-identical bags, counted drops, faults that never reach the caller."""

import contextlib
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import threading
import time
from datetime import datetime
from itertools import islice
from pathlib import Path
from threading import Barrier, Thread

import pytest
from mcap.reader import make_reader
from rosbags.interfaces import QosReliability
from rosbags.rosbag2 import Reader

import vibro_ros.bag.recorder as recorder_module
from vibro_ros.bag.recorder import FLUSH_PERIOD, LAST_STAMP, Recorder, Topic, bag_folders
from vibro_ros.bag.stream import BagStream
from vibro_ros.bag.writer import BagWriter, Storage

TOPICS = (
    Topic("/odom", "nav_msgs/msg/Odometry", 10),
    Topic("/joint_states", "sensor_msgs/msg/JointState", 10),
    Topic("/impacts", "geometry_msgs/msg/WrenchStamped", 1000),
    Topic("/motor_power", "std_msgs/msg/Float64", 10),
)
POWER = TOPICS[3:]
ROOT = str(Path(recorder_module.__file__).parents[2])
DEADLINE = 30.0  # s
METADATA = {"scene": "device", "parameters": "guide.angle: 0.87", "version": "0.1", "start": "2026-11-21T10:00:00"}


@pytest.fixture
def folder(tmp_path) -> Path:
    return tmp_path / "run"


def mcap_file(folder: Path) -> Path:
    return folder / f"{folder.name}_0.mcap"


@pytest.fixture
def sent(published, start_ns) -> list[tuple[str, int, bytes]]:
    """400 messages of every topic in turn, in the order of their stamps."""
    return [(topic, start_ns + i * 1_000_000 + k, message(i))
            for i in range(400) for k, (topic, message) in enumerate(published.items())]


@pytest.fixture
def sealed(folder, sent) -> Path:
    with Recorder(folder, TOPICS, METADATA) as recorder:
        assert all([recorder.write(*message) for message in sent])
    assert (recorder.written, recorder.dropped, recorder.fault) == (len(sent), 0, None)
    return folder


def test_rosbags_reads_every_message_byte_for_byte_in_order(sealed, sent):
    with Reader(sealed) as reader:
        assert [(one.topic, stamp, bytes(data)) for one, stamp, data in reader.messages()] == sent


def test_mcap_reads_every_message_byte_for_byte_in_order(sealed, sent, recorded):
    with mcap_file(sealed).open("rb") as file:
        indexed = [(channel.topic, message.log_time, message.data)
                   for _, channel, message in make_reader(file, validate_crcs=True).iter_messages()]
    assert indexed == sent
    assert recorded(mcap_file(sealed)) == sent


def test_bag_keeps_types_qos_and_what_the_recorder_says_of_itself(sealed):
    with Reader(sealed) as reader:
        offered = {one.topic: (one.msgtype, one.ext.offered_qos_profiles[0]) for one in reader.connections}
        assert {topic: (kind, qos.depth) for topic, (kind, qos) in offered.items()} == {
            topic.name: (topic.type_name, topic.qos_depth) for topic in TOPICS}
        assert {qos.reliability for _, qos in offered.values()} == {QosReliability.RELIABLE}
        assert reader.storage.metadata.custom == METADATA | {"written": "1600", "dropped": "0", "lost": "0"}


def test_topics_are_on_the_disk_right_after_opening(folder):
    with Recorder(folder, TOPICS, METADATA):
        assert b"/joint_states" in mcap_file(folder).read_bytes()


def test_last_message_before_a_silence_reaches_the_disk(folder, published, start_ns, recorded, wait_for):
    message = ("/motor_power", start_ns, published["/motor_power"](1))
    with Recorder(folder, POWER, METADATA) as recorder:
        recorder.write(*message)
        wait_for(lambda: recorder.written == 1)
        assert recorded(mcap_file(folder)) == [message]


def test_flush_period_is_what_the_design_allows():
    assert FLUSH_PERIOD <= 0.1


ENDLESS = """
import sys, time
from pathlib import Path
from vibro_ros.bag.recorder import Recorder, Topic
recorder = Recorder(Path(sys.argv[1]), [Topic("/motor_power", "std_msgs/msg/Float64", 10)], {})
while True:
    stamp = time.monotonic_ns()
    assert recorder.write("/motor_power", stamp, bytes.fromhex("00010000") + stamp.to_bytes(8, "little"))
    print(stamp, flush=True)
    time.sleep(0.001)
"""


def test_killed_recorder_loses_the_last_moments_only(folder, recorded):
    child = subprocess.Popen([sys.executable, "-c", ENDLESS, str(folder)], stdout=subprocess.PIPE, text=True,
                             env=os.environ | {"PYTHONPATH": ROOT})
    try:
        written = [int(child.stdout.readline()) for _ in range(800)]
    finally:
        child.kill()
        rest, _ = child.communicate()
    # a line cut by the kill is no promise of the child's
    written += [int(line) for line in rest.splitlines(keepends=True) if line.endswith("\n")]
    found = [stamp for _, stamp, _ in recorded(mcap_file(folder))]
    assert found == written[:len(found)]
    # 0.15 s, plus the longest pause that a busy machine imposed on the child itself
    pause = max(later - earlier for earlier, later in zip(written, written[1:], strict=False))
    owed = [stamp for stamp in written if stamp < written[-1] - 150_000_000 - pause]
    assert len(owed) > 100
    assert found[:len(owed)] == owed


@pytest.mark.parametrize("stamp", [-1, 1.5, None, True, "1", LAST_STAMP + 1, 2**64])
def test_stamp_that_would_spoil_the_bag_is_refused_and_counted(folder, published, recorded, stamp):
    data = published["/motor_power"](1)
    with Recorder(folder, POWER, METADATA) as recorder:
        assert recorder.write("/motor_power", 7, data)
        assert not recorder.write("/motor_power", stamp, data)
        assert recorder.dropped == 1
    assert (recorder.written, recorder.fault) == (1, None)
    assert recorded(mcap_file(folder)) == [("/motor_power", 7, data)]


@pytest.mark.parametrize("stamp", [0, LAST_STAMP])
def test_extreme_stamps_are_recorded(folder, published, stamp):
    with Recorder(folder, POWER, METADATA) as recorder:
        assert recorder.write("/motor_power", stamp, published["/motor_power"](1))
    with Reader(folder) as reader:
        assert [time for _, time, _ in reader.messages()] == [stamp]


def test_unknown_topic_and_data_that_is_not_bytes_are_refused_and_counted(folder, published):
    with Recorder(folder, POWER, METADATA) as recorder:
        assert not recorder.write("/odom", 1, published["/odom"](1))
        assert not recorder.write("/motor_power", 1, "text")
    assert (recorder.written, recorder.dropped, recorder.fault) == (0, 2, None)


def test_full_queue_drops_and_counts(folder, published, wait_for, monkeypatch, recorded):
    gate, write = threading.Event(), BagWriter.write
    monkeypatch.setattr(BagWriter, "write", lambda *message: gate.wait(30.0) and write(*message))
    data = published["/motor_power"](1)
    with Recorder(folder, POWER, METADATA, backlog=3) as recorder, contextlib.ExitStack() as before_close:
        before_close.callback(gate.set)
        assert recorder.write("/motor_power", 0, data)
        wait_for(lambda: recorder.backlog == 0)  # the thread has taken it, and stalls
        assert [recorder.write("/motor_power", stamp, data) for stamp in range(1, 9)] == [True] * 3 + [False] * 5
        assert recorder.dropped == 5
    assert (recorder.written, recorder.dropped, recorder.fault) == (4, 5, None)
    assert [stamp for _, stamp, _ in recorded(mcap_file(folder))] == [0, 1, 2, 3]


@contextlib.contextmanager
def no_file_larger_than(size: int):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_disk_that_fills_up_stops_the_recording_not_the_caller(folder, published, kind):
    data = published["/odom"](1)
    calls, deadline = 0, time.monotonic() + DEADLINE
    with no_file_larger_than(400_000), Recorder(folder, TOPICS, METADATA, storage=Storage(kind)) as recorder:
        while recorder.fault is None:
            recorder.write("/odom", calls, data)
            calls += 1
            time.sleep(1e-4)  # [s] the writer thread gets its turn
            assert time.monotonic() < deadline
        assert not recorder.write("/odom", calls, data)
    assert recorder.fault.startswith(f"recording to {folder} stopped: ")
    assert {"mcap": "File too large", "sqlite3": "disk"}[kind] in recorder.fault
    assert "\n" not in recorder.fault
    assert recorder.written + recorder.dropped + recorder.lost == calls + 1
    assert min(recorder.written, recorder.dropped, recorder.lost) > 0


FULL_DISK = """
import json, subprocess, sys, time
from pathlib import Path
from rosbags.rosbag2 import Reader
from vibro_ros.bag.recorder import Recorder, Topic
from vibro_ros.bag.writer import Storage
disk = Path(sys.argv[1])
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)], check=True)
topics = [Topic("/odom", "nav_msgs/msg/Odometry", 10)]
with Recorder(disk / "run", topics, {}, storage=Storage(sys.argv[2])) as recorder:
    stamp = 0
    while recorder.fault is None:
        recorder.write("/odom", stamp, bytes(700))
        stamp += 1
        time.sleep(1e-4)
with Reader(disk / "run") as reader:
    read = [stamp for _, stamp, _ in reader.messages()]
    custom = dict(reader.storage.metadata.custom)
try:
    with (disk / "ballast").open("wb", buffering=0) as ballast:
        while ballast.write(bytes(4096)) == 4096:
            pass
except OSError:
    pass
try:
    Recorder(disk / "next", topics, {})
    again = "opened"
except OSError as error:
    again = str(error)
left = sorted(path.name for path in disk.iterdir())
for path in (disk / "run").iterdir():
    path.write_bytes(b"")  # to remove it would not do: rosbags keeps a database open
Recorder(disk / "next", topics, {}).close()
print(json.dumps({"fault": recorder.fault, "read": read == list(range(recorder.written)), "custom": custom,
                  "written": recorder.written, "lost": recorder.lost, "again": again,
                  "left": left}))
"""


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_a_bag_on_a_full_disk_is_sealed_with_all_that_was_written(tmp_path, kind):
    command = ["unshare", "--map-root-user", "--mount", sys.executable, "-c", FULL_DISK, str(tmp_path), kind]
    if subprocess.run([*command[:3], "mount", "-t", "tmpfs", "tmpfs", str(tmp_path)], capture_output=True).returncode:
        pytest.skip("no disk of one's own can be mounted here")
    child = subprocess.run(command, env=os.environ | {"PYTHONPATH": ROOT}, capture_output=True, text=True, timeout=60)
    assert child.returncode == 0, child.stderr
    told = json.loads(child.stdout)
    assert {"mcap": "No space left on device", "sqlite3": "database or disk is full"}[kind] in told["fault"]
    assert told["fault"].endswith(f"the bag is sealed with its {told['written']} messages")
    assert told["read"]
    assert told["written"] > 700  # of 700 bytes each, on a disk of 1 MiB
    assert told["custom"] == {"written": str(told["written"]), "lost": str(told["lost"]),
                              "dropped": told["custom"]["dropped"]}
    assert told["again"].startswith("cannot record to") and "No space left" in told["again"]
    assert told["left"] == ["ballast", "run"]  # nothing of the attempt


def test_removed_folder_stops_the_recording_not_the_caller(folder, published, wait_for):
    with Recorder(folder, POWER, METADATA) as recorder:
        shutil.rmtree(folder)
        recorder.write("/motor_power", 1, published["/motor_power"](1))
        wait_for(lambda: recorder.fault is not None)
        assert not recorder.write("/motor_power", 2, published["/motor_power"](2))
    assert "No such file" in recorder.fault
    assert (recorder.written, recorder.dropped, recorder.lost) == (0, 1, 1)
    assert "the folder is gone" in recorder.fault


def test_close_is_idempotent_ends_the_thread_and_ends_writing(folder, published):
    before = threading.active_count()
    recorder = Recorder(folder, POWER, METADATA)
    recorder.write("/motor_power", 1, published["/motor_power"](1))
    recorder.close()
    sealed = mcap_file(folder).read_bytes()
    recorder.close()
    assert not recorder.write("/motor_power", 2, published["/motor_power"](2))
    assert threading.active_count() == before
    assert (recorder.written, recorder.dropped, recorder.fault) == (1, 1, None)
    assert mcap_file(folder).read_bytes() == sealed


def test_close_writes_a_long_backlog_out(folder, published, recorded):
    data = published["/motor_power"](1)
    with Recorder(folder, POWER, METADATA) as recorder:  # takes longer to write than FLUSH_PERIOD
        accepted = sum(recorder.write("/motor_power", stamp, data) for stamp in range(20_000))
    assert (recorder.written, recorder.dropped, recorder.fault) == (accepted, 20_000 - accepted, None)
    assert len(recorded(mcap_file(folder))) == accepted == 20_000


def test_bag_is_sealed_when_the_caller_fails(folder, published):
    with pytest.raises(ZeroDivisionError), Recorder(folder, POWER, METADATA) as recorder:
        recorder.write("/motor_power", 1, published["/motor_power"](1))
        raise ZeroDivisionError
    with Reader(folder) as reader:
        assert reader.message_count == 1


def test_writers_in_several_threads_lose_nothing(folder, published, recorded):
    data = published["/motor_power"](1)
    with Recorder(folder, POWER, METADATA) as recorder:
        threads = [threading.Thread(target=lambda k=k: [recorder.write("/motor_power", 1000 * k + i, data)
                                                        for i in range(1000)]) for k in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert recorder.written == 4000
    assert sorted(stamp for _, stamp, _ in recorded(mcap_file(folder))) == list(range(4000))


def test_existing_folder_is_never_written_to(folder):
    folder.mkdir()
    (folder / "precious").write_text("data")
    with pytest.raises(FileExistsError, match="exists already; a recording never overwrites"):
        Recorder(folder, POWER, METADATA)
    assert [path.name for path in folder.iterdir()] == ["precious"]


def test_folder_that_cannot_be_made_is_a_one_line_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"^cannot record to .*file/run: Not a directory; give a folder") as raised:
        Recorder(tmp_path / "file" / "run", POWER, METADATA)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("topics", "reason"), [
    ([Topic("/x", "no_such_msgs/msg/Thing", 10)], "/x: unknown message type 'no_such_msgs/msg/Thing'"),
    ([*POWER, *POWER], "/motor_power: given twice"),
])
def test_bad_topics_are_refused_before_anything_is_made(folder, topics, reason):
    with pytest.raises(ValueError, match=reason):
        Recorder(folder, topics, METADATA)
    assert not folder.exists()


def test_two_recordings_in_one_second_get_two_folders(tmp_path):
    now = datetime(2026, 11, 21, 10, 20, 30)
    first = "vibro_robot_2026_11_21-10_20_30"
    names = [folder.name for folder in islice(bag_folders(tmp_path, now), 3)]
    assert names == [first, f"{first}_2", f"{first}_3"]


def take(directory: Path, found: list[Path], together: Barrier) -> None:
    together.wait()
    for folder in bag_folders(directory, datetime(2026, 11, 21)):
        with contextlib.suppress(FileExistsError):
            Recorder(folder, POWER, METADATA).close()
            found.append(folder)
            return


def test_recorders_that_begin_at_the_same_instant_get_a_folder_each(tmp_path):
    found: list[Path] = []
    together = Barrier(8)
    threads = [Thread(target=take, args=(tmp_path, found, together)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(found)) == 8 == len(list(tmp_path.iterdir()))


def record_parts(folder: Path, published, wait_for, spoil, storage: Storage) -> Recorder:
    """Record half of 400 messages, spoil the folder, and record the rest."""
    recorder = Recorder(folder, POWER, METADATA, storage=storage)
    for i in range(400):
        if i == 200:
            wait_for(lambda: recorder.written == 200)
            spoil(folder)
        recorder.write("/motor_power", i * 1_000_000, published["/motor_power"](i))
    recorder.close()
    return recorder


def swap(path: Path) -> None:
    copy = path.with_suffix(".copy")
    shutil.copyfile(path, copy)
    copy.replace(path)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
@pytest.mark.parametrize("spoil", [Path.unlink, swap], ids=["removed", "replaced"])
def test_the_file_that_is_written_is_missed_when_it_is_gone(folder, published, wait_for, kind, spoil):
    ending = {"mcap": "mcap", "sqlite3": "db3"}[kind]
    recorder = record_parts(folder, published, wait_for, lambda folder: spoil(next(folder.glob(f"*.{ending}"))),
                            Storage(kind))
    assert recorder.fault.endswith("nothing of it is left")
    assert recorder.written == 0 and recorder.lost + recorder.dropped == 400
    (sentence,) = recorder.missing
    assert re.search(rf"_0.{ending}: removed or replaced by another program, [2-4]\d\d messages are lost$", sentence)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
@pytest.mark.parametrize("spoil", [Path.unlink, swap], ids=["removed", "replaced"])
def test_a_finished_file_that_is_gone_costs_its_messages_alone(folder, published, wait_for, kind, spoil):
    storage = Storage(kind, max_duration=0.1)
    ending = {"mcap": "mcap", "sqlite3": "db3"}[kind]
    recorder = record_parts(folder, published, wait_for, lambda folder: spoil(folder / f"{folder.name}_0.{ending}"),
                            storage)
    assert recorder.fault is None and recorder.sealed
    assert (recorder.written, recorder.lost, len(recorder.missing)) == (300, 100, 1)
    with BagStream(folder) as stream:
        assert [stamp for _, stamp, _ in stream.messages()] == [i * 1_000_000 for i in range(100, 400)]
        assert stream.metadata["written"] == "300" and stream.metadata["lost"] == "100"
