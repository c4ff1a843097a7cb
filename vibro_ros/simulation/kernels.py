"""The numerical kernels, compiled before a clock starts.

One kernel takes longer to compile than all others together. Where there is a second core, a second process compiles the
others meanwhile: of the 20 s of processor time that `exact` takes at a first start, 3 s; of the 18 s of `rk4`, 8 s.
"""

import gc
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.motion import EVENTS_AT_ONCE, new_stepper
from vibro_ros.simulation.processes import core_count
from vibro_ros.simulation.readout import Readout
from vibro_ros.simulation.samples import Trace
from vibro_ros.solver.compilation import PLAIN, compile_entry, entry_types, is_stored
from vibro_ros.solver.events import EVENT_COLUMNS, leave_for_ramp
from vibro_ros.solver.kernel_cache import progress
from vibro_ros.solver.segment import read_signals
from vibro_ros.solver.state import new_state
from vibro_ros.solver.taylor import read_rotor

# The compiler makes millions of objects, of which hardly any is garbage: searched as often as usual, they take a tenth
# of its time; never searched, they take 80 MB.
_THRESHOLDS = 100_000, 50, 100

#: Methods whose kernels this process has.
compiled_methods: set[str] = set()


def compile_kernels(method: str = "exact") -> None:
    """Compile the numerical kernels of a `solver.method`, or load them from the cache; the first time, in a process."""
    if method in compiled_methods:
        return
    calls = kernel_calls(method)
    missing = [call for call in calls if not is_stored(*call)]
    with _seldom_collected(), _second_process(method, len(missing)) as second:
        for call in missing[:1]:
            compile_entry(*call)
        if second and not progress.unwritable:
            second.wait()
        for call in calls:
            compile_entry(*call)
    compiled_methods.add(method)


def kernel_calls(method: str) -> list[tuple[Callable, tuple]]:
    """Every kernel of a `solver.method` with its `entry_types`, the longest to compile first."""
    return list(_calls(method))


def _calls(method: str) -> Iterator[tuple[Callable, tuple]]:
    scene = Scene(parameters={"solver.method": method})
    model = compile_scene(scene)
    channels = model.forms.channels.count
    state = new_state(model.system, 0.0, np.zeros(len(model.forms.plates)), model.initial_mode)
    times, point, events = np.zeros(1), np.zeros(channels), np.empty((EVENTS_AT_ONCE, EVENT_COLUMNS))
    trace = Trace(np.empty((1, channels)), np.empty(1, dtype=np.int64), np.empty((1, 3)))
    for kernel, arguments in (*new_stepper(scene, model).calls(state, (times, point, *trace, events)),
                              (read_signals, (model.system, state, point)),
                              (read_rotor, (model.system, state, point)),
                              (leave_for_ramp, (model.system, state, 0, point, events, 0)),
                              *Readout(model).calls(times, trace)):
        yield kernel, entry_types(kernel, arguments)


@contextmanager
def _seldom_collected() -> Iterator[None]:
    usual = gc.get_threshold()
    gc.set_threshold(*_THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


@contextmanager
def _second_process(method: str, missing: int) -> Iterator[subprocess.Popen | None]:
    """A process that compiles all `missing` kernels but the first into the cache; None if it would not help.

    It is ended with the block. Whatever goes wrong with it, the kernels are only missing in the cache. It finds this
    package where this process does, and does not hear a terminal's Ctrl-C.
    """
    process = None
    if missing > 1 and core_count() > 1 and not PLAIN:
        program = f"from vibro_ros.simulation.kernels import compile_others; compile_others({method!r})"
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        with suppress(OSError):
            process = subprocess.Popen([sys.executable, "-c", program], env=environment, stdin=subprocess.PIPE,
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        yield process
    finally:
        if process:
            process.kill()
            process.communicate()


def compile_others(method: str) -> None:
    """Compile into the cache all kernels that are missing there but the first, as the second process."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with _seldom_collected():
        for call in [call for call in kernel_calls(method) if not is_stored(*call)][1:]:
            compile_entry(*call)


def _end_with_parent() -> None:
    """End this process at once when the one that wants it ends, whatever ends that."""
    sys.stdin.read()
    os._exit(1)
