"""The recorder when it is killed, its disk is full or its files are gone: told, counted, never the caller's fault."""

import contextlib
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from recorded_bag import METADATA, POWER, TOPICS, mcap_file
from rosbags.rosbag2 import Reader

import vibro_ros.bag.recorder as recorder_module
from vibro_ros.bag.recorder import Recorder
from vibro_ros.bag.stream import BagStream
from vibro_ros.bag.writer import Storage

ROOT = str(Path(recorder_module.__file__).parents[2])
DEADLINE = 30.0  # s

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


def test_bag_is_sealed_when_the_caller_fails(folder, published):
    with pytest.raises(ZeroDivisionError), Recorder(folder, POWER, METADATA) as recorder:
        recorder.write("/motor_power", 1, published["/motor_power"](1))
        raise ZeroDivisionError
    with Reader(folder) as reader:
        assert reader.message_count == 1


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
