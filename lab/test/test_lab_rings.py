"""The lab imports the public interface of `vibro_ros` and nothing below it, and its rooms each other as drawn."""

import ast
import subprocess
import sys

import pytest
from reading_imports import ROOT, cycle, drawn_arrows, imported, sources_in, summaries, told_rooms

import vibro_ros
import vibro_ros.ros
from vibro_lab.study.command import STUDIES

PACKAGE, DEVICE = "vibro_lab", "vibro_ros"
LAB = ROOT / "lab"
CLIENTS = ("vibro_lab", "research", "benchmark")
PUBLIC = {DEVICE, "vibro_ros.ros", *(f"vibro_ros.{name}" for name in (*vibro_ros.__all__, "__version__", "__file__")),
          *(f"vibro_ros.ros.{name}" for name in vibro_ros.ros.__all__)}
MAY_IMPORT = drawn_arrows("within the lab", PACKAGE)
ROS = {"twin"}  # the room whose node imports rclpy


def names_taken(module: str, source: str) -> set[str]:
    """Return the dotted names of `vibro_ros` that a module imports, or takes from the imported package."""
    taken = {name for name in imported(module, source) if name.partition(".")[0] == DEVICE}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in {DEVICE, "vibro_ros.ros"}:
            taken.add(ast.unparse(node))
    return taken


def private_names(module: str, source: str) -> list[str]:
    """Return the names below the public interface that a module takes."""
    return sorted(name for name in names_taken(module, source) if name not in PUBLIC)


def part_of(name: str) -> str | None:
    """Return the room that an imported name belongs to; "" for `vibro_lab` itself, None for `numpy`."""
    words = name.split(".")
    if words[0] == DEVICE:
        return DEVICE
    if words[0] != PACKAGE:
        return None
    return words[1] if len(words) > 1 and words[1] in MAY_IMPORT else ""


def room_of(module: str) -> str:
    """Return the room of a module by its dotted name; "" for those of the package itself."""
    return ".".join(module.split(".")[1:-1][:1])


@pytest.fixture(scope="module")
def sources() -> dict[str, str]:
    """Return the source of every module of the lab, of the research and of the benchmark."""
    return {module: source for client in CLIENTS for module, source in sources_in(LAB / client).items()}


def test_clients_import_public_names_alone(sources):
    assert all(sum(module.startswith(client) for module in sources) > 5 for client in CLIENTS)
    assert {module: names for module, source in sources.items() if (names := private_names(module, source))} == {}


@pytest.mark.parametrize("source", [
    "from vibro_ros.model.scene import Scene", "import vibro_ros.model", "import vibro_ros\nvibro_ros.model",
    "from vibro_ros import model", "def f():\n    from vibro_ros.ros.node import qos", "import vibro_ros.ros.robot"])
def test_a_private_name_is_seen(source):
    assert private_names("vibro_lab.study.sweep", source)


#: Names that version 2 of the device has promised to users; the lab no longer takes them.
PROMISED = {"vibro_ros.find_file", "vibro_ros.read_yaml"}


def test_every_public_name_beyond_the_basic_ones_has_a_client(sources):
    """What nobody outside takes need not be public."""
    taken = {name for module, source in sources.items() for name in names_taken(module, source)}
    assert {name for name in PUBLIC - taken if "__" not in name} <= {DEVICE, "vibro_ros.ros"} | PROMISED


def test_arrows_are_those_that_are_drawn(sources):
    used = {room: set() for room in MAY_IMPORT}
    for module, source in sources.items():
        if module.startswith(PACKAGE):
            used[room_of(module)] |= {part_of(name) for name in imported(module, source)} - {None, room_of(module)}
    assert used == MAY_IMPORT


def test_rooms_are_told_in_the_words_of_the_rooms():
    documented = told_rooms("## The lab")
    assert documented == summaries(LAB / PACKAGE)
    assert list(documented) == [room for room in MAY_IMPORT if room not in ("", DEVICE)]


def test_only_the_twin_imports_ros(sources):
    for module, source in sources.items():
        tops = {name.partition(".")[0] for name in imported(module, source)}
        assert room_of(module) in ROS or not any(top == "rclpy" or top.endswith("_msgs") for top in tops), module


def test_no_cycle_among_modules(sources):
    assert cycle(sources) == []


def test_no_study_imports_another_one(sources):
    assert len(STUDIES) > 3
    for study in STUDIES:
        module = f"{PACKAGE}.study.{study}"
        others = {name.split(".")[2] for name in imported(module, sources[module])
                  if name.startswith(f"{PACKAGE}.study.")}
        assert not others & STUDIES.keys() - {study}, module


def test_importing_the_package_leaves_rclpy_alone():
    program = ("import sys, vibro_lab; [getattr(vibro_lab, name) for name in vibro_lab.__all__]; "
               "sys.exit('rclpy' in sys.modules)")
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=60).returncode == 0
