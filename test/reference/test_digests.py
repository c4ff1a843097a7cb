"""Results have the bits of `digests.json` on any x86-64 computer: with other libraries, processors, and uncompiled."""

import ast
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import digests
import pytest

import vibro_ros
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings.comparison import compare
from vibro_ros.solver import core, typed

EXPECTED = json.loads(digests.FILE.read_text())
# What decides the bits of libraries: the kernels of BLAS and LAPACK, the functions of the C library, and numpy's loops.
# A name that a library does not know changes nothing.
WITHOUT_AVX2 = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
                "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"}
SETTINGS = {"oldest": {"OPENBLAS_CORETYPE": "Prescott", **WITHOUT_AVX2},
            "zen": {"OPENBLAS_CORETYPE": "Zen", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-FMA"},
            "haswell": {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"}}
# Of the reference, all tables, and runs of every method, sensor and kind of message.
IN_CHILDREN = ["tables/", "scene/device/", "scene/machine/", "effect/Stribeck/", "effect/rigid plates/",
               "command/state/", "sensors/", "messages/", "recording/", "random/1"]
UNCOMPILED = ["tables/", "sensors/device/bmi270", "scene/damped/exact", "scene/device/exact", "scene/machine/exact",
              "command/gaps/damped/rk4", "command/gaps/damped/rk4_located"]
BUILDS = [*Path(core.__file__).parent.glob("core*.so")]
ONLY_PORTABLE = """
import runpy, sys
from vibro_ros.solver import core
sys.modules["vibro_ros.solver.core_v3"] = core
from vibro_ros.solver import typed
assert typed._core is core
runpy.run_path(sys.argv[1], run_name="__main__")
"""
REPLAY = """
import sys
from vibro_ros.bag.stream import BagStream
from vibro_ros.recordings.comparison import compare
with BagStream(sys.argv[1]) as stream:
    print(compare(stream).difference)
"""


def output_in_child(arguments: list[str], settings: dict[str, str]) -> str:
    """Return what a Python process with these environment variables prints."""
    return subprocess.run([sys.executable, *arguments], env={**os.environ, **settings}, capture_output=True, text=True,
                          check=True).stdout


def of_reference(chosen: list[str]) -> dict[str, str]:
    return {name: value for name, value in EXPECTED.items() if name.startswith(tuple(chosen))}


def test_the_reference_has_the_cases_of_its_command():
    assert list(EXPECTED) == list(digests.cases()) and len(EXPECTED) > 200


@pytest.mark.parametrize("kind", sorted({name.partition("/")[0] for name in EXPECTED}))
def test_results_have_the_bits_of_the_reference(kind: str):
    assert digests.digests([f"{kind}/"]) == of_reference([f"{kind}/"])


@pytest.mark.process
@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_libraries_of_another_processor_change_no_bit(settings: dict[str, str]):
    output = output_in_child([digests.__file__, *IN_CHILDREN], settings)
    assert json.loads(output) == of_reference(IN_CHILDREN)


@pytest.mark.process
def test_a_recording_replays_with_the_libraries_of_another_processor(tmp_path):
    scene = vibro_ros.load_scene("machine").with_parameters(digests.SENSORS | digests.CURRENT)
    bag = digests.record(tmp_path / "bag", scene)
    with BagStream(bag) as stream:
        assert sum(compare(stream).compared.values()) > 1000
    assert output_in_child(["-c", REPLAY, str(bag)], SETTINGS["oldest"]) == "None\n"


@pytest.mark.process
def test_plain_python_has_the_bits_of_the_kernels():
    output = output_in_child([digests.__file__, *UNCOMPILED], {"VIBRO_ROS_PLAIN": "1"})
    assert json.loads(output) == of_reference(UNCOMPILED)


@pytest.mark.process
@pytest.mark.skipif(len(BUILDS) < 2, reason="there is one build for this kind of processor")
def test_the_build_for_older_processors_has_the_bits_of_the_other_one():
    assert typed._core is not core, "this processor cannot run the second build"
    output = output_in_child(["-c", ONLY_PORTABLE, digests.__file__, *IN_CHILDREN], {})
    assert json.loads(output) == of_reference(IN_CHILDREN)


# Functions of the C library, of loops of numpy, of BLAS and of LAPACK, whose bits differ by processor; sums of arrays
# are among them. `np.cumsum` is not, because it adds one number after the other.
METHODS = {"sum", "mean", "std", "var", "prod", "dot"}
ROUNDED_BY_LIBRARIES = {
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
    "arcsin", "arccos", "arctan", "arctan2", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow",
    "power", "float_power", "hypot", "cbrt", "dist", "sumprod", "sum", "mean", "average", "std", "var", "prod",
    "dot", "vdot", "inner", "matmul", "einsum", "tensordot", "linalg", "polynomial", "interp", "convolve"}


def library_roundings(tree: ast.AST) -> Iterator[str]:
    """Yield what a module takes from a library whose bits differ by processor."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and (node.attr in METHODS or (
                node.attr in ROUNDED_BY_LIBRARIES and ast.unparse(node.value) in ("math", "np"))):
            yield ast.unparse(node)
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield ast.unparse(node)
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            if not (isinstance(node.left, ast.Constant) and isinstance(ast.literal_eval(node.right), int)):
                yield ast.unparse(node)
        elif isinstance(node, ast.Import | ast.ImportFrom) and "scipy" in ast.unparse(node):
            yield ast.unparse(node)


@pytest.mark.parametrize("room", ["model", "solver", "sensors", "simulation", "messages"])
def test_no_number_of_a_run_is_rounded_by_a_library(room: str):
    """Except the limits by which parameters are refused, which enter no result."""
    for module in sorted((Path(vibro_ros.__file__).parent / room).glob("*.py")):
        if module.stem != "parameter_checks":
            assert not list(library_roundings(ast.parse(module.read_text(encoding="utf-8")))), module
