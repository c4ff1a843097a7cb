"""After `make setup`, `ros2 run` and `ros2 pkg` find both packages where ROS looks for them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_prefix, get_package_share_directory

from vibro_ros.process.executables import EXECUTABLES

PREFIX = Path(sys.prefix)
INSTALLED = {name for name, executable in EXECUTABLES.items() if executable.installed}

pytestmark = pytest.mark.skipif(not (PREFIX / "ready.done").exists(), reason="not the .venv of `make setup`")


@pytest.mark.parametrize(("package", "executables", "words"), [
    ("vibro_ros", INSTALLED, ("robot", EXECUTABLES["robot"].does)),
    ("vibro_lab", {"accuracy", "study", "twin"}, ("study", "Study the machine"))])
def test_a_package_is_in_the_index_and_its_executables_start(monkeypatch, package, executables, words):
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(PREFIX))
    assert Path(get_package_prefix(package)) == PREFIX
    share = Path(get_package_share_directory(package))
    assert f"<name>{package}</name>" in (share / "package.xml").read_text()
    assert package != "vibro_ros" or (share / "config" / "robot.yaml").is_file()
    folder = PREFIX / "lib" / package
    assert {file.name for file in folder.iterdir() if os.access(file, os.X_OK)} == executables
    done = subprocess.run([folder / words[0], "--help"], capture_output=True, text=True, timeout=60, check=True)
    assert words[1] in " ".join(done.stdout.split())
