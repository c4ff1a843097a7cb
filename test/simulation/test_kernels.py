"""All kernels of a method are compiled or loaded before the start, some of them by a second process."""

import itertools
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.simulation import kernels

PATIENCE = 600.0  # [s]
RUN = """
import vibro_ros
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.solver.kernel_cache import progress

compile_kernels({method!r})
count = len(progress.done) + len(progress.loaded)
scene = vibro_ros.load_scene("device").with_parameters({{"solver.method": {method!r}}})
device = vibro_ros.Simulator(scene)
device.command(motor_speed=100.0, upper_gap=0.001)
device.advance_to(0.01)
device.state
print(len(progress.done) + len(progress.loaded) - count, *sorted(progress.done))
"""


@pytest.fixture
def empty(monkeypatch, tmp_path) -> Path:
    """An empty cache of this test's own, for other processes."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return tmp_path


def said(program: str) -> str:
    """What a program prints."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    return done.stdout


def stored(folder: Path) -> set[str]:
    """Kernels in a cache."""
    return {file.name.partition("-")[0] for file in folder.glob("*/*.kernel")}


def array_types(values: tuple) -> list[str]:
    """Types of all arrays in a named tuple, by which numba tells kernels apart."""
    return [kind for value in values for kind in (array_types(value) if hasattr(value, "_fields")
                                                  else [str(numba.typeof(value))])]


def test_every_scene_takes_the_same_kernels():
    """An array that cannot be written, or is not contiguous, would be one more set of kernels to compile."""
    expected = array_types(compile_scene(Scene()).system)
    for name, booked in itertools.product(shipped_scenes(), (False, True)):
        scene = load_scene(name).with_parameters({"solver.accounts": booked})
        assert array_types(compile_scene(scene).system) == expected


@pytest.mark.parametrize("method", ["exact", "rk4"])
def test_nothing_is_left_to_be_compiled(method):
    assert said(RUN.format(method=method)).startswith("0")


def test_a_second_process_compiles_all_but_the_longest(empty):
    assert said(RUN.format(method="rk4")) == "0 advance\n"
    assert stored(empty) == {"fixed_step.advance", "fixed_step.begin", "fixed_step.interrupt", "segment.read_signals",
                             "taylor.read_rotor", "events.leave_for_ramp", "readout.read_samples"}


def test_a_second_process_ends_with_the_process_that_wants_it(empty):
    program = ("import os; from vibro_ros.simulation.kernels import _second_process; "
               "print(_second_process('exact', 2).__enter__().pid, flush=True); os._exit(0)")
    status = Path(f"/proc/{said(program).strip()}/stat")
    deadline = time.monotonic() + PATIENCE
    while status.exists() and ") Z " not in status.read_text():  # nobody may be there to take its exit code
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert stored(empty) == set()


def test_a_second_process_is_started_where_it_helps_and_ends_with_the_block(empty, monkeypatch):
    with pytest.raises(KeyboardInterrupt), kernels._second_process("exact", 2) as second:
        raise KeyboardInterrupt
    assert second.returncode == -9
    with kernels._second_process("exact", 1) as second:
        assert second is None
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    with kernels._second_process("exact", 2) as second:
        assert second is None
    monkeypatch.setattr(kernels, "core_count", lambda: 1)
    with kernels._second_process("exact", 2) as second:
        assert second is None
