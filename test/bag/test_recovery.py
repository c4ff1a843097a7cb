"""`recover`: killed, torn and damaged bags are sealed, the part that is cut off is kept, a folder that is no bag is not
changed; and a recovery that is killed at any step can be repeated.
"""

import contextlib
import errno
import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mcap.records import Header
from mcap.writer import IndexType
from mcap.writer import Writer as ForeignWriter
from real_processes import wait_until
from recorded_bag import POWER, STORAGES, by_mcap, by_rosbags, content, mcap_file, no_file_larger_than, torn
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from vibro_ros.bag.folders import unsealed_bags
from vibro_ros.bag.mcap_file import MAGIC
from vibro_ros.bag.mcap_writer import record_bytes
from vibro_ros.bag.recorder import Recorder, Storage
from vibro_ros.bag.stream import BagError
from vibro_ros.recordings import recover as executable
from vibro_ros.recordings.recover import recover

KILLS = int(os.environ.get("VIBRO_ROS_KILLS", "3"))  # VIBRO_ROS_KILLS=100 for the long version
LONGEST_LOSS = 0.1  # [s] what the recorder promises

# Writes for ever and says what it has written, [ns] of the monotonic clock; its own pauses are the machine's.
ENDLESS = """
import sys, time
from pathlib import Path
from vibro_ros.bag.recorder import Recorder, Topic
from vibro_ros.bag.recorder import Storage
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


def kill_recorder(folder: Path, storage: Storage, rate: float, after: float) -> list[int]:
    """Record in a child process and kill it after so many seconds; returns the stamps that it has written."""
    words = [storage.compression, str(storage.max_size), str(rate)]
    child = subprocess.Popen([sys.executable, "-c", ENDLESS, str(folder), *words], stdout=subprocess.PIPE, text=True)
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
    written = kill_recorder(folder, storage, rate, after)
    with contextlib.suppress(BagError):
        recover(folder)
    assert (folder / "metadata.yaml").exists(), (after, sorted(folder.iterdir()))
    messages = by_rosbags(folder)
    assert by_mcap(folder) == messages
    power = [int.from_bytes(data[4:], "little") for topic, _, data in messages if topic == "/motor_power"]
    odom = [stamp for topic, stamp, _ in messages if topic == "/odom"]
    assert power == [stamp for topic, stamp, _ in messages if topic == "/motor_power"]
    assert len(odom) - len(power) in (0, 1)
    # the last may be there although the child could not say so any more
    assert power[:len(written)] == written[:len(power)]
    assert len(power) <= len(written) + 1
    # what the machine itself held up is no loss of the recorder's
    pause = max((later - earlier for earlier, later in zip(written, written[1:], strict=False)), default=0)
    owed = [stamp for stamp in written if stamp < written[-1] - LONGEST_LOSS * 1e9 - max(0, pause - 1e9 / rate)]
    assert len(power) >= len(owed), f"killed after {after} s: {len(owed) - len(power)} messages too few"


@pytest.mark.parametrize("storage", STORAGES.values(), ids=STORAGES)
def test_all_flushed_messages_and_the_custom_data_survive(unsealed, storage):
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


@pytest.mark.parametrize("spoil", [
    lambda text: None, lambda text: "", lambda text: text[:100],
    lambda text: text.replace("- run_0.mcap", "- ../../etc/passwd"),
    lambda text: text.replace("version: 9", "version: 99")], ids=["missing", "empty", "cut", "other name", "later"])
def test_lost_or_incomplete_metadata_are_written_again(tmp_path, published, spoil):
    folder = tmp_path / "run"
    with Recorder(folder, POWER, {}, storage=Storage(max_duration=0.1)) as recorder:
        for i in range(300):
            recorder.write("/motor_power", i * 1_000_000, published["/motor_power"](i))
    messages, files = by_rosbags(folder), {path: path.read_bytes() for path in folder.glob("*.mcap")}
    good = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").unlink()
    if (text := spoil(good)) is not None:
        assert text != good
        (folder / "metadata.yaml").write_text(text)
    assert [recover(folder).was_sealed for _ in range(2)] == [False, True]
    assert by_rosbags(folder) == messages
    assert {path: path.read_bytes() for path in folder.glob("*.mcap")} == files


def test_a_bag_that_another_recorder_left_is_sealed(tmp_path, published, recorded):
    """rosbags stores schemas and channels inside of chunks."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(tmp_path / "run", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.open()
    topic = writer.add_connection("/motor_power", "std_msgs/msg/Float64", typestore=store)
    for i in range(40_000):  # a chunk of 1 MiB, and another that is lost
        writer.write(topic, i, published["/motor_power"](1))
    with pytest.raises(BagError, match=f"in use, process {os.getpid()} writes to it"):
        recover(tmp_path / "run")
    writer.abort()
    done = recover(tmp_path / "run")
    assert 20_000 < done.messages < 40_000
    assert [stamp for _, stamp, _ in by_rosbags(tmp_path / "run")] == list(range(done.messages))
    assert len(recorded(tmp_path / "run" / "run.mcap")) == done.messages


