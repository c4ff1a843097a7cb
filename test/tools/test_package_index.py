"""After `make setup`, `ros2 run` and `ros2 pkg` find the package where ROS looks for it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from vibro_ros.process.executables import EXECUTABLES

PREFIX = Path(sys.prefix)
INSTALLED = {name for name, one in EXECUTABLES.items() if one.installed}

pytestmark = pytest.mark.skipif(not (PREFIX / "ready.done").exists(), reason="not the .venv of `make setup`")


@pytest.fixture(autouse=True)
def index(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(PREFIX))


def test_the_package_is_in_the_index_with_its_share_folder():
    assert Path(get_package_prefix("vibro_ros")) == PREFIX
    share = Path(get_package_share_directory("vibro_ros"))
    assert "<name>vibro_ros</name>" in (share / "package.xml").read_text()
    assert (share / "config" / "robot.yaml").is_file()


def test_the_lab_is_in_the_index_and_its_executables_where_ros2_run_looks():
    assert Path(get_package_prefix("vibro_lab")) == PREFIX
    assert "<name>vibro_lab</name>" in Path(get_package_share_directory("vibro_lab"), "package.xml").read_text()
    folder = PREFIX / "lib" / "vibro_lab"
    assert {file.name for file in folder.iterdir()} == {"accuracy", "study", "twin"}
    said = subprocess.run([folder / "study", "--help"], capture_output=True, text=True, timeout=60, check=True).stdout
    assert "Study the machine" in said


def test_every_executable_lies_where_ros2_run_looks_and_starts():
    folder = Path(get_package_prefix("vibro_ros")) / "lib" / "vibro_ros"
    found = {file.name for file in folder.iterdir() if os.access(file, os.X_OK)}
    assert found == INSTALLED
    said = subprocess.run([folder / "robot", "--help"], capture_output=True, text=True, timeout=60, check=True).stdout
    assert EXECUTABLES["robot"].does in " ".join(said.split())
