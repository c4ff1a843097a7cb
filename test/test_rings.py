"""Imports between rooms are those that docs/architecture.md draws: inwards, without a cycle, and rclpy in `ros` alone.
"""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from reading_imports import ROOT, cycle, drawn_arrows, imported, sources_in, summaries, told_rooms

import vibro_ros
import vibro_ros.ros

PACKAGE = "vibro_ros"
PURE = ("solver", "model")  # physics: no file, no clock, no screen
OUTSIDE_WORLD = {"datetime", "io", "logging", "os", "pathlib", "shutil", "socket", "subprocess", "sys", "tempfile"}
OUTSIDE_WORLD |= {"threading", "time", "yaml", "matplotlib", "rosbags"}  # files, clocks, logs: not for the physics
FILE_AND_SCREEN = {"open", "print", "input"}
# The builder of the kernels writes files, and a variable of the environment says whether the kernels run uncompiled.
EXEMPT = {("vibro_ros.solver.typed", "os"),
          *(("vibro_ros.solver.unit", name) for name in ("os", "pathlib.Path", "sys"))}


MAY_IMPORT = drawn_arrows("imports", PACKAGE)
WITHIN_ROS = drawn_arrows("within ros", PACKAGE)


def part_of(name: str) -> str | None:
    """Return the room that an imported name belongs to: "" for `vibro_ros.simulate`, None for `numpy`."""
    words = name.split(".")
    if words[0] != PACKAGE:
        return None
    return words[1] if len(words) > 1 and words[1] in MAY_IMPORT else ""


def room_of(module: str) -> str:
    """Return the room of a module by its dotted name; "" for the package's own `__init__`."""
    return ".".join(module.split(".")[1:-1][:1])


def violations(module: str, source: str) -> list[str]:
    """Return a sentence for each import in `source` that its room must not make.

    Parameters
    ----------
    module : str
        Dotted name of the module that the source is of; a package's `__init__` ends in `.__init__`.
    source : str
        Python text.
    """
    part = room_of(module)
    if part not in MAY_IMPORT:
        return [f"{module}: draw in docs/architecture.md what the room {part!r} imports"]
    complaints = [f"{module} imports {name}" for name in imported(module, source)
             if not _may_import(part, name) and (module, name) not in EXEMPT]
    if part in PURE:
        calls = [node.func.id for node in ast.walk(ast.parse(source)) if _is_call(node)]
        complaints += [f"{module} calls {name}()" for name in calls if name in FILE_AND_SCREEN]
    return complaints


def _may_import(part: str, name: str) -> bool:
    """Say whether a folder of the package may import a dotted name."""
    other = part_of(name)
    if other is not None:
        return other == part or other in MAY_IMPORT[part]
    top = name.split(".")[0]
    if top in {"vibro_lab", "tools", "research", "benchmark"}:  # stand beside the package
        return False
    needs_ros = top in {"rclpy", "ament_index_python"} or top.endswith(("_msgs", "_interfaces", "_srvs"))
    return (part == "ros" or not needs_ros) and (part not in PURE or top not in OUTSIDE_WORLD)


def _is_call(node: ast.AST) -> bool:
    """Say whether a node calls a plain name."""
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name)


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """Return the source of every module of the package by its dotted name."""
    return sources_in(ROOT / PACKAGE)


def test_every_module_keeps_to_its_ring(sources):
    assert len(sources) > 1
    assert [line for module, source in sources.items() for line in violations(module, source)] == []


def test_every_arrow_that_is_drawn_is_used(sources):
    used = {room: set() for room in MAY_IMPORT}
    for module, source in sources.items():
        used[room_of(module)] |= {part_of(name) for name in imported(module, source)} - {None, room_of(module)}
    assert used == MAY_IMPORT


def test_arrows_within_ros_are_those_that_are_drawn(sources):
    used = {room: set() for room in WITHIN_ROS}
    for module, source in sources.items():
        if (room := ".".join(module.split(".")[1:3])) in used:
            rooms = {".".join(name.split(".")[1:3]) for name in imported(module, source)}
            used[room] |= rooms & used.keys() - {room}
    assert used == WITHIN_ROS
    assert set(used) == {f"ros.{file.parent.name}" for file in (ROOT / PACKAGE / "ros").glob("*/__init__.py")}


@pytest.mark.parametrize("page", ["architecture.md", "solver.md"])
def test_places_in_the_code_exist(page):
    """Each path in backticks is a file, and the name after its colon is defined there."""
    tokens = re.findall(r"`([\w/]+\.(?:py|js))(?::([\w.]+))?`", (ROOT / "docs" / page).read_text(encoding="utf-8"))
    assert len(tokens) > 10
    for path, name in tokens:
        roots = (ROOT / PACKAGE, ROOT / "lab" / "vibro_lab", ROOT)
        file = next((root / path for root in roots if (root / path).is_file()), None)
        assert file, f"{page}: {path} does not exist"
        text = file.read_text(encoding="utf-8")
        for word in filter(None, name.split(".")):
            assert re.search(rf"^\s*(?:async def|def|class) {word}\b|^\s*(?:self\.)?{word}\b[^=\n]*=|^\s*{word}:", text,
                             re.MULTILINE), f"{page}: {path} defines no {word}"


def test_rooms_are_told_in_the_words_of_the_rooms():
    documented = told_rooms("## Rooms")
    assert documented == summaries(ROOT / PACKAGE)
    assert list(documented) == [room for room in MAY_IMPORT if room]


def test_no_cycle_among_modules(sources):
    assert cycle(sources) == []


def test_importing_the_package_leaves_rclpy_alone():
    program = "import sys, vibro_ros; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=60).returncode == 0


@pytest.mark.parametrize("package", [vibro_ros, vibro_ros.ros])
def test_the_public_names_are_written_down_alike_for_programs_and_for_type_checkers(package):
    text = Path(package.__file__).read_text(encoding="utf-8")
    documented = {name.asname or name.name: f"{node.module}:{name.name}" for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.ImportFrom) and node.module != "importlib" for name in node.names}
    assert sorted(package.__all__) == sorted(package._HOMES) == sorted(documented)
    for name, home in documented.items():
        module, _, inner = home.partition(":")
        assert getattr(package, name) is getattr(sys.modules[module], inner), name


@pytest.mark.parametrize(("name", "words"), [
    *((name, f"is vibro_lab.{name} since version 2.0.0; ") for name in (
        "attractors", "find_orbit", "identify", "settled_motion")),
    ("follow_bifurcation", "is gone since version 2.0.0; .*vibro_lab.follow_orbit at several"),
    ("zero_one_test", "is gone since version 2.0.0; .*vibro_lab.lyapunov_spectrum tells")])
def test_a_name_that_went_to_the_lab_or_is_gone_says_what_takes_its_place(name, words):
    with pytest.raises(AttributeError, match=rf"^vibro_ros\.{name} {words}"):
        getattr(vibro_ros, name)
