"""Hostile bags, through every reader: no reader dies, hangs, follows a link or loses a byte that is readable."""

import os
import shutil
import stat
import time
import traceback
from hashlib import sha256
from pathlib import Path

import pytest
from hostile_bags import OF_MCAP, OF_METADATA
from matplotlib.figure import Figure
from robot_bag import robot_bag

from vibro_ros.bag.reader import BagError, load_bag
from vibro_ros.bag.recorder import Storage
from vibro_ros.recordings import recover, replay, report

INPUTS = {tick: {"motor_speed": 60.0 + tick} for tick in range(10, 120, 20)}
STORAGES = {"mcap": Storage(), "zstd": Storage("zstd")}
CASES = [("mcap", name, make) for name, make in (OF_MCAP | OF_METADATA).items()]
CASES += [("zstd", name, OF_MCAP[name]) for name in ("flip 1", "noise", "killed, cut 21")]
SLOWEST = 10.0  # s of processor time of one reader for one bag


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A good bag of each storage."""
    folder = tmp_path_factory.mktemp("good")
    for name, storage in STORAGES.items():
        robot_bag(folder / name / "run", "device", 120, INPUTS, 50.0, storage=storage)
    return folder


@pytest.fixture
def run(monkeypatch, capsys):
    """Fixture: a function that runs the `main` of a reader; returns its exit code and its lines on stdout."""
    monkeypatch.setattr(report, "plot_run", lambda *_: Figure())  # pictures take longer than all the rest

    def call(main, *words: str) -> tuple[int, str]:
        began = time.process_time()
        try:
            code = main(words)
        except BaseException:
            pytest.fail(f"{main.__module__}: {traceback.format_exc()}")
        output = capsys.readouterr()
        assert code in (0, 1, 2) and time.process_time() - began < SLOWEST, f"{main.__module__}: {code}"
        assert "Traceback" not in output.err and (code != 2 or output.err.count("\n") == 1), output.err
        return code, output.out
    return call


def readable(folder: Path) -> int:
    """Return the number of messages that `read_bag` finds; -1 if it refuses the bag in one line."""
    try:
        return sum(topic.messages for topic in load_bag(folder).topics.values())
    except BagError as error:
        assert "\n" not in str(error)
        return -1


def tree(folder: Path) -> dict[str, str]:
    """Return the contents of a folder: by path the digest of a file, or the kind of an entry."""
    contents = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        contents[str(path.relative_to(folder))] = (
            sha256(path.read_bytes()).hexdigest() if stat.S_ISREG(mode)
            else os.readlink(path) if stat.S_ISLNK(mode) else oct(mode))
    return contents


@pytest.mark.parametrize("storage, name, make", CASES, ids=[f"{storage} {name}" for storage, name, _ in CASES])
def test_a_hostile_bag_is_read_or_refused(tmp_path, bags, run, storage, name, make):
    shutil.copytree(bags / storage, tmp_path, dirs_exist_ok=True)
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "precious").write_bytes(b"precious" * 1000)
    make(tmp_path / "run")
    tree_before, folder = tree(tmp_path), tmp_path / "run"
    run(replay.main, str(folder))
    run(report.main, str(folder), "--output", str(tmp_path / "report"))
    shutil.rmtree(tmp_path / "report", ignore_errors=True)
    messages = readable(folder)
    assert tree(tmp_path) == tree_before, "a reader wrote"
    originals = [path.read_bytes() for path in folder.iterdir()
                 if path.suffix == ".mcap" and path.is_file() and not path.is_symlink()]
    code, _ = run(recover.main, str(folder))
    again, output = run(recover.main, str(folder))
    assert code == again and (code or "sealed already" in output)
    assert not (code and name.startswith("link as ")), "a link kept a recording from being sealed"
    run(replay.main, str(folder))
    outside = {path: digest for path, digest in tree(tmp_path).items() if path.startswith("outside")}
    assert outside == {path: digest for path, digest in tree_before.items() if path.startswith("outside")}
    assert readable(folder) >= (messages if code else max(messages, 0))
    files = [path.read_bytes() for path in folder.iterdir() if path.is_file() and not path.is_symlink()]
    for data in originals:  # cut bytes are kept beside the file
        common = max(_common(data, file) for file in files)
        assert common == len(data) or any(file.startswith(data[common:]) or data[:common + len(file)].endswith(file)
                                          and common + len(file) >= len(data) for file in files) or any(
            data.endswith(file) and _common(data, other) >= len(data) - len(file) for file in files for other in files)


def _common(data: bytes, other: bytes) -> int:
    """Return the number of equal bytes at the beginning."""
    return len(os.path.commonprefix([data, other]))
