"""Compile and link the libraries of an interface package's types against the ROS wheels; a C compiler suffices."""

import os
import shlex
import shutil
import subprocess
import sysconfig
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from tools.interfaces.definitions import InterfacePackage
from tools.interfaces.generation import FASTRTPS, INTROSPECTION, Sources

COMPILERS = ("cc", "gcc", "clang")
_OF_THE_WHEELS = ("rosidl_typesupport_c", FASTRTPS, "rosidl_typesupport_fastrtps_cpp", INTROSPECTION,
                  "rosidl_runtime_c", "rcutils", "fastcdr")
_OF_A_PACKAGE = ("rosidl_generator_py", "rosidl_typesupport_c", FASTRTPS, INTROSPECTION, "rosidl_generator_c")


class CompilerError(RuntimeError):
    """The compiler cannot be used; the message gives the reason in one line."""


def find_compiler() -> list[str]:
    """Return the command of the C compiler: that of the environment variable CC, or the first available of `COMPILERS`.

    Raises
    ------
    CompilerError
        When there is none, or when Python's headers are missing.
    """
    try:
        words = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise CompilerError(f"CC={os.environ['CC']}: {error}") from None
    words = words or next(([name] for name in COMPILERS if shutil.which(name)), [])
    if not words:
        raise CompilerError("no C compiler (" + ", ".join(COMPILERS) + "); install gcc")
    header = Path(sysconfig.get_paths()["include"], "Python.h")
    if not header.exists():
        raise CompilerError(f"{header} is missing; install python3-dev")
    return words


class Libraries:
    """Libraries of one package, made in `folder` from generated sources.

    `prefix` is the folder in which the ROS wheels are installed, `compiler` the compiler's command. Python imports
    `extension`, which belongs into the Python package; it loads the `shared` libraries, which belong beside those of
    the wheels.
    """

    def __init__(self, package: InterfacePackage, sources: Sources, folder: Path, prefix: Path,
                 compiler: Sequence[str]):
        self.extension = folder / f"{package.name}_s__rosidl_typesupport_c.so"
        self.shared: list[Path] = []
        self._package, self._sources, self._folder, self._compiler = package, sources, folder, compiler
        headers = prefix / "include"
        self._include = [f"-I{path}" for path in (sources.native, sources.introspection, headers,
                                                  *sorted(headers.iterdir()), sysconfig.get_paths()["include"],
                                                  np.get_include())]
        others = [f"{name}__{kind}" for name in package.dependencies for kind in _OF_A_PACKAGE]
        self._linked = [f"-L{folder}", f"-L{prefix / 'lib'}", "-Wl,--as-needed"]
        self._needed = [f"-l{name}" for name in (*others, *_OF_THE_WHEELS, "stdc++")]

    def make(self) -> None:
        """Compile and link all libraries.

        Raises
        ------
        CompilerError
            If the compiler fails, with its first error message.
        """
        self._folder.mkdir()
        native, python = self._sources.native / self._package.name, self._sources.python
        sources = {
            "rosidl_generator_c": native.glob("*/detail/*.c"),
            FASTRTPS: native.glob("*/detail/*.cpp"),
            INTROSPECTION: self._sources.introspection.glob("*/*/detail/*.c"),
            "rosidl_typesupport_c": native.glob("*/*.cpp"),
            "rosidl_generator_py": python.glob("*/_*_s.c"),
        }
        for kind, files in sources.items():
            self.shared.append(self._folder / f"lib{self._package.name}__{kind}.so")
            self._link(self.shared[-1], self._compiled(files))
        self._link(self.extension, self._compiled(python.glob("*.ep.*.c")))

    def _compiled(self, files: Iterable[Path]) -> list[str]:
        """Compile sources in parallel on all processors, and return their object files."""
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            try:
                return list(pool.map(self._compile, sorted(files)))
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise

    def _compile(self, file: Path) -> str:
        made = file.with_suffix(f"{file.suffix}.o")
        run([*self._compiler, "-c", "-fPIC", "-O1", "-w", *self._include, str(file), "-o", str(made)])
        return str(made)

    def _link(self, library: Path, objects: list[str]) -> None:
        made = [f"-l{one.stem.removeprefix('lib')}" for one in self.shared if one != library]
        run([*self._compiler, "-shared", "-s", *objects, "-o", str(library), f"-Wl,-soname,{library.name}",
             *self._linked, *made, *self._needed])


def run(command: Sequence[str]) -> None:
    """Run the compiler (CompilerError if it cannot be started, or fails)."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    except OSError as error:
        raise CompilerError(f"{command[0]}: {error.strerror}") from None
    if done.returncode:
        lines = done.stderr.splitlines()
        complaint = next((line for line in lines if " error: " in line), lines[0] if lines else "it says nothing")
        raise CompilerError(f"{command[0]} failed with exit code {done.returncode}: {complaint}")
