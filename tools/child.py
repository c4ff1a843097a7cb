"""Executables of the package as child processes that show what they say and never outlive the parent's block."""

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping

PATIENCE = 20.0
"""How long [s] a child may take to end after SIGINT before it is killed; sealing a bag takes well under one."""
_ROS_PREFIX = re.compile(r"^\[INFO\] \[[0-9.]+\] \[[^]]*\]: ")


class Child:
    """A process running one module, by this interpreter's `-m`, in the whole environment given; a context that ends it.

    `name` is the last part of the module's name; it begins each line that is shown.
    """

    def __init__(self, module: str, *arguments: str, environment: Mapping[str, str]):
        self.name = module.rpartition(".")[2]
        self._process = subprocess.Popen([sys.executable, "-m", module, *arguments], env=environment,
                                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
        self._reader = threading.Thread(target=self._show, daemon=True)
        self._reader.start()

    @property
    def exit_code(self) -> int | None:
        """Exit code; None while it runs."""
        return self._process.poll()

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

    def _show(self) -> None:
        for line in self._process.stdout or ():
            print(f"{self.name:>10} | {_ROS_PREFIX.sub('', line.rstrip())}", flush=True)
