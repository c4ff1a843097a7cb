"""The numerical kernels, compiled before a clock starts.

One kernel takes longer to compile than all others together. Where there are cores and a cache for it, a second process
compiles the others meanwhile.
"""

import gc
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.motion import EVENTS_AT_ONCE, new_stepper
from vibro_ros.simulation.processes import core_count
from vibro_ros.simulation.readout import Readout
from vibro_ros.simulation.samples import Trace
from vibro_ros.solver.compilation import PLAIN, compile_entry, entry_types, is_stored
from vibro_ros.solver.events import EVENT_COLUMNS, leave_for_ramp
from vibro_ros.solver.progress import progress
from vibro_ros.solver.segment import read_signals
from vibro_ros.solver.state import new_state

# The compiler makes millions of objects, of which hardly any is garbage: searched as often as usual, they take a tenth
# of its time; never searched, they take 80 MB.
_THRESHOLDS = 100_000, 50, 100

# What the second process runs.
_PROGRAM = """
import sys
from vibro_ros.simulation.kernels import compile_some, end_with_parent
end_with_parent()
compile_some(sys.argv[1], sys.argv[2:])
"""

#: Methods whose kernels this process has.
compiled_methods: set[str] = set()


class Call(NamedTuple):
    """A kernel that Python calls, and the types of its arguments as `entry_types` gives them."""

    kernel: Any
    types: tuple

    @property
    def name(self) -> str:
        """The kernel's name, which no other kernel has."""
        return f"{self.kernel.__module__}.{self.kernel.__name__}"

    def is_stored(self) -> bool:
        """Whether the cache has the compiled kernel."""
        return is_stored(self.kernel, self.types)

    def compile(self) -> None:
        """Compile the kernel, or load it, if neither was done before."""
        compile_entry(self.kernel, self.types)


def kernel_calls(method: str) -> list[Call]:
    """Every kernel of a `solver.method`, the longest to compile first."""
    scene = Scene(parameters={"solver.method": method})
    model = compile_scene(scene)
    channels = model.forms.channels.count
    state = new_state(model.system, 0.0, np.zeros(len(model.forms.plates)), model.initial_mode)
    times, point, events = np.zeros(1), np.zeros(channels), np.empty((EVENTS_AT_ONCE, EVENT_COLUMNS))
    trace = Trace(np.empty((1, channels)), np.empty(1, dtype=np.int64), np.empty((1, 3)))
    calls = [*new_stepper(scene, model).calls(state, (times, point, *trace, events)),
             (read_signals, (model.system, state, point)),
             (leave_for_ramp, (model.system, state, 0, point, events, 0)),
             *Readout(model).calls(times, trace)]
    return [Call(kernel, entry_types(kernel, arguments)) for kernel, arguments in calls]


def compile_kernels(method: str = "exact") -> None:
    """Compile the numerical kernels of a `solver.method`, or load them from the cache; the first time, in a process."""
    if method in compiled_methods:
        return
    calls = _all_calls(method)
    missing = [call for call in calls if not call.is_stored()]
    with _seldom_collected(), SecondProcess(work_of_another(method, missing)) as second:
        for call in missing[:1]:
            call.compile()
        if not progress.unwritable:
            second.wait()
        for call in calls:
            call.compile()
    compiled_methods.add(method)


def compile_some(method: str, names: Sequence[str]) -> None:
    """Compile the kernels of these names into the cache."""
    with _seldom_collected():
        for call in _all_calls(method):
            if call.name in names:
                call.compile()


def _all_calls(method: str) -> list[Call]:
    """The kernels of a method; auto needs two, because all steps of fixed length are one kernel."""
    families = ("exact", "rk4") if method == "auto" else (method,)
    return list({call.name: call for family in families for call in kernel_calls(family)}.values())


def work_of_another(method: str, missing: Sequence[Call]) -> tuple[str, list[str]] | None:
    """What a second process is to do; None if none would help."""
    others = [call.name for call in missing[1:]]
    return (method, others) if others and core_count() > 1 and not PLAIN else None


@contextmanager
def _seldom_collected() -> Iterator[None]:
    usual = gc.get_threshold()
    gc.set_threshold(*_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


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
