"""The live view as a process."""

import signal
from pathlib import Path

from observation import stop
from web_client import address_of


class LiveView:
    """The executable `view` without a bag, and the address that it prints."""

    def __init__(self, start, *arguments: str):
        self.executable = start("live_view", "--port", "0", *arguments)
        self.address = address_of(self.executable)

    @property
    def memory(self) -> float:
        """Resident memory [MB]."""
        text = Path(f"/proc/{self.executable.pid}/status").read_text()
        return int(text.partition("VmRSS:")[2].split()[0]) * 1024e-6

    def end(self, number: signal.Signals = signal.SIGINT) -> None:
        """End the view as a user would."""
        stop(self.executable, number=number)
