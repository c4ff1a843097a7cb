"""The guards of the tests work: a domain belongs to one test at a time, and a process that is left behind is an error.
"""

import os
import shutil
import socket
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from real_processes import wait_until

SET_UP = Path(__file__).with_name("every_test.py")


def test_domain_is_held_until_its_test_ends(domain_id):
    assert os.environ["ROS_DOMAIN_ID"] == str(domain_id)
    with closing(socket.socket(socket.AF_UNIX)) as rival, pytest.raises(OSError, match="in use"):
        rival.bind(f"\0vibro_ros.test.domain.{domain_id}")


def command_of(pid: int) -> str:
    """Return a process's command line, empty when it has ended (and perhaps waits to be reaped)."""
    file = Path(f"/proc/{pid}/cmdline")
    return file.read_text() if file.exists() else ""


def run_session(folder: Path, body: str) -> subprocess.CompletedProcess:
    """Run a test session of one test with this set-up."""
    shutil.copy(SET_UP, folder / "conftest.py")
    (folder / "setup.cfg").touch()  # the session's root is here
    (folder / "test_planted.py").write_text(f"import subprocess\ndef test_planted():\n    {body}\n")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", str(folder)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)


def test_orphan_is_found_named_and_ended(tmp_path):
    done = run_session(tmp_path, "subprocess.run(['sh', '-c', 'exec sleep 987 & echo $! > pid'])")
    pid = int((tmp_path / "pid").read_text())
    assert done.returncode != 0
    assert f"{pid} 'sleep 987' started in test_planted.py::test_planted" in done.stdout
    wait_until(lambda: command_of(pid) == "", "the orphan's end")
