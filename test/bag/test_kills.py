"""kill -9 at any step of a recovery: what was flushed is never lost, and recovery can be repeated."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from robot_bag import START

from vibro_ros.bag.metadata import Topic, defined
from vibro_ros.bag.recovery import recover
from vibro_ros.bag.stream import BagStream
from vibro_ros.bag.writer import BagWriter, Storage

ROOT = str(Path(__file__).parents[2])
MESSAGES = 3000


@pytest.fixture(scope="module")
def recovering():
    """A process that recovers bags in processes of its own."""
    child = subprocess.Popen([sys.executable, str(Path(__file__).with_name("recovering.py"))], text=True,
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": ROOT})
    yield child
    child.stdin.close()
    assert child.wait(60) == 0
    child.stdout.close()


def say(child: subprocess.Popen, line: object) -> None:
    child.stdin.write(f"{line}\n")
    child.stdin.flush()


def killed_bag(folder: Path) -> int:
    """A bag that was never sealed, with half a chunk at its end; the number of messages that were flushed."""
    writer = BagWriter(folder, defined([Topic("/x", "std_msgs/msg/Float64", 10)]), {"scene": "device"}, Storage())
    for i in range(MESSAGES):
        writer.write(1, START + i, b"\0\1\0\0" + i.to_bytes(8, "little"))
        if i % 1000 == 999:
            writer.flush()
    writer.abandon()
    with (folder / f"{folder.name}_0.mcap").open("ab") as file:
        file.write(b"\6" + (5000).to_bytes(8, "little") + bytes(1000))
    return MESSAGES


def stamps(folder: Path) -> list[int]:
    with BagStream(folder) as stream:
        assert stream.flaws == []
        return [stamp for _, stamp, _ in stream.messages()]


def killed_at_step(child: subprocess.Popen, folder: Path, calls: int) -> bool:
    """Let so many calls of a recovery happen, then kill it; whether it was done before."""
    say(child, folder)
    for call in range(calls + 1):
        if child.stdout.readline() == "done\n":
            assert int(child.stdout.readline()) == 0
            return True
        say(child, "stop" if call == calls else "")
    assert int(child.stdout.readline()) == signal.SIGKILL
    return False


def test_a_recovery_killed_before_any_of_its_steps_can_be_repeated(tmp_path, recovering):
    written = killed_bag(tmp_path / "good")
    for calls in range(100):
        folder = tmp_path / "run"
        shutil.copytree(tmp_path / "good", folder)
        done = killed_at_step(recovering, folder, calls)
        recover(folder)
        assert stamps(folder) == [START + i for i in range(written)], f"killed before step {calls}"
        shutil.rmtree(folder)
        if done:
            return
    pytest.fail("a recovery of more than a hundred steps")
