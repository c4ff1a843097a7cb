"""The types that `make setup` has built are in the ament index; the tests of `test/ros` use them between processes."""

import sys
from pathlib import Path

import pytest
from ament_index_python import get_package_share_directory, get_resource

from tools.interfaces.command import STAMP
from tools.interfaces.compilation import CompilerError, find_compiler
from tools.interfaces.definitions import interface_packages


@pytest.fixture(scope="module", autouse=True)
def built() -> None:
    """The built types; these tests are skipped only if there is no compiler."""
    try:
        find_compiler()
    except CompilerError as error:
        pytest.skip(str(error))
    assert Path(sys.prefix, STAMP).exists(), "types not built; run make setup"


@pytest.mark.parametrize("package", interface_packages(), ids=lambda package: package.name)
def test_the_ament_index_knows_the_definitions(package, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    listed = get_resource("rosidl_interfaces", package.name)[0].split()
    assert {path for path in listed if not path.endswith(".idl")} == set(package.texts)
    share = Path(get_package_share_directory(package.name))
    for path, text in package.texts.items():
        assert (share / path).read_text() == text
    assert all((share / path).is_file() for path in listed)
