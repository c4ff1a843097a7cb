"""What every test shares: the ROS environment, a domain of its own, and no process left behind."""

import ctypes
import itertools
import os
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOMAINS = range(1, 102)  # [-] DDS computes its ports from the id; above 101 they meet Linux's ephemeral ports
PATIENCE = 10.0  # [s] that a process told to end may take to disappear
PR_SET_CHILD_SUBREAPER = 36  # from <linux/prctl.h>

# Before anything imports rclpy; child processes inherit it all.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))

_next_domain = itertools.count(os.getpid())


@pytest.fixture
def domain_id(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Give a ROS domain that no other test on this machine uses meanwhile, also as `ROS_DOMAIN_ID`."""
    number, claim = _claim_domain()
    with closing(claim):
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        yield number


def _claim_domain() -> tuple[int, socket.socket]:
    """Return a free domain and the socket that holds it until closed.

    An abstract socket lives in the network namespace, as DDS does, leaves no file, and dies with its process.
    """
    for _ in DOMAINS:
        number = DOMAINS[next(_next_domain) % len(DOMAINS)]
        claim = socket.socket(socket.AF_UNIX)
        try:
            claim.bind(f"\0vibro_ros.test.domain.{number}")
            return number, claim
        except OSError:
            claim.close()
    raise RuntimeError(f"all ROS domains {DOMAINS[0]} to {DOMAINS[-1]} are taken by running tests")


@pytest.fixture(scope="session", autouse=True)
def no_process_left_behind() -> Iterator[None]:
    """Fail the session when a test leaves a process running, orphans included; end such processes."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)  # orphans become ours, so that we see them
    earlier = set(_running_children())
    yield
    deadline = time.monotonic() + PATIENCE
    while (left := set(_running_children()) - earlier) and time.monotonic() < deadline:
        time.sleep(0.05)
    complaints = [_describe_process(pid) for pid in sorted(left)]
    for pid in left:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    assert not complaints, "processes left behind:\n" + "\n".join(complaints)


def _running_children() -> list[int]:
    """Return the ids of this process's children that still run; the ended ones (zombies) do not count."""
    listings = Path("/proc/self/task").glob("*/children")
    pids = [int(pid) for listing in listings for pid in listing.read_text().split()]
    return [pid for pid in pids if _command(pid) and "multiprocessing.resource_tracker" not in _command(pid)]


def _command(pid: int) -> str:
    """Return a process's command line, empty for a zombie or one that is gone."""
    return _read_words(pid, "cmdline", " ")


def _describe_process(pid: int) -> str:
    """Say which test started a process: pytest names the running test in the environment that children inherit."""
    environment = _read_words(pid, "environ", "\n").splitlines()
    test = [line.partition("=")[2] for line in environment if line.startswith("PYTEST_CURRENT_TEST=")]
    return f"{pid} {_command(pid)!r} started in {test[0] if test else 'an unknown test'}"


def _read_words(pid: int, name: str, separator: str) -> str:
    """Return the words of /proc/<pid>/<name>, or nothing when the process has ended."""
    try:
        return Path(f"/proc/{pid}/{name}").read_bytes().decode(errors="replace").strip("\0").replace("\0", separator)
    except OSError:
        return ""
