"""Both kinds of installation from a copy of the sources: a colcon workspace with both packages, and a wheel."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import EntryPoint, distributions
from pathlib import Path

import pytest
from ament_index_python import get_package_prefix
from ament_index_python.packages import get_package_share_directory

from tools.interfaces.command import cmake_arguments, environment
from vibro_ros.process.executables import EXECUTABLES

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("LICENSE", "README.md", "config", "examples", "interfaces", "package.xml", "pyproject.toml",
           "resource", "setup.cfg", "setup.py", "vibro_ros",
           *(f"lab/{name}" for name in ("package.xml", "resource", "setup.cfg", "setup.py", "vibro_lab")))
CONFIG = sorted(file.relative_to(ROOT) for file in (ROOT / "config").rglob("*") if file.is_file())
DEADLINE = 300.0  # [s] for one build; the workspace takes a minute on an idle machine, the wheel a few seconds


@dataclass(frozen=True)
class Installation:
    """One installed copy: its prefix, where its executables are, and the shell line that makes it known."""

    prefix: Path
    executables: Path
    activation: str

    @property
    def entry_points(self) -> list[EntryPoint]:
        """The console scripts that the installed metadata declares."""
        folders = {str(file.parent) for file in self.prefix.glob("**/*-packages/vibro_ros")}
        named = [package for package in distributions(path=list(folders))
                 if package.name.replace("-", "_") == "vibro_ros"]
        return list(named[0].entry_points.select(group="console_scripts"))

    def run(self, command: str, folder: Path) -> str:
        """Run a shell command as a user of this installation, and return what it prints."""
        return run(["bash", "-c", f"{self.activation} && {command}"], folder)


def run(command: list[str], folder: Path, variables: dict[str, str] | None = None) -> str:
    """Run a command that knows nothing of the checkout, and return what it prints; fail with all of it."""
    hidden = {"PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"}
    known = {name: value for name, value in os.environ.items() if name not in hidden} | (variables or {})
    done = subprocess.run(command, cwd=folder, env=known, capture_output=True, text=True, timeout=DEADLINE)
    assert done.returncode == 0, f"{command} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    """Copy the files that are installed, so that no build folder appears in the checkout."""
    copy = tmp_path_factory.mktemp("workspace") / "src" / "vibro_ros"
    copy.mkdir(parents=True)
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            (copy / name).parent.mkdir(exist_ok=True)
            shutil.copy(ROOT / name, copy / name)
    return copy


@pytest.fixture(scope="module")
def colcon(source) -> Installation:
    """Build all three packages in a colcon workspace, with the command of docs/guide/begin.md."""
    workspace = source.parents[1]
    wheels = ["--cmake-args", *cmake_arguments()]  # a sourced ROS 2 needs none of these
    run(["colcon", "build", "--base-paths", "src", "src/vibro_ros/interfaces", "src/vibro_ros/lab", "--executor",
         "sequential", *wheels], workspace, environment())
    prefix = workspace / "install" / "vibro_ros"
    return Installation(prefix, prefix / "lib" / "vibro_ros", f"source {workspace}/install/local_setup.bash")


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory) -> Installation:
    """Build an sdist, of it a wheel, and install the wheel below a prefix of its own."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-index"]
    run([sys.executable, "setup.py", "--quiet", "sdist", "--dist-dir", str(folder)], source)
    (sdist,) = folder.glob("*.tar.gz")
    run([*pip, "wheel", *offline, "--no-build-isolation", "--use-pep517", "--wheel-dir", ".", str(sdist)], folder)
    (built,) = folder.glob("*.whl")
    run([*pip, "install", *offline, "--ignore-installed", "--prefix", str(folder / "prefix"), str(built)], folder)
    (executables,) = (folder / "prefix").glob("**/bin")  # Debian's pip puts `local/` before it
    (packages,) = (folder / "prefix").glob("**/*-packages")
    return Installation(executables.parent, executables, f"export PYTHONPATH={packages}")


@pytest.fixture(params=["colcon", "wheel"])
def installation(request) -> Installation:
    """Give each of the two installations in turn."""
    return request.getfixturevalue(request.param)


def test_a_workspace_has_the_types_of_the_interfaces(colcon, tmp_path):
    """Python finds those of the workspace, and its middleware can describe them to peers."""
    program = "; ".join([
        "import vibro_ros_interfaces", "from rclpy.type_support import check_for_type_support as check",
        "from vibro_ros_interfaces.srv import Push",
        "check(Push)", "print(vibro_ros_interfaces.__file__)"])
    printed = colcon.run(f'"{sys.executable}" -c "{program}"', tmp_path)
    assert Path(printed.strip()).is_relative_to(colcon.prefix.parent / "vibro_ros_interfaces")


def test_ros2_launch_finds_the_files_of_a_checkout(tmp_path):
    """`ros2 launch` searches the share folder with `os.walk`, which follows no link to a folder."""
    recipe = ["make", "--eval", "linked: ; @$(call LINK_PACKAGE,vibro_ros,.)", f"VENV={tmp_path}",
              f"BIN={Path(sys.executable).parent}"]
    run([*recipe, "linked"], ROOT)
    linked = {name for _, _, names in os.walk(tmp_path / "share" / "vibro_ros") for name in names}
    assert linked >= {file.name for file in (ROOT / "examples" / "launch").glob("*.py")}


def test_a_workspace_has_the_lab_beside_the_device(colcon, tmp_path):
    """`ros2 run vibro_lab study` looks for the executable in the prefix that the index knows for the package."""
    program = ("from ament_index_python import get_package_prefix as find; print(find('vibro_lab')); "
               "import vibro_lab, vibro_ros; print(vibro_lab.__file__, vibro_ros.__file__)")
    prefix, *packages = colcon.run(f'"{sys.executable}" -c "{program}"', tmp_path).split()
    assert all(Path(package).is_relative_to(colcon.prefix.parent) for package in (prefix, *packages))
    assert {file.name for file in Path(prefix, "lib", "vibro_lab").iterdir()} == {"accuracy", "study", "twin"}
    output = colcon.run(f"{prefix}/lib/vibro_lab/study --help", tmp_path)
    assert "Study the machine" in output


def test_executables_and_package_are_installed_and_found(installation, monkeypatch):
    assert {entry.name for entry in installation.entry_points} == {
        name for name, executable in EXECUTABLES.items() if executable.installed}
    for entry in installation.entry_points:
        assert os.access(installation.executables / entry.name, os.X_OK), entry.name
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(installation.prefix))
    assert get_package_prefix("vibro_ros") == str(installation.prefix)
    share = Path(get_package_share_directory("vibro_ros"))
    assert (share / "package.xml").read_bytes() == (ROOT / "package.xml").read_bytes()


def test_configuration_is_installed_and_found(installation, tmp_path):
    share = installation.prefix / "share" / "vibro_ros"
    assert CONFIG
    for file in CONFIG:
        assert (share / file).read_bytes() == (ROOT / file).read_bytes()
    assert {file.name for file in (share / "launch").glob("*.py")} == {
        file.name for file in (ROOT / "examples" / "launch").glob("*.py")}
    program = "from vibro_ros.configuration.scene_file import config_folder; print(config_folder())"
    printed = installation.run(f'"{sys.executable}" -c "{program}"', tmp_path)
    assert Path(printed.strip()) == share / "config"


def test_type_checkers_see_its_types_and_tests_are_not_shipped(wheel):
    (packages,) = wheel.prefix.glob("**/*-packages")
    assert (packages / "vibro_ros" / "py.typed").is_file() and not (packages / "test").exists()
