"""`make view`: robot and view as two processes that end together."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest

PATIENCE = 120.0  # [s] deadline of what takes some seconds on an idle machine


class Look:
    """A running `look` and what it has said."""

    def __init__(self, folder: Path, *words: str):
        self._said = folder / "said.txt"
        self.process = subprocess.Popen([sys.executable, "-m", "tools.look", *words], cwd=folder,
                                        stdout=self._said.open("w"), stderr=subprocess.STDOUT, start_new_session=True)

    @property
    def text(self) -> str:
        return self._said.read_text()

    def wait_for(self, words: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while words not in self.text:
            assert self.process.poll() is None, f"ended without {words!r}:\n{self.text}"
            assert time.monotonic() < deadline, f"no {words!r} within {PATIENCE} s:\n{self.text}"
            time.sleep(0.05)

    def children(self) -> dict[str, int]:
        """Process id by name of the executables that run below it."""
        pids = [int(pid) for listing in Path(f"/proc/{self.process.pid}/task").glob("*/children")
                for pid in listing.read_text().split()]
        words = {pid: Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0") for pid in pids}
        return {word.rpartition(".")[2]: pid for pid, one in words.items() for word in one
                if word.startswith("vibro_ros.ros.")}

    def end(self) -> int:
        code = self.process.wait(PATIENCE)
        assert "Traceback" not in self.text, self.text
        return code


@pytest.fixture
def look(domain_id: int, tmp_path: Path) -> Iterator[Callable[..., Look]]:
    started: list[Look] = []

    def start(*words: str) -> Look:
        started.append(Look(tmp_path, *words))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.process.terminate()
            one.process.wait(PATIENCE)


def test_the_page_is_there_and_one_interrupt_ends_all(look, tmp_path):
    """Ctrl-C in a terminal goes to all three processes at once."""
    one = look("--port", "0")
    one.wait_for("ready: 200 Hz")
    one.wait_for("view: http://")
    with urlopen(re.search(r"http://\S+", one.text)[0], timeout=PATIENCE) as page:
        assert b"/vibro_robot" in page.read()
    children = one.children()
    assert set(children) == {"live_view", "robot"}
    os.killpg(one.process.pid, signal.SIGINT)
    assert one.end() == 0, one.text
    assert not any(Path(f"/proc/{pid}").exists() for pid in children.values())
    assert list((tmp_path / "out").iterdir()) == []  # nothing is recorded unless somebody asks


def test_when_one_of_them_is_killed_the_other_ends(look):
    one = look("--port", "0")
    one.wait_for("view: http://")
    children = one.children()
    os.kill(children["robot"], signal.SIGKILL)
    assert one.end() == 1
    assert "look: robot has ended with exit code -9; it says why above" in one.text
    assert not any(Path(f"/proc/{pid}").exists() for pid in children.values())
