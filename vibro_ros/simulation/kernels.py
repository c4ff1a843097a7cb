"""The numerical kernels, compiled before a clock starts.

A separate process compiles and stores the kernels, and this process loads them. A kernel that a process has compiled
itself may call parts that were compiled separately before, and that round differently in the last digit; a loaded
kernel never does. So the first start computes the same bits as any other. A stop signal ends the compiling process at
once, whatever it does.
"""

import gc
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation.motion import EVENTS_AT_ONCE, new_stepper
from vibro_ros.simulation.readout import Readout
from vibro_ros.simulation.samples import Trace
from vibro_ros.solver.compilation import compile_entry, is_stored, mark_as_stored, progress, store_environment
from vibro_ros.solver.events import EVENT_COLUMNS, leave_for_ramp
from vibro_ros.solver.reference import Laid
from vibro_ros.solver.segment import read_signals
from vibro_ros.solver.state import new_state
from vibro_ros.solver.taylor import read_rotor

# Thresholds of the garbage collector during compilation. The compiler makes millions of objects, hardly any of them
# garbage: with the usual thresholds, collection takes a tenth of the time; without collection, garbage takes 80 MB.
_THRESHOLDS = 100_000, 50, 100

#: Methods whose kernels this process has loaded.
compiled_methods: set[str] = set()


def compile_kernels(method: str = "exact") -> None:
    """Load the numerical kernels of a `solver.method`; if the cache lacks them, another process compiles them first."""
    if method in compiled_methods:
        return
    if is_stored(method):
        _compile_all(method)  # loads them
    else:
        progress.under_way.append("kernels")
        try:
            _store_in_a_process(method)
            _compile_all(method)  # loads them; if the process has failed, its error is raised here
        finally:
            progress.under_way.pop()
    compiled_methods.add(method)


def _compile_all(method: str) -> None:
    usual = gc.get_threshold()
    gc.set_threshold(*_THRESHOLDS)
    try:
        for call in kernel_calls(method):
            compile_entry(*call)
    finally:
        gc.set_threshold(*usual)


def _store_in_a_process(method: str) -> None:
    """Compile and store all kernels in another process, which imports this package from the same place."""
    program = f"from vibro_ros.simulation.kernels import store_kernels; store_kernels({method!r})"
    environment = {**os.environ, **store_environment(), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with suppress(OSError), subprocess.Popen(
            [sys.executable, "-c", program], env=environment, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True) as process:
        try:
            process.wait()
        finally:
            process.kill()
    progress.done.append("kernels")


def store_kernels(method: str) -> None:
    """Compile and store all kernels of a method; end when the process at the other end of stdin ends."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _compile_all(method)
    mark_as_stored(method)


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


def kernel_calls(method: str) -> Iterator[tuple[Callable, tuple]]:
    """Yield every kernel of a `solver.method`, the slowest to compile first, with arguments of the right types."""
    scene = Scene(parameters={"solver.method": method})
    model = compile_scene(scene)
    channels = model.forms.channels.count
    state = new_state(model.system, 0.0, np.zeros(len(model.forms.plates)), model.initial_mode)
    times, point, events = np.zeros(1), np.zeros(channels), np.empty((EVENTS_AT_ONCE, EVENT_COLUMNS))
    trace = Trace(np.empty((1, channels)), np.empty(1, dtype=np.int64), np.empty((1, 3)))
    tables = model.laid.layout, Laid(state).layout
    yield from new_stepper(scene, model).calls(state, (times, point, *trace, events))
    yield read_signals, (*tables, point)
    yield read_rotor, (*tables, point)
    yield leave_for_ramp, (*tables, 0, point, events, 0)
    yield from Readout(model).calls(times, trace)

