"""The definitions from which types are built: type hashes, by which ROS peers check that their types are equal."""

import json
import re
import sys
from pathlib import Path

import pytest
from official_hashes import OFFICIAL

from tools.interfaces.definitions import DECLARED, OWN, InterfacePackage, fingerprint, interface_packages
from tools.interfaces.generation import Sources


@pytest.fixture(scope="module", params=interface_packages(), ids=lambda package: package.name)
def package(request) -> InterfacePackage:
    return request.param


@pytest.fixture(scope="module")
def described(package, tmp_path_factory) -> dict[str, str]:
    """Return hashes by type, as the wheels' generator computes them."""
    folder = tmp_path_factory.mktemp(package.name)
    sources = Sources(package, folder, Path(sys.prefix))
    sources.describe()
    files = [json.loads(file.read_text()) for file in sources.share.glob("*/*.json")]
    return {one["type_name"]: one["hash_string"] for file in files for one in file["type_hashes"]}


def test_hashes_are_the_official_ones(package, described):
    kinds = {f"{package.name}/{path.rpartition('.')[0]}" for path in package.texts}
    if package.name == "vibro_ros_interfaces":
        pytest.skip("no other package declares these types")
    assert kinds == {name for name in OFFICIAL if name.startswith(package.name)}
    assert {name: described[name] for name in kinds} == {name: f"RIHS01_{OFFICIAL[name]}" for name in kinds}


def test_every_declared_file_is_used():
    files = {str(file.relative_to(DECLARED)) for file in DECLARED.rglob("*") if file.is_file()}
    assert files == {f"{package.name}/{path}" for package in interface_packages() for path in package.texts
                     if package.name == "simulation_interfaces"}


def test_the_fingerprint_changes_with_a_definition():
    _, simulation_interfaces, _ = packages = interface_packages()
    before = fingerprint(packages)
    assert before == fingerprint(interface_packages())
    simulation_interfaces.texts["msg/Result.msg"] += "string more\n"
    assert before != fingerprint(packages)


def test_colcon_builds_the_types_that_controller_and_robot_serve():
    folder = OWN / "vibro_ros_interfaces"
    (own,) = [package for package in interface_packages() if package.name == folder.name]
    listed = re.findall(r'"(.+\.(?:action|srv))"', (folder / "CMakeLists.txt").read_text())
    assert sorted(listed) == sorted(own.texts)
    assert {"action/GoTo.action", "srv/InjectFault.srv"} < set(listed)
