"""The compiled kernels: built from the present text, without fused products; `test_digests.py` compares their bits."""

import importlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from vibro_ros.solver import core

ROOT = Path(__file__).parents[2]
PATIENCE = 600.0  # [s]
SOLVER = Path(core.__file__).parent
BUILDS = sorted(path.name.partition(".")[0] for path in SOLVER.glob("core*.so"))


def output_of(*words: str, **environment: str) -> str:
    """Run Python with these words, and return its output."""
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=PATIENCE, cwd=ROOT,
                          env={**os.environ, **environment})
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.skipif(len(BUILDS) < 2, reason="there is one build for this kind of processor")
def test_the_second_build_is_chosen_by_the_processor():
    processor = re.search(r"^flags\s*: (.*)$", Path("/proc/cpuinfo").read_text(), flags=re.M).group(1).split()
    assert core.has_wide_registers() == ({"avx2", "bmi2", "fma"} <= set(processor))


@pytest.mark.process
def test_a_debugger_steps_from_simulate_into_find_next_event(tmp_path):
    program = tmp_path / "program.py"
    program.write_text("import vibro_ros\nscene = vibro_ros.load_scene('damped')\n"
                       "vibro_ros.simulate(scene, duration=0.01, rate=100.0)\n")
    done = subprocess.run(
        [sys.executable, "-m", "pdb", str(program)], capture_output=True, text=True, timeout=PATIENCE,
        input=f"b {SOLVER / 'guards.py'}:{line_of('        root = _guard_root(')}\nc\nwhere\np segment.next_event\nq\n",
        env={**os.environ, "VIBRO_ROS_PLAIN": "1", "PYTHONPATH": str(ROOT)})
    for name in ("simulate()", "advance()", "_begin_mode()", "find_next_event()"):
        assert name in done.stdout
    assert "(Pdb) np.float64(1.0)" in done.stdout


def line_of(start: str) -> int:
    """Return the number of the line of guards.py that starts so."""
    lines = (SOLVER / "guards.py").read_text().splitlines()
    return next(number for number, line in enumerate(lines, start=1) if line.startswith(start))


@pytest.mark.process
def test_the_built_kernels_are_those_of_the_present_text(tmp_path):
    """Otherwise an edited kernel would go on with its old bits; `make setup` builds it again."""
    output_of("-m", "vibro_ros.solver.unit", str(tmp_path))
    texts = (tmp_path / "core.pyx").read_text()
    assert core.digest() == re.search(r'return "(\w{64})"', texts).group(1)


def test_to_import_the_unit_changes_no_setting(monkeypatch):
    """A process that walks the modules once gave plain Python to all programs that it started afterwards."""
    monkeypatch.delitem(sys.modules, "vibro_ros.solver.unit", raising=False)
    settings = dict(os.environ)
    importlib.import_module("vibro_ros.solver.unit")
    assert os.environ == settings


@pytest.mark.process
@pytest.mark.parametrize("text", ["items = [1.0, 2.0]", "print(1.0)"])
def test_a_kernel_that_falls_back_to_python_objects_does_not_build(tmp_path, text):
    unit, fallen = tmp_path / "core.pyx", "cdef double events_last(State state) noexcept nogil:\n"
    output_of("-m", "vibro_ros.solver.unit", str(tmp_path))
    every = re.findall(r"^cdef .*\(.*\).*:$", unit.read_text(), flags=re.M)
    assert len(every) > 130
    assert [line for line in every if not line.endswith("noexcept nogil:") and "address_of" not in line] == []
    unit.write_text(f"{unit.read_text()}\n{fallen}    {text}\n    return 0.0\n")
    done = subprocess.run([sys.executable, "-m", "cython", "-3", "--cplus", str(unit)], capture_output=True, text=True,
                          timeout=PATIENCE)
    assert done.returncode != 0 and "not allowed without gil" in done.stderr, done.stderr


@pytest.mark.skipif(not shutil.which("objdump"), reason="needs objdump of binutils")
@pytest.mark.parametrize("build", BUILDS)
def test_no_product_is_fused_with_a_sum(build):
    """A fused product is rounded once, not twice, and a compiler may choose where to fuse."""
    path = SOLVER / f"{build}{sysconfig.get_config_var('EXT_SUFFIX')}"
    text = subprocess.run(["objdump", "--disassemble", str(path)], capture_output=True, text=True, check=True).stdout
    assert len(re.findall(r"\bv?mulp?[sp]d\b", text)) > 100
    assert re.findall(r"\bv?fn?m(?:add|sub)\w*", text) == []


def test_an_array_that_a_kernel_cannot_read_is_refused():
    import numpy as np

    from vibro_ros.solver.layout import Laid
    from vibro_ros.solver.state import Library
    from vibro_ros.solver.taylor import read_rotor

    with pytest.raises(TypeError, match="Library.free is not what kernels read: a contiguous array of 4 dimensions"):
        Laid(Library(np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2, 2)), np.zeros((2, 24))))
    with pytest.raises(TypeError, match="another type or other dimensions"):
        read_rotor(np.zeros((2, 2), dtype=int), np.zeros(2, dtype=int), np.zeros(3))


@pytest.mark.process
def test_without_compiled_kernels_one_line_says_what_to_do(tmp_path):
    shutil.copytree(ROOT / "vibro_ros", tmp_path / "vibro_ros", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    done = subprocess.run([sys.executable, "-c", "import vibro_ros; vibro_ros.simulate"], capture_output=True,
                          text=True, cwd=tmp_path, timeout=PATIENCE, env={**os.environ, "PYTHONPATH": str(tmp_path)})
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ImportError: vibro_ros.solver.core: the compiled kernels are missing")
    assert "make setup" in last and "apt install g++ python3-dev" in last and "VIBRO_ROS_PLAIN=1" in last


def build(tmp_path: Path, **environment: str) -> subprocess.CompletedProcess:
    """Build the kernels below `tmp_path`."""
    return subprocess.run(
        [sys.executable, "setup.py", "--quiet", "build_ext", "--build-temp", tmp_path, "--build-lib", tmp_path],
        capture_output=True, text=True, cwd=ROOT, timeout=PATIENCE, env={**os.environ, **environment})


@pytest.mark.process
def test_without_a_compiler_the_build_says_what_to_install(tmp_path):
    done = build(tmp_path, CXX="no-such-compiler")
    assert done.returncode != 0
    assert done.stderr == ("error: the kernels need a C++ compiler; Debian, Ubuntu: apt install g++; without root: "
                           "pip install ziglang\n")


@pytest.mark.process
@pytest.mark.parametrize(("compiler", "wanted"), [("no-such-compiler", "['ziglang']"), (sys.executable, "[]")])
def test_pip_brings_a_compiler_where_there_is_none(compiler, wanted):
    program = "from setuptools.build_meta import get_requires_for_build_wheel as wanted; print(wanted())"
    assert output_of("-c", program, CXX=compiler).splitlines()[-1] == wanted


@pytest.mark.process
def test_a_cython_that_cannot_translate_the_kernels_is_refused(tmp_path):
    """Debian 12 has 0.29.32, whose C++ does not compile."""
    Path(tmp_path, "Cython.py").write_text('__version__ = "0.29.32"\n')
    done = build(tmp_path, PYTHONPATH=str(tmp_path))
    assert done.returncode != 0
    assert done.stderr == ("error: the kernels need Cython 3.0.8 or newer, and this Python has 0.29.32; pip install "
                           "--upgrade Cython\n")
