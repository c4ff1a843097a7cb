"""Install vibro_ros with pip, or with colcon in a ROS 2 workspace."""

import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path
from runpy import run_path
from xml.etree import ElementTree

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

PACKAGE = ElementTree.parse("package.xml").getroot()  # name, version and the like are written there only
NAME = PACKAGE.findtext("name")
SHARE = f"share/{NAME}"
EXECUTABLES = run_path(f"{NAME}/process/executables.py")["EXECUTABLES"]  # not imported: what they need may be missing
CYTHON = [3, 0, 8]  # the oldest that translates the kernels: Ubuntu 24.04's
#: Whether the compiler that setuptools calls exists; where there is none, pip brings ziglang for its isolated build.
HAS_COMPILER = shutil.which((os.environ.get("CXX") or sysconfig.get_config_var("CXX") or "c++").split()[0]) is not None


def config_files() -> list[tuple[str, list[str]]]:
    """Return every file below config/ with the folder it is installed to."""
    files = sorted(file for file in Path("config").rglob("*") if file.is_file())
    return [(f"{SHARE}/{file.parent}", [str(file)]) for file in files]


class BuildKernels(build_ext):
    """Build the kernels: their text becomes one unit, which Cython translates, and a C++ compiler compiles."""

    def run(self) -> None:
        """Make the unit's sources, and compile them."""
        folder = Path(self.build_temp, "kernels")
        if not Path(sysconfig.get_paths()["include"], "Python.h").exists():
            raise CompileError("the kernels need Python's headers; Debian, Ubuntu: apt install python3-dev")
        if not (HAS_COMPILER or find_spec("ziglang")):
            raise CompileError("the kernels need a C++ compiler; Debian, Ubuntu: apt install g++; without root: pip "
                               "install ziglang")
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([os.getcwd(), *filter(None, sys.path)])}
        version = subprocess.run([sys.executable, "-c", "import Cython; print(Cython.__version__)"], env=environment,
                                 capture_output=True, text=True).stdout.strip() or "none"
        if [int(number) for number in re.findall(r"\d+", version)] < CYTHON:
            raise CompileError(f"the kernels need Cython {'.'.join(map(str, CYTHON))} or newer, and this Python has "
                               f"{version}; pip install --upgrade Cython")
        subprocess.run([sys.executable, "-m", "vibro_ros.solver.unit", str(folder)], env=environment, check=True)
        subprocess.run([sys.executable, "-m", "cython", "-3", "--cplus", str(folder / "core.pyx")], env=environment,
                       check=True)
        for extension in self.extensions:
            source = folder / f"{extension.name.rpartition('.')[2]}.cpp"
            if source.name != "core.cpp":
                shutil.copy(folder / "core.cpp", source)
            extension.sources, extension.depends = [str(source)], [str(folder / "core.h")]
            extension.include_dirs = [str(folder), f"{NAME}/solver"]
        self.parallel = True  # two compilers at once
        super().run()

    def build_extensions(self) -> None:
        """Compile; where there is no compiler, by zig."""
        if not HAS_COMPILER:
            zig = str(Path(find_spec("ziglang").origin).with_name("zig"))
            calls = {"compiler_so": [zig, "c++", "-fPIC", "-DNDEBUG"], "linker_so": [zig, "cc", "-shared"]}
            if "compiler_so_cxx" in self.compiler.executables:  # of setuptools from 75 on
                calls["compiler_so_cxx"] = calls["compiler_so"]
            self.compiler.set_executables(**calls)
            for extension in self.extensions:
                extension.language = "c"  # linked so: kernels need nothing of C++'s library, which zig would compile
                extension.extra_compile_args = [flag.replace("x86-64-", "x86_64_")  # zig's names of processors
                                                for flag in extension.extra_compile_args]
        super().build_extensions()


# Products are not fused with sums, so that all builds have the same bits.
FLAGS = ["-O3", "-std=gnu++17", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden", "-Wno-psabi", "-g0"]
#: Modules of the same source, by name: for x86-64 also one for processors with registers of 256 bits, chosen at import.
KERNELS = {"core": ["-march=x86-64-v2"], "core_v3": ["-march=x86-64-v3", "-DPyInit_core=PyInit_core_v3"]} \
    if platform.machine() == "x86_64" else {"core": []}

setup(
    cmdclass={"build_ext": BuildKernels},
    ext_modules=[Extension(f"{NAME}.solver.{name}", [f"{NAME}/solver/vectors.h"], language="c++",
                           extra_compile_args=[*FLAGS, *flags], extra_link_args=["-s"])
                 for name, flags in KERNELS.items()],
    name=NAME,
    version=PACKAGE.findtext("version"),
    description=PACKAGE.findtext("description"),
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    project_urls={url.get("type").capitalize(): url.text for url in PACKAGE.iterfind("url")},
    maintainer=PACKAGE.findtext("maintainer"),
    maintainer_email=PACKAGE.find("maintainer").get("email"),
    license=PACKAGE.findtext("license"),
    classifiers=[
        "Development Status :: 5 - Production/Stable",
        "Intended Audience :: Developers",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in range(11, 15)),
        "Topic :: Scientific/Engineering :: Physics",
        "Typing :: Typed",
    ],
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.solver": ["vectors.h"], f"{NAME}.view": ["page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/launch", sorted(map(str, Path("examples/launch").glob("*.launch.py")))),
        *config_files(),
    ],
    zip_safe=False,
    setup_requires=[] if HAS_COMPILER or "setuptools.build_meta" not in sys.modules else ["ziglang"],  # pip asks
    python_requires=">=3.11,<3.15",
    install_requires=["lz4", "matplotlib", "mcap>=1.5", "numpy", "pillow", "PyYAML", "rosbags>=0.11",
                      "tornado", "tqdm", "zstandard"],
    extras_require={
        # ROS 2 Jazzy as wheels; not asked for by default, so that an apt installation is never shadowed.
        "ros": [
            "ros-jazzy-diagnostic-msgs",
            "ros-jazzy-geometry-msgs",
            "ros-jazzy-nav-msgs",
            "ros-jazzy-rclpy==7.1.6",
            "ros-jazzy-rmw-fastrtps-cpp",
            "ros-jazzy-sensor-msgs",
            "ros-jazzy-std-msgs",
            "ros-jazzy-std-srvs",
        ],
        # The documents as web pages.
        "site": ["mkdocs", "mkdocs-material", "mkdocstrings-python"],
        "test": [
            "catkin-pkg",
            "cmeel-urdfdom",
            "codespell",
            "Cython",  # builds the kernels
            "colcon-common-extensions",
            'cyclonedds ; python_version < "3.14"',  # a peer by another vendor's DDS; no wheel beyond
            "mpmath",
            "mypy",
            "oxlint",
            "packaging",
            "pandas",
            "playwright",  # steers a browser
            "polars",
            "pytest",
            "pytest-rerunfailures",
            "pytest-xdist",
            "python-flint",
            "ruff",
            "scipy",
            "setuptools",  # colcon-core asks for one below 80
        ],
    },
    entry_points={
        "console_scripts": [
            f"{name} = {NAME}.process.entry_point:{name}"
            for name, executable in EXECUTABLES.items() if executable.installed
        ],
    },
)
