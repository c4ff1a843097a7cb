"""The types that `make setup` and tests have built, as ROS finds them; test/ros talks by them between processes."""

import json
import sys
from pathlib import Path

import pytest
from ament_index_python import get_package_share_directory, get_resource
from official_hashes import OFFICIAL
from simulation_types import require_types

from tools.interfaces.command import FOLDERS, STAMP, BuildError, require_compiler

PACKAGES = sorted(file.parent for folder in FOLDERS for file in folder.glob("*/package.xml"))


@pytest.fixture(scope="module", autouse=True)
def built() -> None:
    """The types; only where there is no compiler are the tests without them."""
    try:
        require_compiler()
    except BuildError as error:
        pytest.skip(str(error))
    assert Path(sys.prefix, STAMP).exists(), "types not built; run make setup"
    require_types()


@pytest.fixture(params=PACKAGES, ids=lambda folder: folder.name)
def package(request, monkeypatch) -> Path:
    """The source of one package, while the ament index knows the environment."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    return request.param


def definitions(package: Path) -> dict[str, str]:
    files = [file for kind in ("msg", "srv", "action") for file in package.glob(f"{kind}/*.{kind}")]
    return {str(file.relative_to(package)): file.read_text() for file in files}


def test_every_definition_is_built(package):
    """A definition that CMakeLists.txt does not list would be missing."""
    listed = set(get_resource("rosidl_interfaces", package.name)[0].split())
    share = Path(get_package_share_directory(package.name))
    assert {path for path in listed if path.endswith((".msg", ".srv", ".action"))} >= set(definitions(package))
    for path, text in definitions(package).items():
        assert (share / path).read_text() == text


def test_hashes_are_the_official_ones(package):
    """By them ROS peers tell whether they mean the same type."""
    share = Path(get_package_share_directory(package.name))
    hashes = {entry["type_name"]: entry["hash_string"] for file in share.glob("*/*.json")
              for entry in json.loads(file.read_text())["type_hashes"]}
    kinds = {f"{package.name}/{path.rpartition('.')[0]}" for path in definitions(package)}
    if package.name == "vibro_ros_interfaces":
        assert kinds <= set(hashes)  # no other package declares these types
    else:
        assert {name: hashes[name] for name in kinds} == {
            name: f"RIHS01_{known}" for name, known in OFFICIAL.items() if name.startswith(package.name)}
