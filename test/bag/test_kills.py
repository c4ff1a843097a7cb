"""kill -9 at any step of a recovery: flushed messages are never lost, and the recovery can be repeated."""

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from recorded_bag import by_rosbags, mcap_file

from vibro_ros.recordings.recover import recover


@pytest.fixture(scope="module")
def recovering():
    """A process that recovers bags in processes of its own."""
    child = subprocess.Popen([sys.executable, str(Path(__file__).with_name("recovering.py"))], text=True,
                             stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    yield child
    child.stdin.close()
    assert child.wait(60) == 0
    child.stdout.close()


def say(child: subprocess.Popen, line: object) -> None:
    child.stdin.write(f"{line}\n")
    child.stdin.flush()


def killed_at_step(child: subprocess.Popen, folder: Path, calls: int) -> bool:
    """Kill a recovery after so many file operations; returns whether it had ended before."""
    say(child, folder)
    for call in range(calls + 1):
        if child.stdout.readline() == "done\n":
            assert int(child.stdout.readline()) == 0
            return True
        say(child, "stop" if call == calls else "")
    assert int(child.stdout.readline()) == signal.SIGKILL
    return False


def test_a_recovery_killed_before_any_of_its_steps_can_be_repeated(tmp_path, unsealed, recovering):
    good, sent = unsealed(samples=3000, name="good")
    with mcap_file(good).open("ab") as file:  # half a chunk
        file.write(b"\6" + (5000).to_bytes(8, "little") + bytes(1000))
    for calls in range(100):
        folder = tmp_path / "run"
        shutil.copytree(good, folder)
        done = killed_at_step(recovering, folder, calls)
        recover(folder)
        assert by_rosbags(folder) == sent, f"killed before step {calls}"
        shutil.rmtree(folder)
        if done:
            return
    pytest.fail("a recovery of more than a hundred steps")
