"""The locks pin all direct and indirect requirements of both packages; package.xml names all imported packages."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterable
from importlib.metadata import Distribution, requires
from pathlib import Path

import pytest
from catkin_pkg.package import parse_package
from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).resolve().parents[2]
ROSDEP_KEYS = {"PIL": "python3-pil", "mcap": "mcap-ros2-support", "rosbags": "python3-rosbags-pip",
               "yaml": "python3-yaml",  # not python3-<import>
               "lz4": "python3-rosbags-pip",  # these are brought by others
               "zstandard": "mcap-ros2-support"}
ROSDEP_KEYS |= {name: f"python3-{name}" for name in ("matplotlib", "numpy", "scipy", "tornado", "tqdm")}
OF_A_ROBOT = ("run", "jazzy")
LOCKS = (*OF_A_ROBOT, "lab", "test", "lint", "bench", "browser", "site", "study")
BUILDERS = {"cython", "setuptools"}  # of the kernels
# Of the extra `test`, for `Bag.to_pandas`, and of the lab's extras `study`, `cluster` and `gym`.
NO_ROSDEP_KEY = {"cma", "distributed", "gymnasium", "pandas", "pyarrow"}
PACKAGES = {"vibro_ros": ROOT, "vibro_lab": ROOT / "lab"}


def canonical(name: str) -> str:
    """Return a distribution's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned(locks: Iterable[str]) -> dict[str, Version]:
    """Return the version in some of `LOCKS` of each package that this interpreter needs."""
    text = "\n".join((ROOT / "requirements" / f"{lock}.txt").read_text() for lock in locks)
    lines = [line.partition("#")[0].strip() for line in text.splitlines()]
    wanted = [Requirement(line) for line in lines if line]
    applying = [pin for pin in wanted if pin.marker is None or pin.marker.evaluate()]
    return {canonical(pin.name): Version(str(pin.specifier).removeprefix("==")) for pin in applying}


@pytest.fixture(scope="module")
def declared(tmp_path_factory) -> dict[tuple[str, str], set[Requirement]]:
    """Return what each setup.py requires for this interpreter, by package and extra, which is empty for all users."""
    wanted = {}
    for package, source in PACKAGES.items():
        folder = tmp_path_factory.mktemp("metadata")
        command = [sys.executable, "setup.py", "--quiet", "egg_info", "--egg-base", str(folder)]
        subprocess.run(command, cwd=source, check=True, timeout=60)
        metadata = Distribution.at(folder / f"{package}.egg-info")
        required = {requirement for requirement in map(Requirement, metadata.requires)
                    if canonical(requirement.name) != "vibro-ros"}
        for extra in ("", *metadata.metadata.get_all("Provides-Extra")):
            wanted[package, extra] = {requirement for requirement in required if requirement.marker is None
                                      or requirement.marker.evaluate({"extra": extra})}
    return wanted


def applies(requirement: Requirement) -> bool:
    """Say whether a requirement of an installed package holds for this interpreter, without extras."""
    return requirement.marker is None or requirement.marker.evaluate({"extra": ""})


def needed(declared: Iterable[Requirement], pins: dict[str, Version]) -> set[str]:
    """Return the names of all packages that requirements need, each of which must be pinned."""
    waiting, seen = list(declared), set()
    while waiting:
        wanted = waiting.pop()
        name = canonical(wanted.name)
        assert name in pins, f"{wanted} is not pinned"
        assert wanted.specifier.contains(pins[name]), f"{name}=={pins[name]} is pinned, {wanted} is needed"
        if name not in seen:
            seen.add(name)
            waiting += filter(applies, map(Requirement, requires(name) or []))
    return seen


def test_pins_are_complete(declared):
    assert needed(set().union(*declared.values()), pinned(LOCKS)) >= {"numpy", "pytest", "scipy"}


def test_a_demonstration_installs_what_a_robot_needs_and_nothing_else(declared):
    """Set-up of tests, style, lab and studies is not what a user waits for."""
    pins = pinned(OF_A_ROBOT)
    assert needed(declared["vibro_ros", "ros"], pins) | BUILDERS == set(pins)


def test_the_lab_adds_only_its_own_pins(declared):
    assert needed(declared["vibro_lab", ""], pinned((*OF_A_ROBOT, "lab")))


@pytest.mark.parametrize("name", PACKAGES)
def test_package_xml_is_valid_and_names_what_is_imported(name):
    warnings = []
    package = parse_package(PACKAGES[name] / "package.xml", warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    assert package.package_format == 3
    declared = {dependency.name for dependency in package.exec_depends}
    imported = foreign_imports(PACKAGES[name] / name) - NO_ROSDEP_KEY
    assert {ROSDEP_KEYS.get(name, name) for name in imported} - declared == set()


def foreign_imports(folder: Path) -> set[str]:
    """Return the top-level names of all packages, neither ours nor Python's own, that our modules import."""
    trees = [ast.parse(file.read_text()) for file in folder.rglob("*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and not node.level}
    return {name.split(".")[0] for name in names} - sys.stdlib_module_names - {"compression", *PACKAGES}  # 3.14
