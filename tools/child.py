"""Python programs as child processes: their output is shown or waited for, and they end with the parent's block."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping

PATIENCE = 20.0
"""Longest time [s] for a child to end after SIGINT before it is killed; sealing a bag takes well under 1 s."""
_POLL = 0.05  # s
_ROS_PREFIX = re.compile(r"^\[INFO\] \[[0-9.]+\] \[[^]]*\]: ")


class Child:
    """A process of this interpreter that runs a module (`-m`) or a program (`-c`); a context manager that ends it.

    `environment` is its whole environment, by default that of this process. If `shown`, each line of its output is
    printed after `name`, the last part of the module's name.
    """

    def __init__(self, module: str, *arguments: str, environment: Mapping[str, str] | None = None, shown: bool = True):
        self.name, self._shown = module.rpartition(".")[2], shown
        self._lines: list[str] = []
        words = [module] if module.startswith("-") else ["-m", module]
        self._process = subprocess.Popen([sys.executable, *words, *arguments], env=environment or dict(os.environ),
                                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def exit_code(self) -> int | None:
        """Exit code, or None while the process runs."""
        return self._process.poll()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def wait_for(self, words: str) -> str:
        """Return the first line of output that contains `words`; RuntimeError with the output if the process ends."""
        while True:
            over = not self._reader.is_alive()
            if line := next((line for line in list(self._lines) if words in line), ""):
                return line
            if over:
                raise RuntimeError(f"{self.name} has ended: {' '.join(self._lines)}")
            time.sleep(_POLL)

    def stop(self) -> int:
        """End the process with SIGINT if it runs, kill it after `PATIENCE`, and return its exit code."""
        if self.exit_code is None:
            self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(PATIENCE)
        return self._process.returncode

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _read(self) -> None:
        for line in self._process.stdout or ():
            self._lines.append(line.rstrip())
            if self._shown:
                print(f"{self.name:>10} | {_ROS_PREFIX.sub('', line.rstrip())}", flush=True)