@pytest.mark.parametrize("chunked", [True, False])
def test_a_file_without_indexes_is_sealed(tmp_path, recorded, chunked):
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
    assert by_rosbags(tmp_path / "run") == recorded(path)


def test_several_bags_are_sealed_at_once_and_by_their_files(unsealed, capsys):
    first, second = unsealed(name="one")[0], unsealed(name="two")[0]
    (file,) = second.glob("*.mcap")
    assert unsealed_bags(first.parent) == [first, second]
    assert executable.main([str(first), str(file)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == f"{first}: sealed, 60 messages, the last of 2025-11-21 04:40:00.295 UTC; no bytes lost"
    assert told[1].startswith(f"{second}: sealed, 60 messages")
    assert unsealed_bags(first.parent) == []


@pytest.mark.parametrize("tail", [b"\6", b"\0" * 5000, b"\6" + (2**63).to_bytes(8, "little"), -1, -100, -1400])
def test_a_torn_file_is_kept_beside_its_sealed_copy(unsealed, capsys, tail):
    """The file has other bytes at its end, or ends within a message index or within a chunk."""
    folder, sent = unsealed()  # two chunks
    path = mcap_file(folder)
    torn_file = path.read_bytes() + tail if isinstance(tail, bytes) else path.read_bytes()[:tail]
    for name in ("run_0.mcap.torn", "run_0.mcap.torn.2"):
        (folder / "metadata.yaml").unlink(missing_ok=True)
        path.write_bytes(torn_file)
        assert executable.main([str(folder)]) == 0
        assert f" torn bytes cut, kept in {name}\n" in capsys.readouterr().out
        assert torn(folder)[name] == torn_file
    messages = by_rosbags(folder)
    assert messages == by_mcap(folder) == sent[:len(messages)]
    assert len(messages) == (31 if tail == -1400 else 60)  # a chunk is whole, or gone
    assert recover(folder).was_sealed


@pytest.mark.parametrize("error", [MemoryError(), OSError(errno.EMFILE, "Too many open files"), KeyboardInterrupt()])
@pytest.mark.parametrize("where", ["bag.mcap_file.unfolded", "bag.mcap_file.McapFile.copy_sealed"])
def test_an_error_during_recovery_damages_nothing(unsealed, monkeypatch, error, where):
    """Nothing is cut off the file if memory, the disk or the user's patience runs out during the recovery."""
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    with path.open("ab") as file:
        file.write(b"torn")
    content_before = content(folder)

    def fail(*_):
        raise error
    with monkeypatch.context() as patch:
        patch.setattr(f"vibro_ros.{where}", fail)
        with pytest.raises(KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else BagError):
            recover(folder)
    assert content(folder) == content_before
    recover(folder)
    assert by_rosbags(folder) == sent


def flip(folder: Path) -> None:
    (path,) = folder.glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[data.index((30).to_bytes(2, "little") * 6)] ^= 1
    path.write_bytes(data)


def test_a_sealed_file_that_is_damaged_is_left_as_it_is_and_read_without_the_damage(tmp_path, capsys):
    folder = tmp_path / "run"
    with Recorder(folder, POWER, {}) as recorder:
        for i in range(40):
            recorder.write("/motor_power", i, i.to_bytes(2, "little") * 6)
            wait_until(lambda i=i: i != 19 or recorder.written == 20, "the recorder")
    flip(folder)
    content_before = content(folder)
    assert executable.main([str(folder)]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.endswith("sealed already, 20 messages; nothing to do")
    assert "damaged bytes are not read: a chunk has another checksum than it says at byte" in second
    assert content(folder) == content_before


def test_an_unreadable_bag_is_left_as_it_is(tmp_path, published):
    folder = tmp_path / "run"
    with Recorder(folder, POWER, {}) as recorder:
        recorder.write("/motor_power", 1, (30).to_bytes(2, "little") * 6)
    flip(folder)
    content_before = content(folder)
    with pytest.raises(BagError, match="nothing in it can be read: run_0.mcap: .* another checksum than it says"):
        recover(folder)
    assert content(folder) == content_before


def test_a_recovery_on_a_full_disk_leaves_the_bag_as_it_was(unsealed):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    data_before = path.read_bytes()
    with no_file_larger_than(len(data_before) // 2), pytest.raises(
            BagError, match="cannot be sealed: File too large; nothing readable was lost"):
        recover(folder)
    assert path.read_bytes() == data_before
    recover(folder)
    assert by_rosbags(folder) == sent


def test_an_empty_last_file_is_left_out(unsealed):
    folder, sent = unsealed()
    (folder / "run_1.mcap").write_bytes(b"")
    assert recover(folder).messages == 60
    assert by_rosbags(folder) == sent
    assert recover(folder).was_sealed


def test_unreadable_folders_and_links_are_skipped(unsealed, tmp_path, monkeypatch):
    folder, _ = unsealed()
    for name in ("of another", "new\nline", os.fsdecode(b"\xff\xfe"), "empty"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "x_0.mcap").write_bytes(b"" if name == "empty" else b"data")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "gone").symlink_to("nowhere")
    (tmp_path / "elsewhere").symlink_to(folder)
    scandir = os.scandir

    def refuse(path):
        if Path(path).name == "of another":
            raise PermissionError(errno.EACCES, "Permission denied")
        return scandir(path)
    monkeypatch.setattr(os, "scandir", refuse)
    names = {path.name for path in unsealed_bags(tmp_path)}
    assert names == {"run", "new\nline", os.fsdecode(b"\xff\xfe")}
    assert unsealed_bags(tmp_path / "of another") == []


def test_a_bag_that_is_sealed_during_the_search_is_not_listed_as_unsealed(tmp_path, published, monkeypatch):
    """When several robots started at once in one folder, one of them reported that the robot of another's bag had been
    killed.
    """
    recorder = Recorder(tmp_path / "run", POWER, {})
    recorder.write("/motor_power", 1, published["/motor_power"](1))
    monkeypatch.setattr("vibro_ros.bag.folders.writing_processes", lambda _: recorder.close() and {})
    assert unsealed_bags(tmp_path) == []


def test_a_bag_in_use_is_left_alone(tmp_path, published):
    with Recorder(tmp_path / "run", POWER, {}) as recorder:
        recorder.write("/motor_power", 1, published["/motor_power"](1))
        wait_until(lambda: recorder.written == 1, "the recorder")
        content_before = content(tmp_path / "run")
        with pytest.raises(BagError, match="the bag is in use, its recorder still runs; end the recorder"):
            recover(tmp_path / "run")
        assert unsealed_bags(tmp_path) == []
        assert content(tmp_path / "run") == content_before


@pytest.mark.parametrize("name, data, reason", [
    ("run_0.mcap", b"", "run_0.mcap: the file is empty, nothing was recorded"),
    ("run_0.mcap", b"not a recording at all", "run_0.mcap: not an MCAP file"),
    ("run_0.mcap", MAGIC + record_bytes(Header("ros1", "test")) + bytes(10),
     "run_0.mcap: an MCAP file, but not of ROS 2: its profile is 'ros1'"),
    ("run_0.mcap", MAGIC + b"\x01\x10", "run_0.mcap: the file ends within its header, nothing was recorded"),
    ("run_0.db3", b"SQLite format 3", "run_0.db3: is of the storage sqlite3; `ros2 bag convert` makes an MCAP bag"),
    ("notes.txt", b"text", "not a bag, it holds no .mcap file"),
], ids=["empty", "foreign", "ros1", "header", "database", "notes"])
def test_a_path_that_is_no_bag_is_refused_in_one_line_and_untouched(tmp_path, capsys, name, data, reason):
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / name).write_bytes(data)
    assert executable.main([str(folder)]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert said.err.startswith("recover: ") and reason in said.err
    assert content(folder) == {name: data}


def test_a_missing_folder_and_a_foreign_file_are_refused(tmp_path, capsys):
    with (tmp_path / "notes.txt").open("w"):  # of such a folder as /tmp it was said that a bag is in use
        assert executable.main([str(tmp_path / "none"), str(tmp_path / "notes.txt"), str(tmp_path)]) == 2
    first, second, third = capsys.readouterr().err.splitlines()
    assert third.endswith("not a bag, it holds no .mcap file; give the folder of a recording")
    assert first.endswith("none: no such folder; give the folder of a recording")
    assert second.endswith("notes.txt: a file, not a bag; give the folder of a recording")


CALLS = ("write", "ftruncate", "posix_fallocate", "fsync", "unlink", "rename", "replace", "link", "rmdir", "mkdir")


def counted(call: Callable, number: Iterator[int], last: int) -> Callable:
    """Return a call that kills the process when it is the call number `last`."""
    def count(*words, **more):
        return os.kill(os.getpid(), signal.SIGKILL) if next(number) == last else call(*words, **more)
    return count


def killed_before(folder: Path, step: int) -> bool:
    """Recover a bag in a fork that is killed before its call number `step` that changes a file; return whether it had
    fewer such calls."""
    if pid := os.fork():
        return os.waitpid(pid, 0)[1] == 0
    try:
        number = itertools.count()
        for name in CALLS:
            setattr(os, name, counted(getattr(os, name), number, step))
        recover(folder)
        os._exit(0)
    finally:
        os._exit(1)  # it must not go on as its parent


def test_a_recovery_that_was_killed_at_any_step_can_be_repeated(tmp_path, unsealed):
    good, sent = unsealed(samples=3000, name="good")
    with mcap_file(good).open("ab") as file:  # half a chunk
        file.write(b"\6" + (5000).to_bytes(8, "little") + bytes(1000))
    for step in range(100):
        folder = tmp_path / "run"
        shutil.copytree(good, folder)
        done = killed_before(folder, step)
        recover(folder)
        assert by_rosbags(folder) == sent, f"killed before step {step}"
        shutil.rmtree(folder)
        if done:
            assert step > 3
            return
    pytest.fail("a recovery of more than a hundred steps")
