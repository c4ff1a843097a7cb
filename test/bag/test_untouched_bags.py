"""What `recover` leaves alone: sealed bags, bags in use, files behind links, folders of others, and what is no bag."""

import errno
import os
from pathlib import Path

import pytest
from mcap.writer import Writer as ForeignWriter
from recorded_bag import POWER, STORAGES, by_rosbags, content

from vibro_ros.bag.folders import unsealed_bags
from vibro_ros.bag.recorder import Recorder
from vibro_ros.bag.recovery import RecoveryError, recover
from vibro_ros.recordings import recover as executable


@pytest.mark.parametrize("name", ["run_0.mcap.torn", "metadata.yaml.tmp", "metadata.yaml", "run_1.mcap"])
def test_no_link_is_followed(unsealed, tmp_path, name):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    with path.open("ab") as file:
        file.write(b"torn")
    (tmp_path / "precious").write_bytes(b"precious")
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(tmp_path / "precious")
    recover(folder)
    assert (tmp_path / "precious").read_bytes() == b"precious"
    assert by_rosbags(folder) == sent


def test_a_file_with_another_name_elsewhere_is_not_changed(unsealed, tmp_path):
    folder, sent = unsealed()
    (path,) = folder.glob("*.mcap")
    os.link(path, tmp_path / "same")
    before = path.read_bytes()
    with pytest.raises(RecoveryError, match="has another name .a hard link.* give a copy"):
        recover(folder)
    assert path.read_bytes() == before
    (tmp_path / "same").unlink()
    recover(folder)
    assert by_rosbags(folder) == sent


def test_folders_that_are_not_ones_own_are_passed_over(unsealed, tmp_path, monkeypatch):
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
    found = {path.name for path in unsealed_bags(tmp_path)}
    assert found == {"run", "new\nline", os.fsdecode(b"\xff\xfe")}
    assert unsealed_bags(tmp_path / "of another") == []


@pytest.mark.parametrize("storage", STORAGES.values(), ids=STORAGES)
def test_a_sealed_bag_is_not_touched(tmp_path, published, storage, capsys):
    with Recorder(tmp_path / "run", POWER, {}, storage=storage) as recorder:
        recorder.write("/motor_power", 1, published["/motor_power"](1))
    before = content(tmp_path / "run")
    assert executable.main([str(tmp_path / "run")]) == 0
    assert "sealed already, 1 messages; nothing to do" in capsys.readouterr().out
    assert content(tmp_path / "run") == before


def test_a_bag_in_use_is_left_alone(tmp_path, published, wait_for):
    with Recorder(tmp_path / "run", POWER, {}) as recorder:
        recorder.write("/motor_power", 1, published["/motor_power"](1))
        wait_for(lambda: recorder.written == 1)
        before = content(tmp_path / "run")
        with pytest.raises(RecoveryError, match="the bag is in use, its recorder still runs; end the recorder"):
            recover(tmp_path / "run")
        assert unsealed_bags(tmp_path) == []
        assert content(tmp_path / "run") == before


def empty(folder: Path) -> None:
    (folder / "run_0.mcap").write_bytes(b"")


def foreign(folder: Path) -> None:
    (folder / "run_0.mcap").write_bytes(b"not a recording at all")


def of_another_robot(folder: Path) -> None:
    with (folder / "run_0.mcap").open("wb") as file:
        ForeignWriter(file).start("ros1", "test")
        file.write(bytes(10))


def header_only(folder: Path) -> None:
    (folder / "run_0.mcap").write_bytes(b"\x89MCAP0\r\n\x01\x10")


def database(folder: Path) -> None:
    (folder / "run_0.db3").write_bytes(b"SQLite format 3")


def notes(folder: Path) -> None:
    (folder / "notes.txt").write_text("text")


@pytest.mark.parametrize("make, reason", [
    (empty, "run_0.mcap is empty (0 bytes), nothing was recorded"), (foreign, "run_0.mcap: not an MCAP file"),
    (of_another_robot, "run_0.mcap: an MCAP file, but not of ROS 2: its profile is 'ros1'"),
    (header_only, "run_0.mcap: the file ends within its header, nothing was recorded"),
    (database, "run_0.db3: is of the storage sqlite3; `ros2 bag convert` makes an MCAP bag of it"),
    (notes, "not a bag, it holds no .mcap file"),
], ids=lambda value: getattr(value, "__name__", ""))
def test_what_is_no_bag_is_one_line_and_untouched(tmp_path, capsys, make, reason):
    folder = tmp_path / "run"
    folder.mkdir()
    make(folder)
    before = content(folder)
    assert executable.main([str(folder)]) == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert told.err.startswith("recover: ") and reason in told.err
    assert content(folder) == before


def test_a_missing_folder_and_a_foreign_file_are_refused(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("text")
    assert executable.main([str(tmp_path / "none"), str(tmp_path / "notes.txt")]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first.endswith("none: no such folder; give the folder of a recording")
    assert second.endswith("notes.txt: a file, not a bag; give the folder of a recording")
