"""All kernels of a method are compiled and stored before the start by a separate process, and run without numba, too.
"""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest

from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.model.scene import Scene
from vibro_ros.model.tables import compile_scene
from vibro_ros.solver import state

PATIENCE = 600.0  # [s]
RUN = """
import vibro_ros
from vibro_ros.simulation.kernels import compile_kernels
from vibro_ros.solver.compilation import progress

compile_kernels({method!r})
loaded = len(progress.loaded)
scene = vibro_ros.load_scene("device").with_parameters({{"solver.method": {method!r}}})
device = vibro_ros.Simulator(scene)
device.command(motor_speed=100.0, upper_gap=0.001)
device.advance_to(0.3)
print(loaded, len(progress.loaded) - loaded, *progress.done, device.state.body_position.hex())
"""
WITHOUT_NUMBA = """
import vibro_ros
for name, duration in (("damped", 0.3), ("device", 0.2), ("machine", 0.02)):
    scene = vibro_ros.load_scene(name)
    run = vibro_ros.simulate(scene, duration=duration, rate=200.0, commands=[(0.0, {"motor_speed": 100.0})])
    print(name, len(run.events), run.statistics["steps"], f"{run.body_position[-1]:.12f} {run.upper_position[-1]:.12f}")
"""


def output_of(program: str, **environment: str) -> str:
    """Run a program and return its output."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE,
                          env={**os.environ, **environment})
    assert done.returncode == 0, done.stderr
    return done.stdout


def array_types(values: tuple) -> list[str]:
    """Types of all arrays in a named tuple, by which numba distinguishes kernels."""
    return [kind for value in values for kind in (array_types(value) if hasattr(value, "_fields")
                                                  else [str(numba.typeof(value))])]


def test_every_scene_takes_the_same_kernels():
    """A read-only or non-contiguous array would require another set of compiled kernels."""
    expected = array_types(compile_scene(Scene()).system)
    for name, accounts in itertools.product(shipped_scenes(), (False, True)):
        scene = load_scene(name).with_parameters({"solver.accounts": accounts})
        assert array_types(compile_scene(scene).system) == expected


def test_a_first_start_computes_the_bits_of_every_other_and_leaves_nothing_to_be_compiled(tmp_path):
    """A process that compiles for itself may call parts that were compiled separately, and round in another way."""
    first, second = (output_of(RUN.format(method="rk4"), NUMBA_CACHE_DIR=str(tmp_path)).split() for _ in range(2))
    assert first == ["7", "0", "kernels", first[-1]]
    assert second == ["7", "0", first[-1]]


def test_the_process_that_compiles_ends_with_the_one_that_wants_it(tmp_path):
    program = "from vibro_ros.simulation.kernels import compile_kernels; compile_kernels('exact')"
    wanting = subprocess.Popen([sys.executable, "-c", program], env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)})
    children, deadline = Path(f"/proc/{wanting.pid}/task/{wanting.pid}/children"), time.monotonic() + PATIENCE
    while not (child := children.read_text().split()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    wanting.send_signal(signal.SIGKILL)
    wanting.wait()
    status = Path(f"/proc/{child[0]}/stat")
    while status.exists() and ") Z " not in status.read_text():  # nobody may be there to take its exit code
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert not list(tmp_path.rglob("*.stored"))


def test_the_kernels_run_as_plain_python():
    """A debugger steps through the code that numba compiles otherwise; events are the same, and positions agree to
    rounding.
    """
    assert output_of(WITHOUT_NUMBA, NUMBA_DISABLE_JIT="1") == output_of(WITHOUT_NUMBA)


def test_vectors_of_numpy_do_what_vectors_in_registers_do():
    tests = Path(__file__).parents[1] / "solver" / "test_vector.py"
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tests], capture_output=True,
                          text=True, timeout=PATIENCE, env={**os.environ, "NUMBA_DISABLE_JIT": "1"})
    assert done.returncode == 0 and "passed" in done.stdout, done.stdout


@pytest.mark.parametrize("name", [name for name, one in vars(state).items() if isinstance(one, np.dtype) and one.names])
def test_no_field_of_a_record_has_the_name_of_an_attribute_of_numpy(name):
    """Otherwise plain Python would read the attribute instead of the field."""
    assert not set(getattr(state, name).names) & set(dir(np.record))
