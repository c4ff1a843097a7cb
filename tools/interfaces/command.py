"""`make setup`: build the Python types that PyPI lacks into the environment, with colcon, as a workspace does.

`vibro_ros_interfaces` is an ordinary package in the folder `interfaces`. `tf2_msgs` and `simulation_interfaces` are
packages in the folder `declared`, with only the types that the robot serves. A type's hash does not depend on comments,
so equal hashes show that a declaration agrees with the package's own. The robot runs without these types, so that a
missing or broken compiler is reported in one line and is not a failure.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from vibro_ros.process.entry_point import Parser, exit_code

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (ROOT / "tools" / "interfaces" / "declared", ROOT / "interfaces")
NAMES = "tf2_msgs, simulation_interfaces and vibro_ros_interfaces"
STAMP = "interface_types.done"
"""File in the environment that `make` compares with the sources; written last."""
LOG = "interface_types.log"
"""File in the environment with all that colcon printed when it last failed."""
COMPILERS = ("c++", "g++", "clang++")


class BuildError(RuntimeError):
    """The types cannot be built; the message gives the reason in one line."""


def main(words: Sequence[str]) -> int:
    """Build the types; returns 0 also if there is no working compiler."""
    return exit_code("setup", lambda: _provide(_parser().parse_args(words).prefix))


def _provide(prefix: Path) -> int:
    try:
        require_compiler()
        print(f"setup: building the Python types of {NAMES} (a minute)", flush=True)
        build(prefix)
        (prefix / STAMP).touch()
    except BuildError as error:
        print(f"setup: types of {NAMES} not built: {error}; the robot runs without them", flush=True)
    return 0


def _parser() -> Parser:
    parser = Parser(prog="interface_types", description=__doc__)
    parser.add_argument("--prefix", type=Path, default=Path(sys.prefix), metavar="FOLDER",
                        help="the environment that gets them (default: the one of this Python)")
    return parser


def require_compiler() -> None:
    """Check that cmake will find a C++ compiler and Python's headers.

    Raises
    ------
    BuildError
        When one of them is missing, with the remedy. The environment variables CC and CXX name other compilers.
    """
    if not os.environ.get("CXX") and not any(map(shutil.which, COMPILERS)):
        raise BuildError("no C++ compiler (" + ", ".join(COMPILERS) + "); install g++")
    header = Path(sysconfig.get_paths()["include"], "Python.h")
    if not header.exists():
        raise BuildError(f"{header} is missing; install python3-dev")


def build(prefix: Path) -> None:
    """Build and install all packages; of a package that fails nothing is installed (BuildError)."""
    with TemporaryDirectory(prefix="interface_types_") as folder:
        done = subprocess.run(
            ["colcon", f"--log-base={folder}/log", "build", "--merge-install", f"--install-base={prefix}",
             f"--build-base={folder}/build", "--base-paths", *map(str, FOLDERS), "--cmake-args", *cmake_arguments()],
            env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    log = prefix / LOG
    log.unlink(missing_ok=True)
    if done.returncode:
        log.write_text(done.stdout)
        lines = [line.strip() for line in done.stdout.splitlines() if "error" in line.lower()]
        raise BuildError(f"{lines[0] if lines else f'colcon ended with {done.returncode}'} (all of it in {log})")


def cmake_arguments() -> list[str]:
    """Return the arguments by which cmake builds against the ROS wheels of this Python."""
    repair = Path(__file__).parent / "wheels.cmake"
    return [f"-DPython3_EXECUTABLE={sys.executable}", f"-DCMAKE_PROJECT_INCLUDE={repair}", "-DBUILD_TESTING=OFF",
            "--no-warn-unused-cli"]


def environment() -> dict[str, str]:
    """Return the environment in which colcon and cmake find the ROS wheels of this Python, and no other ROS."""
    hidden = {"PYTHONPATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH"}
    others = {name: value for name, value in os.environ.items() if name not in hidden}
    path = os.pathsep.join([f"{sys.prefix}/bin", os.environ.get("PATH", os.defpath)])
    return others | {"PATH": path, "AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
