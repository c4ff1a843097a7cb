"""kill -9 at any step of a recovery: flushed messages are never lost, and the recovery can be repeated."""

import itertools
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from recorded_bag import by_rosbags, mcap_file

from vibro_ros.recordings.recover import recover

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


def test_a_recovery_killed_before_any_of_its_steps_can_be_repeated(tmp_path, unsealed):
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
