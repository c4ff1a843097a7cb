"""`make setup`: build the Python types that PyPI lacks into the environment, by cmake.

`vibro_ros_interfaces` is an ordinary package in the folder `interfaces`. `tf2_msgs` and `simulation_interfaces` are
packages in the folder `declared`, with only the types that the robot serves. A type's hash does not depend on comments,
so equal hashes show that a declaration agrees with the package's own. The robot runs without these types, so that a
missing or broken compiler is reported in one line and is not a failure. `make setup` builds what a robot publishes and
serves everywhere, `PACKAGES`; tests of `simulation_interfaces` build that package when they need it.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from argparse import Namespace
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

from vibro_ros.process.entry_point import Parser, exit_code

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (ROOT / "tools" / "interfaces" / "declared", ROOT / "interfaces")
PACKAGES = ("tf2_msgs", "vibro_ros_interfaces")
"""The packages that `make setup` builds."""
STAMP = "interface_types.done"
"""File in the environment that `make` compares with the sources; written last."""
LOG = "interface_types.log"
"""File in the environment with all that was printed by the last build that failed."""
COMPILERS = ("c++", "g++", "clang++")


class BuildError(RuntimeError):
    """The types cannot be built; the message gives the reason in one line."""


def main(words: Sequence[str]) -> int:
    """Build the types; returns 0 also if there is no working compiler."""
    return exit_code("setup", lambda: _provide(_parser().parse_args(words)))


def _provide(options: Namespace) -> int:
    names = " and ".join(options.packages)
    try:
        require_compiler()
        print(f"setup: building the Python types of {names} (a minute on two cores)", flush=True)
        build(options.prefix, options.packages)
        if {*PACKAGES} <= {*options.packages}:
            (options.prefix / STAMP).touch()
    except BuildError as error:
        print(f"setup: types of {names} not built: {error}; the robot runs without them", flush=True)
    return 0


def _parser() -> Parser:
    parser = Parser(prog="interface_types", description=__doc__)
    parser.add_argument("packages", nargs="*", default=PACKAGES, metavar="PACKAGE",
                        help=f"packages to build (default: {' '.join(PACKAGES)})")
    parser.add_argument("--prefix", type=Path, default=Path(sys.prefix), metavar="FOLDER",
                        help="the environment that gets them (default: the one of this Python)")
    return parser


def require_compiler() -> None:
    """Check that cmake will find a C++ compiler and Python's headers (BuildError with the remedy).

    The environment variables CC and CXX name other compilers.
    """
    if not os.environ.get("CXX") and not any(map(shutil.which, COMPILERS)):
        raise BuildError("no C++ compiler (" + ", ".join(COMPILERS) + "); install g++")
    header = Path(sysconfig.get_paths()["include"], "Python.h")
    if not header.exists():
        raise BuildError(f"{header} is missing; install python3-dev")


def build(prefix: Path, packages: Sequence[str]) -> None:
    """Build and install packages, all at once; of a package that fails nothing is installed (BuildError)."""
    (prefix / LOG).unlink(missing_ok=True)
    with TemporaryDirectory(prefix="interface_types_") as folder, ThreadPoolExecutor() as pool:
        for package, _ in zip(packages, pool.map(lambda name: _build_one(prefix, name, Path(folder, name)), packages),
                              strict=True):
            print(f"setup: {package} is built", flush=True)


def _build_one(prefix: Path, package: str, folder: Path) -> None:
    (source,) = (parent / package for parent in FOLDERS if (parent / package).is_dir())
    cmake = f"{sys.prefix}/bin/cmake"
    log = ""
    for step in (["-S", str(source), "-B", str(folder), f"-DCMAKE_INSTALL_PREFIX={prefix}", *cmake_arguments()],
                 ["--build", str(folder), "--parallel", str(len(os.sched_getaffinity(0)))],
                 ["--install", str(folder)]):
        ended = subprocess.run([cmake, *step], env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                               text=True, errors="replace")
        log += ended.stdout
        if ended.returncode:
            (prefix / LOG).write_text(log)
            lines = [line.strip() for line in log.splitlines() if "error" in line.lower()]
            raise BuildError(f"{lines[0] if lines else f'cmake ended with {ended.returncode}'} (all of it in "
                             f"{prefix / LOG})")


def cmake_arguments() -> list[str]:
    """Return the arguments by which cmake builds against the ROS wheels of this Python."""
    repair = Path(__file__).parent / "wheels.cmake"
    return [f"-DPython3_EXECUTABLE={sys.executable}", f"-DCMAKE_PROJECT_INCLUDE={repair}", "-DBUILD_TESTING=OFF",
            "--no-warn-unused-cli"]


def environment() -> dict[str, str]:
    """Return the environment in which colcon and cmake find the ROS wheels of this Python, and no other ROS.

    The settings of a `make` that runs this program are left out: they would limit the build to one job.
    """
    hidden = {"PYTHONPATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "MAKEFLAGS", "MAKELEVEL"}
    others = {name: value for name, value in os.environ.items() if name not in hidden}
    path = os.pathsep.join([f"{sys.prefix}/bin", os.environ.get("PATH", os.defpath)])
    return others | {"PATH": path, "AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
