"""The recorder when it is killed, or its disk is full or its files are gone: the fault is reported and counted, and
never raises an error in the caller.
"""

import shutil
import time
from pathlib import Path

import pytest
from real_processes import wait_until
from recorded_bag import METADATA, POWER, TOPICS, by_rosbags, mcap_file, no_file_larger_than

from vibro_ros.bag.recorder import Recorder, Storage
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings.recover import recover

DEADLINE = 30.0  # s


def test_disk_that_fills_up_stops_the_recording_not_the_caller(folder, published):
    data = published["/odom"](1)
    calls, deadline = 0, time.monotonic() + DEADLINE
    with no_file_larger_than(400_000), Recorder(folder, TOPICS, METADATA) as recorder:
        while recorder.fault is None:
            recorder.write("/odom", calls, data)
            calls += 1
            time.sleep(1e-4)  # [s] the writer thread gets its turn
            assert time.monotonic() < deadline
        assert not recorder.write("/odom", calls, data)
    assert recorder.fault.startswith(f"recording to {folder} stopped: ")
    assert "File too large" in recorder.fault
    assert "\n" not in recorder.fault
    assert recorder.written + recorder.dropped + recorder.lost == calls + 1
    assert min(recorder.written, recorder.dropped, recorder.lost) > 0
    recover(folder)
    assert [stamp for _, stamp, _ in by_rosbags(folder)] == list(range(recorder.written))


def test_bag_is_sealed_when_the_caller_fails(folder, published):
    with pytest.raises(ZeroDivisionError), Recorder(folder, POWER, METADATA) as recorder:
        recorder.write("/motor_power", 1, published["/motor_power"](1))
        raise ZeroDivisionError
    assert len(by_rosbags(folder)) == 1


def record_parts(folder: Path, published, spoil, storage: Storage) -> Recorder:
    """Record half of 400 messages, damage the folder, and record the rest."""
    recorder = Recorder(folder, POWER, METADATA, storage=storage)
    for i in range(400):
        if i == 200:
            wait_until(lambda: recorder.written == 200, "the recorder")
            spoil(folder)
        recorder.write("/motor_power", i * 1_000_000, published["/motor_power"](i))
    recorder.close()
    return recorder


def swap(path: Path) -> None:
    copy = path.with_suffix(".copy")
    shutil.copyfile(path, copy)
    copy.replace(path)


GONE = "run_0.mcap was removed, or replaced by another file"


@pytest.mark.parametrize(("spoil", "storage", "written", "words"), [
    (lambda folder: mcap_file(folder).unlink(), Storage(), 0, GONE),
    (lambda folder: swap(mcap_file(folder)), Storage(), 0, GONE),
    (shutil.rmtree, Storage(), 0, "the folder is gone"),
    (lambda folder: (folder / "run_2.mcap").mkdir(), Storage(max_duration=0.1), 200,
     "stopped: File exists; its 200 messages"),
], ids=["removed", "replaced", "folder", "next file"])
def test_a_file_that_cannot_be_written_stops_the_recording_not_the_caller(folder, published, spoil, storage, written,
                                                                          words):
    recorder = record_parts(folder, published, spoil, storage)
    assert words in recorder.fault and "\n" not in recorder.fault
    assert recorder.written == written and recorder.lost + recorder.dropped == 400 - written


def test_a_deleted_file_costs_only_its_own_messages(folder, published):
    recorder = record_parts(folder, published, lambda folder: mcap_file(folder).unlink(),
                            Storage(max_duration=0.1))
    assert recorder.fault is None
    with BagStream(folder) as stream:
        assert stream.flaws == []
        assert [stamp for _, stamp, _ in stream.messages()] == [i * 1_000_000 for i in range(100, 400)]
