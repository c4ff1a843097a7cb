"""Set-up of every test: the ROS environment, a ROS domain of its own, and a check that no process is left behind."""

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
PATIENCE = 5.0  # [s] that a process told to end may take to disappear
SESSION = f"VIBRO_ROS_TEST_SESSION={os.getpid()}"  # in the environment of all that the tests start

# Before anything imports rclpy; child processes inherit it all.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.update([SESSION.split("=")])
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # or each of the hundreds of programs started would compile the package
# Tests and what they start must hear signals that `nohup` or a script's `&` has told pytest to ignore.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda number, frame: None)  # a program that is started then has the default again
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))

_next_domain = itertools.count(os.getpid())


#: Tests that may be repeated once, by name, each with its reason; five at most. All others pass at the first try.
REPEATED = {
    "test_a_disk_that_stalls_for_two_seconds_costs_no_message_and_no_time":
        "counts messages at 1 kHz: another program that takes both cores for 0.1 s makes the listener miss some",
}


#: Files whose tests start processes or take seconds each; so does every test with a ROS domain. `make check` leaves
#: them out by the mark `process`, which single tests of other files have as well.
PROCESS = {f"test_{name}.py" for name in (
    "continuation", "dc_orbits", "feedback", "hostile_bags", "lyapunov_spectrum", "many_runs", "recorder_faults",
    "recovery", "recurrence", "replay")}

#: Files that install the package, or run documents, notebooks and the demonstration as a reader would. Only
#: `make test-slow` runs them, by the mark `slow`.
SLOW = {f"test_{name}.py" for name in (
    "demo", "documents", "examples", "installation", "notebooks", "sensor_examples", "setup", "site", "tutorial")}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark tests that `make check` and `make test` leave out, and tests that `REPEATED` names as repeatable."""
    for item in items:
        if item.path.name in SLOW:
            item.add_marker(pytest.mark.slow)
        if item.path.name in PROCESS or "domain_id" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.process)
        if getattr(item, "originalname", "") in REPEATED and config.pluginmanager.hasplugin("rerunfailures"):
            item.add_marker(pytest.mark.flaky(reruns=1))


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
    yield
    deadline = time.monotonic() + PATIENCE
    while (left := _running_processes()) and time.monotonic() < deadline:
        time.sleep(0.05)
    complaints = [_describe_process(pid) for pid in sorted(left)]
    for pid in left:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    assert not complaints, "processes left behind:\n" + "\n".join(complaints)


def _running_processes() -> set[int]:
    """Return the ids of the processes that the tests started, directly or not, and that still run."""
    everyone = {int(folder.name) for folder in Path("/proc").glob("[0-9]*")}
    return {pid for pid in everyone - {os.getpid()} if _is_ours(pid)}


def _is_ours(pid: int) -> bool:
    """Say whether a process is our child (a mere fork does not show SESSION) or was started in our environment."""
    parent = " ".join(_read_words(pid, "stat")).rpartition(")")[2].split()[1:2]
    command = " ".join(_read_words(pid, "cmdline"))  # empty for a zombie
    ours = parent == [str(os.getpid())] or SESSION in _read_words(pid, "environ")
    return bool(command) and ours and "multiprocessing.resource_tracker" not in command


def _describe_process(pid: int) -> str:
    """Say which test started a process: pytest names the running test in the environment that children inherit."""
    prefix = "PYTEST_CURRENT_TEST="
    tests = [word.removeprefix(prefix) for word in _read_words(pid, "environ") if word.startswith(prefix)]
    return f"{pid} {' '.join(_read_words(pid, 'cmdline'))!r} started in {tests[0] if tests else 'an unknown test'}"


def _read_words(pid: int, name: str) -> list[str]:
    """Return the words of /proc/<pid>/<name>, none when the process has ended or is not ours to read."""
    try:
        return list(filter(None, Path(f"/proc/{pid}/{name}").read_bytes().decode(errors="replace").split("\0")))
    except OSError:
        return []
