"""The rings hold: model, solver <- simulator, bag <- ros, study; no arrow outwards, no cycle, rclpy in `ros` alone."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "vibro_ros"
RINGS = {"model": 0, "solver": 0, "": 1, "bag": 1, "ros": 2, "study": 2}  # folder: ring; "": modules beside the folders
STRANGERS = {("ros", "study"), ("study", "ros"), ("solver", "model")}  # (importer, imported) that the rings would allow
OUTSIDE_WORLD = {"datetime", "io", "logging", "os", "pathlib", "shutil", "socket", "subprocess", "sys", "tempfile"}
OUTSIDE_WORLD |= {"threading", "time", "yaml", "matplotlib", "rosbags"}  # files, clocks, logs: not for the physics
FILE_AND_SCREEN = {"open", "print", "input"}
# Compiled kernels are kept in files.
EXEMPT = {("vibro_ros.solver.compilation", "os"), ("vibro_ros.solver.compilation", "pathlib.Path"),
          ("vibro_ros.solver.kernel_cache", "pathlib.Path")}


def imported(module: str, source: str) -> Iterator[str]:
    """Yield the dotted name of everything that a module's source imports, at any depth of the text."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = module.split(".")[: -node.level] if node.level else []
            origin = ".".join([*parents, *filter(None, [node.module])])
            yield from (f"{origin}.{name.name}" for name in node.names)


def part_of(name: str) -> str | None:
    """Return the folder that an imported name belongs to: "" for `vibro_ros.simulator`, None for `numpy`."""
    words = name.split(".")
    if words[0] != PACKAGE:
        return None
    return words[1] if len(words) > 1 and words[1] in RINGS else ""


def violations(module: str, source: str) -> list[str]:
    """Return a sentence for each arrow in `source` that points out of its ring.

    Parameters
    ----------
    module : str
        Dotted name of the module that the source is of; a package's `__init__` ends in `.__init__`.
    source : str
        Python text.
    """
    part = ".".join(module.split(".")[1:-1][:1])
    if part not in RINGS:
        return [f"{module}: say in RINGS which ring {part!r} belongs to"]
    found = [f"{module} imports {name}" for name in imported(module, source)
             if not _may_import(part, name) and (module, name) not in EXEMPT]
    if RINGS[part] == 0:
        calls = [node.func.id for node in ast.walk(ast.parse(source)) if _is_call(node)]
        found += [f"{module} calls {name}()" for name in calls if name in FILE_AND_SCREEN]
    return found


def _may_import(part: str, name: str) -> bool:
    """Say whether a folder of the package may import a dotted name."""
    other = part_of(name)
    if other is not None:
        return RINGS[other] <= RINGS[part] and (part, other) not in STRANGERS
    top = name.split(".")[0]
    needs_ros = top in {"rclpy", "ament_index_python"} or top.endswith(("_msgs", "_interfaces", "_srvs"))
    return (part == "ros" or not needs_ros) and (RINGS[part] > 0 or top not in OUTSIDE_WORLD)


def _is_call(node: ast.AST) -> bool:
    """Say whether a node calls a plain name."""
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name)


def cycle(sources: dict[str, str]) -> list[str]:
    """Return the modules of one import cycle among {dotted name: source}, empty when there is none."""
    names = {module.removesuffix(".__init__"): set(imported(module, source)) for module, source in sources.items()}
    graph = {module: {_owner(name, names) for name in wanted} - {module, None} for module, wanted in names.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def _owner(name: str, modules: dict[str, set[str]]) -> str | None:
    """Return the module that an imported name is or lives in."""
    return name if name in modules else next(iter({name.rpartition(".")[0]} & modules.keys()), None)


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """Return the source of every module of the package by its dotted name."""
    files = sorted((ROOT / PACKAGE).rglob("*.py"))
    return {".".join(file.relative_to(ROOT).with_suffix("").parts): file.read_text() for file in files}


def test_every_module_keeps_to_its_ring(sources):
    assert len(sources) > 1
    assert [line for module, source in sources.items() for line in violations(module, source)] == []


def test_no_cycle_among_modules(sources):
    assert cycle(sources) == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("vibro_ros.model.contact", "import rclpy"),
        ("vibro_ros.model.contact", "def read():\n    import yaml"),
        ("vibro_ros.model.scene", "from pathlib import Path"),
        ("vibro_ros.model.scene", "text = open('scene.yaml').read()"),
        ("vibro_ros.solver.loop", "from time import monotonic"),
        ("vibro_ros.solver.loop", "from vibro_ros.simulator import Simulator"),
        ("vibro_ros.solver.loop", "from vibro_ros.model.scene import Scene"),
        ("vibro_ros.solver.loop", "from ..simulator import Simulator"),
        ("vibro_ros.solver.__init__", "from ..scene_file import load_scene"),
        ("vibro_ros.model.scene", "from vibro_ros import load_scene"),
        ("vibro_ros.simulator", "from vibro_ros.ros import robot"),
        ("vibro_ros.bag.recorder", "from rclpy.node import Node"),
        ("vibro_ros.bag.reader", "from std_msgs.msg import Float64"),
        ("vibro_ros.study.report", "import rclpy.serialization"),
        ("vibro_ros.study.report", "from vibro_ros.ros.robot import main"),
        ("vibro_ros.ros.robot", "from vibro_ros.study import report"),
        ("vibro_ros.__init__", "from vibro_ros.ros.robot import main"),
        ("vibro_ros.utils.text", "import math"),
    ],
)
def test_a_broken_ring_is_seen(module, source):
    assert len(violations(module, source)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("vibro_ros.model.scene", "import numpy\nfrom vibro_ros.solver.flow import Flow\nfrom . import parameters"),
        ("vibro_ros.ros.robot", "import rclpy, time\nfrom vibro_ros import Scene\nfrom vibro_ros.bag import reader"),
        ("vibro_ros.study.report", "from pathlib import Path\nimport vibro_ros\nprint(vibro_ros)"),
    ],
)
def test_an_arrow_inwards_is_allowed(module, source):
    assert violations(module, source) == []


def test_a_cycle_is_seen():
    sources = {
        "vibro_ros.__init__": "from vibro_ros.simulator import Simulator",
        "vibro_ros.simulator": "from vibro_ros.model import scene",
        "vibro_ros.model.__init__": "",
        "vibro_ros.model.scene": "from ..simulator import Simulator",
    }
    assert set(cycle(sources)) == {"vibro_ros.simulator", "vibro_ros.model.scene"}


def test_importing_the_package_leaves_rclpy_alone():
    program = "import sys, vibro_ros; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=60).returncode == 0
