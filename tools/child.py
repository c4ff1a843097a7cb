"""Python programs as child processes: what they say is shown or waited for, and none outlives the parent's block."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping

PATIENCE = 20.0
"""How long [s] a child may take to end after SIGINT before it is killed; sealing a bag takes well under one."""
_POLL = 0.05  # s
_ROS_PREFIX = re.compile(r"^\[INFO\] \[[0-9.]+\] \[[^]]*\]: ")


class Child:
    """A process running one module, by this interpreter's `-m`, or `-c` and a program; a context that ends it.

    Its `environment` is the whole one, this process's where none is given. Each line that it says is `shown`, behind
    `name`, the last part of the module's name.
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
        """Exit code; None while it runs."""
        return self._process.poll()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def wait_for(self, words: str) -> str:
        """The first line that holds `words`.

        Raises
        ------
        RuntimeError
            When the process ends before; the message holds what it has said.
        """
        while True:
            over = not self._reader.is_alive()
            if line := next((line for line in list(self._lines) if words in line), ""):
                return line
            if over:
                raise RuntimeError(f"{self.name} has ended: {' '.join(self._lines)}")
            time.sleep(_POLL)

    def stop(self) -> int:
        """Ask it to end with SIGINT if it runs, wait, kill it after `PATIENCE`; its exit code."""
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
