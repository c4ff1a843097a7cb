"""Hostile bags, through every reader: no reader dies, hangs, follows a link or loses a byte that is readable."""

import json
import os
import shutil
import stat
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest
from hostile_bags import OF_MCAP, OF_METADATA
from robot_bag import robot_bag

from vibro_ros.bag.recorder import Storage

TOLD = {tick: {"motor_speed": 60.0 + tick} for tick in range(10, 120, 20)}
STORAGES = {"mcap": Storage(), "zstd": Storage("zstd")}
CASES = [("mcap", name, make) for name, make in (OF_MCAP | OF_METADATA).items()]
CASES += [("zstd", name, OF_MCAP[name]) for name in ("flip 1", "noise", "killed, cut 21")]
SLOWEST = 10.0  # s of processor time of one reader for one bag


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """A good bag of each storage."""
    folder = tmp_path_factory.mktemp("good")
    for name, storage in STORAGES.items():
        robot_bag(folder / name / "run", "device", 120, TOLD, 50.0, storage=storage)
    return folder


@pytest.fixture(scope="module")
def worker():
    """Start a process that reads the bags; if it dies, the next case fails."""
    child = subprocess.Popen([sys.executable, str(Path(__file__).with_name("hostile_worker.py"))], text=True,
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    yield child
    child.stdin.close()
    child.wait(60)


def ask(worker, line: str) -> dict:
    worker.stdin.write(f"{line}\n")
    worker.stdin.flush()
    answer = worker.stdout.readline()
    assert answer, f"the reader died with {worker.wait(10)}"
    return json.loads(answer)


def tree(folder: Path) -> dict[str, str]:
    """Return the contents of a folder: by path the digest of a file, or the kind of an entry."""
    found = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        found[str(path.relative_to(folder))] = (
            sha256(path.read_bytes()).hexdigest() if stat.S_ISREG(mode)
            else os.readlink(path) if stat.S_ISLNK(mode) else oct(mode))
    return found


def check(answer: dict, reader: str) -> None:
    """Check the answer of one reader: an exit code, and one line if the reader refuses the bag."""
    assert answer["code"] in (0, 1, 2), f"{reader}: {answer['code']}"
    assert answer["time"] < SLOWEST, f"{reader} took {answer['time']} s"
    assert "Traceback" not in answer["err"] and "record it again" not in answer["err"]
    if answer["code"] == 2:
        assert answer["err"].count("\n") == 1, f"{reader}: {answer['err']}"


@pytest.mark.parametrize("storage, name, make", CASES, ids=[f"{storage} {name}" for storage, name, _ in CASES])
def test_a_hostile_bag_is_read_or_refused(tmp_path, bags, worker, storage, name, make):
    shutil.copytree(bags / storage, tmp_path, dirs_exist_ok=True)
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "precious").write_bytes(b"precious" * 1000)
    make(tmp_path / "run")
    before = tree(tmp_path)
    first = ask(worker, str(tmp_path / "run"))
    for reader in ("replay", "read", "report"):
        check(first[reader], reader)
    assert tree(tmp_path) == before, "a reader wrote"
    originals = [path.read_bytes() for path in (tmp_path / "run").iterdir()
                 if path.suffix == ".mcap" and path.is_file() and not path.is_symlink()]
    second = ask(worker, "")
    for reader in ("recover", "again", "read", "replay"):
        check(second[reader], reader)
    outside = {path: digest for path, digest in tree(tmp_path).items() if path.startswith("outside")}
    assert outside == {path: digest for path, digest in before.items() if path.startswith("outside")}
    check_recovered(tmp_path / "run", first, second, originals)


def check_recovered(folder: Path, first: dict, second: dict, originals: list[bytes]) -> None:
    """Check a recovery: readable messages stay readable, cut bytes are kept beside the file, and the sealed bag is read
    and not changed again.
    """
    assert second["recover"]["code"] == second["again"]["code"]
    if first["read"]["code"] == 0:
        assert second["read"]["code"] == 0
        assert json.loads(second["read"]["out"])[0] >= json.loads(first["read"]["out"])[0]
    if second["recover"]["code"] == 0:
        assert second["read"]["code"] == 0, second["read"]["err"]
        assert "sealed already" in second["again"]["out"]
    files = [path.read_bytes() for path in folder.iterdir() if path.is_file() and not path.is_symlink()]
    for data in originals:
        kept = max(_common(data, one) for one in files)
        assert kept == len(data) or any(one.startswith(data[kept:]) or data[:kept + len(one)].endswith(one)
                                        and kept + len(one) >= len(data) for one in files) or any(
            data.endswith(one) and _common(data, other) >= len(data) - len(one) for one in files for other in files)


def _common(one: bytes, other: bytes) -> int:
    """Return the number of equal bytes at the beginning."""
    return len(os.path.commonprefix([one, other]))
