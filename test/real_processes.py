"""Real processes and a real rclpy node, each ended by its fixture; fixtures for the folders that import them."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher

from vibro_ros.process.executables import EXECUTABLES

MODULES = {name: executable.module for name, executable in EXECUTABLES.items()} | {"twin": "vibro_lab.twin.twin"}

CRAWL = ("--ros-args", "-p", "motor.speed:=100.0", "-p", "record.enabled:=false")  # of a robot that is looked at
PATIENCE = 60.0  # [s] deadline of what takes a second on an idle machine


def wait_until(done: Callable[[], bool], description: str, patience: float = PATIENCE) -> None:
    """Wait until a condition holds that this process need do nothing for."""
    deadline = time.monotonic() + patience
    while not done():
        assert time.monotonic() < deadline, f"{description}: not within {patience} s"
        time.sleep(0.002)


def takes_signals(pid: int) -> bool:
    """Return whether a process has entered `entry_point.enter`: it handles SIGHUP, which Python alone does not."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGHUP - 1) & 1)


class Executable:
    """A running executable of the package, or Python with other arguments, and its output."""

    def __init__(self, name: str, *arguments: str, folder: Path, wrapper: Sequence[str] = ()):
        self.lines: list[str] = []
        words = ("-m", MODULES[name]) if name in MODULES else (name,)
        self._process = subprocess.Popen(
            [*wrapper, sys.executable, *words, *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder,
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def ended(self) -> bool:
        return self._process.poll() is not None

    def wait_for(self, words: str, patience: float = PATIENCE) -> str:
        """Return the first line that contains `words`."""
        deadline = time.monotonic() + patience
        while time.monotonic() < deadline:
            ended = self.ended
            line = next((line for line in list(self.lines) if words in line), None)
            if line is not None:
                return line
            assert not ended or self._reader.is_alive(), f"ended without {words!r}:\n{self.text}"
            time.sleep(0.01)
        raise AssertionError(f"no {words!r} within {patience} s:\n{self.text}")

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self, patience: float = PATIENCE) -> int:
        """Return the exit code once the process has ended by itself and its output has been read."""
        try:
            code = self._process.wait(patience)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"still running after {patience} s:\n{self.text}") from error
        self._reader.join()
        return code

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()

    def _read(self) -> None:
        self.lines.extend(line.rstrip("\n") for line in iter(self._process.stdout.readline, ""))


class Bench:
    """An rclpy node of the test, in its own context."""

    def __init__(self, domain_id: int):
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self.node = Node("bench", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def spin_until(self, done: Callable[[], bool], description: str, patience: float = PATIENCE) -> None:
        deadline = time.monotonic() + patience
        while not done():
            assert time.monotonic() < deadline, f"{description}: not within {patience} s"
            self._executor.spin_once(timeout_sec=0.05)

    def spin_once(self) -> None:
        """Run one callback, if one is ready."""
        self._executor.spin_once(timeout_sec=0.0)

    def publishers(self, kinds: Mapping[str, type], depth: int = 10) -> dict[str, Publisher]:
        """Return a publisher of each topic, whose types are given, once each has a subscriber."""
        made = {topic: self.node.create_publisher(kind, topic, depth) for topic, kind in kinds.items()}
        self.spin_until(lambda: all(publisher.get_subscription_count() for publisher in made.values()),
                        f"subscribers of {[*made]}")
        return made

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


@pytest.fixture
def udp_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """No shared memory between processes, for tests that kill one: others then crash now and then in Fast DDS 2.14.

    Of that kind: eProsima/Fast-DDS, issues 1144 and 6501. To be asked for before `start` and `bench`.
    """
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")


@pytest.fixture
def start(domain_id: int, tmp_path: Path) -> Iterator[Callable[..., Executable]]:
    """Fixture: a function that starts an executable in the test's domain and folder, preceded by a command `wrapper`;
    the process is killed at the end if it still runs.
    """
    started: list[Executable] = []

    def start_one(name: str, *arguments: str, wrapper: Sequence[str] = ()) -> Executable:
        started.append(Executable(name, *arguments, folder=tmp_path, wrapper=wrapper))
        return started[-1]

    assert os.environ["ROS_DOMAIN_ID"] == str(domain_id)
    yield start_one
    for executable in started:
        executable.kill()


@pytest.fixture
def bench(domain_id: int) -> Iterator[Bench]:
    bench = Bench(domain_id)
    yield bench
    bench.close()


@pytest.fixture
def refusal(domain_id, tmp_path, monkeypatch, capfd) -> Callable[..., str]:
    """Return the line with which an executable's `main` refuses its arguments, with exit code 2, without a process of
    its own.
    """
    monkeypatch.chdir(tmp_path)

    def call(main: Callable[[list[str]], int], *words: str) -> str:
        assert main(list(words)) == 2
        (line,) = [line for line in capfd.readouterr().err.splitlines() if not line.startswith("[")]  # of the log
        return line
    return call
