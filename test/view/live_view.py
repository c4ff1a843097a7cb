"""The view as its own process, what it needs and what it leaves."""

import re
import signal
from pathlib import Path

from visitor import Address

ADDRESS = re.compile(r"http://\S+:\d+/\?token=\S+")


class LiveView:
    """The executable `view` without a bag, and the address that it prints."""

    def __init__(self, start, *arguments: str):
        self.executable = start("live_view", "--port", "0", *arguments)
        self.address = Address(ADDRESS.search(self.executable.wait_for("/?token="))[0])

    @property
    def memory(self) -> float:
        """Resident memory [MB]."""
        return resident_memory(self.executable.pid)

    def end(self, number: signal.Signals = signal.SIGINT) -> None:
        """End it as a user does."""
        self.executable.send(number)
        assert self.executable.end() == 0, self.executable.text
        self.check()

    def check(self) -> None:
        """Fail if it has said a traceback, or a fault of its own."""
        assert "Traceback" not in self.executable.text, self.executable.text
        assert "please report" not in self.executable.text, self.executable.text


def resident_memory(pid: int) -> float:
    """Resident memory [MB] of a process."""
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) * 1024e-6
