"""Each recording gets a new folder: none is written to twice, and none is made in vain."""

import contextlib
from datetime import datetime
from itertools import islice
from pathlib import Path
from threading import Barrier, Thread

import pytest
from recorded_bag import METADATA, POWER

from vibro_ros.bag.folders import bag_folders
from vibro_ros.bag.recorder import Recorder, Topic


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
