"""A second process that compiles kernels into the cache while this one compiles others."""

import os
import subprocess
import sys
import threading
from collections.abc import Sequence

from vibro_ros.solver.progress import progress

_PROGRAM = """
import sys
from vibro_ros.simulation.second_process import end_with_parent
end_with_parent()
from vibro_ros.simulation.kernels import compile_some
compile_some(sys.argv[1], sys.argv[2:])
"""


class SecondProcess:
    """Compiles kernels into the cache; a context manager that leaves no process behind.

    Whatever goes wrong with it, the kernels are only missing in the cache.

    Parameters
    ----------
    job : tuple of (str, list of str), or None
        A `solver.method` and the names of the kernels; None does nothing.
    """

    def __init__(self, job: tuple[str, list[str]] | None):
        self._names = job[1] if job else []
        self._process = _started(*job) if job else None

    def __enter__(self) -> "SecondProcess":
        return self

    def __exit__(self, *_: object) -> None:
        if self._process:
            self._process.kill()
            self._process.communicate()

    def wait(self) -> None:
        """Wait for its end, and say so in `progress`."""
        if self._process:
            progress.elsewhere += [name.rpartition(".")[2] for name in self._names]
            try:
                self._process.wait()
            finally:
                progress.elsewhere.clear()


def _started(method: str, names: Sequence[str]) -> subprocess.Popen | None:
    """The process; it finds this package where this process does, and does not hear a terminal's Ctrl-C."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        return subprocess.Popen([sys.executable, "-c", _PROGRAM, method, *names], env=environment,
                                stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                start_new_session=True)
    except OSError:
        return None


def end_with_parent() -> None:
    """Let this process end at once when the one that wants it ends, whatever ends that."""
    threading.Thread(target=_end_after_input, daemon=True).start()


def _end_after_input() -> None:
    sys.stdin.read()
    os._exit(1)
