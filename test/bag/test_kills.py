"""kill -9 at any instant of sealing and of recovery: what was flushed is never lost, and recovery can be repeated."""

import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from simulated_bag import START

from vibro_ros.bag.definitions import Topic, defined
from vibro_ros.bag.recovery import recover
from vibro_ros.bag.stream import BagStream
from vibro_ros.bag.writer import BagWriter, Storage

ROOT = str(Path(__file__).parents[2])
KILLS = int(os.environ.get("VIBRO_ROS_KILLS", "12"))  # VIBRO_ROS_KILLS=60 for the long version
MESSAGES = 3000

# Stops before every call that changes a file, says so, and goes on when it is told to: so it is killed at each of them.
STEPPED = """
import os, sys
from pathlib import Path
from vibro_ros.bag.recovery import recover
def stepped(call):
    def wait(*arguments, **options):
        print(call.__name__, flush=True)
        sys.stdin.readline()
        return call(*arguments, **options)
    return wait
for name in ("write", "ftruncate", "posix_fallocate", "fsync", "unlink", "rename", "replace", "link", "rmdir", "mkdir"):
    setattr(os, name, stepped(getattr(os, name)))
recover(sys.argv[1])
print("done", flush=True)
"""


def killed_bag(folder: Path, kind: str) -> int:
    """A bag that was never sealed, with half a chunk at its end; the number of messages that were flushed."""
    writer = BagWriter(folder, defined([Topic("/x", "std_msgs/msg/Float64", 10)]), {"scene": "device"}, Storage(kind))
    for i in range(MESSAGES):
        writer.write(1, START + i, b"\0\1\0\0" + i.to_bytes(8, "little"))
        if i % 1000 == 999:
            writer.flush()
    if kind == "sqlite3":
        leave_journal(writer, folder)
    writer.abandon()
    if kind == "mcap":
        with (folder / f"{folder.name}_0.mcap").open("ab") as file:
            file.write(b"\6" + (5000).to_bytes(8, "little") + bytes(1000))
    return MESSAGES


def leave_journal(writer: BagWriter, folder: Path) -> None:
    """Copy the database amid a transaction, as a killed recorder leaves it."""
    for i in range(50_000):  # more than SQLite keeps in memory
        writer.write(1, START + MESSAGES + i, bytes(100))
    for path in list(folder.glob("*.db3*")):
        shutil.copyfile(path, path.with_name(f"{path.name}.copy"))
    writer.abandon()
    for path in list(folder.glob("*.copy")):
        path.replace(path.with_suffix(""))


def stamps(folder: Path) -> list[int]:
    with BagStream(folder) as stream:
        assert stream.flaws == []
        return [stamp for _, stamp, _ in stream.messages()]


def stepped(folder: Path) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, "-c", STEPPED, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                            text=True, env=os.environ | {"PYTHONPATH": ROOT})


def go(child: subprocess.Popen, calls: int) -> bool:
    """Let so many calls happen, then kill; whether it was done before."""
    try:
        for _ in range(calls):
            if child.stdout.readline() in ("done\n", ""):
                return True
            child.stdin.write("\n")
            child.stdin.flush()
        return child.stdout.readline() == "done\n"
    finally:
        child.kill()
        child.wait()
        child.stdin.close()
        child.stdout.close()


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_a_recovery_killed_before_any_of_its_steps_can_be_repeated(tmp_path, kind):
    written = killed_bag(tmp_path / "good", kind)
    for calls in range(100):
        folder = tmp_path / "run"
        shutil.copytree(tmp_path / "good", folder)
        done = go(stepped(folder), calls)
        recover(folder)
        # an unfinished transaction may have left more in a database that is sound
        assert stamps(folder)[:written] == [START + i for i in range(written)], f"killed before step {calls}"
        assert not [path.name for path in folder.iterdir() if path.name.startswith(".")]
        shutil.rmtree(folder)
        if done:
            return
    pytest.fail("a recovery of more than a hundred steps")


@pytest.mark.parametrize("attempt", range(KILLS))
def test_recoveries_killed_at_random_lose_nothing(tmp_path, attempt):
    folder = tmp_path / "run"
    written = killed_bag(folder, ("mcap", "sqlite3")[attempt % 2])
    chance = random.Random(attempt)
    for _ in range(3):
        child = subprocess.Popen([sys.executable, "-m", "vibro_ros.recordings.recover", str(folder)],
                                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                 env=os.environ | {"PYTHONPATH": ROOT})
        time.sleep(chance.uniform(0.2, 1.5))  # amid its imports, or its work: the machine decides
        child.kill()
        child.wait()
    recover(folder)
    assert stamps(folder)[:written] == [START + i for i in range(written)]
