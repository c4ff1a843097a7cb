"""`make setup`: build the Python types that PyPI lacks into the environment, from their definitions.

Nothing is done if the types exist and their sources have not changed. The robot runs without them, so that a missing or
broken compiler is reported in one line and is not a failure. A package is installed completely or not at all: its
Python package is installed last and removed first.
"""

import fcntl
import os
import shutil
import sys
import sysconfig
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from xml.sax.saxutils import escape

from tools.interfaces.compilation import CompilerError, Libraries, find_compiler
from tools.interfaces.definitions import InterfacePackage, fingerprint, interface_packages
from tools.interfaces.generation import Sources
from vibro_ros.process.entry_point import Parser, exit_code

STAMP = "interface_types.done"
"""File in the environment with the fingerprint of the sources of its types; written last."""
_INDEX = Path("share", "ament_index", "resource_index")


def main(words: Sequence[str]) -> int:
    """Build the types; returns 0 also if there is no working compiler."""
    return exit_code("setup", lambda: _provide(_parser().parse_args(words).prefix))


def _provide(prefix: Path) -> int:
    packages = interface_packages()
    *most, last = (package.name for package in packages)
    names = f"{', '.join(most)} and {last}"
    try:
        with workshop(prefix) as folder:
            stamp, wanted = prefix / STAMP, fingerprint(packages)
            if stamp.exists() and stamp.read_text() == wanted:
                stamp.touch()
                return 0
            compiler = find_compiler()
            print(f"setup: building the Python types of {names} (a quarter of a minute)", flush=True)
            stamp.unlink(missing_ok=True)
            for package in packages:
                _build(package, folder / package.name, prefix, compiler)
            stamp.write_text(wanted)
    except CompilerError as error:
        print(f"setup: types of {names} not built: {error}; the robot runs without them", flush=True)
    return 0


def _build(package: InterfacePackage, folder: Path, prefix: Path, compiler: Sequence[str]) -> None:
    folder.mkdir()
    sources = Sources(package, folder, Path(sys.prefix))
    sources.generate()
    libraries = Libraries(package, sources, folder / "lib", Path(sys.prefix), compiler)
    libraries.make()
    install(package, sources, libraries, prefix)


def _parser() -> Parser:
    parser = Parser(prog="interface_types", description=__doc__)
    parser.add_argument("--prefix", type=Path, default=Path(sys.prefix), metavar="FOLDER",
                        help="the environment that gets them (default: the one of this Python)")
    return parser


@contextmanager
def workshop(prefix: Path) -> Iterator[Path]:
    """Context manager that makes a temporary folder in the environment, for one process at a time."""
    folder = prefix / "interface_types.part"
    descriptor = os.open(prefix, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        with suppress(OSError):  # on a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        shutil.rmtree(folder, ignore_errors=True)  # left by a process that was killed
        folder.mkdir()
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(descriptor)


def install(package: InterfacePackage, sources: Sources, libraries: Libraries, prefix: Path) -> None:
    """Move a package's built files to their places, replacing older ones; after an exception none of them remain."""
    _write_package_file(package, sources.share)
    shutil.move(libraries.extension, sources.python)
    try:
        remove(package.name, prefix)
        for library in libraries.shared:
            library.rename(prefix / "lib" / library.name)
        sources.share.rename(prefix / "share" / package.name)
        for file, text in _index_entries(package, prefix).items():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        sources.python.rename(_python_package(package.name, prefix))
    except BaseException:
        remove(package.name, prefix)
        raise


def remove(name: str, prefix: Path) -> None:
    """Remove an installed package; missing files are ignored."""
    if (python := _python_package(name, prefix)).exists():
        python.rename(prefix / "interface_types.part" / f"{name}.old")  # removes it at once, unlike deletion
    shutil.rmtree(prefix / "share" / name, ignore_errors=True)
    for file in [*(prefix / "lib").glob(f"lib{name}__*.so"), *(prefix / _INDEX).glob(f"*/{name}")]:
        file.unlink()


def _python_package(name: str, prefix: Path) -> Path:
    return Path(sysconfig.get_path("platlib", vars={"platbase": str(prefix)})) / name


def _index_entries(package: InterfacePackage, prefix: Path) -> dict[Path, str]:
    """Contents of the package's files in the ament index, by path."""
    files = sorted(path for text in package.texts for path in (text, str(Path(text).with_suffix(".idl"))))
    return {
        prefix / _INDEX / "packages" / package.name: "",
        prefix / _INDEX / "package_run_dependencies" / package.name: ";".join(package.dependencies),
        prefix / _INDEX / "rosidl_interfaces" / package.name: "\n".join(files),
    }


def _write_package_file(package: InterfacePackage, share: Path) -> None:
    depends = "".join(f"  <exec_depend>{name}</exec_depend>\n" for name in package.dependencies)
    (share / "package.xml").write_text(
        '<?xml version="1.0"?>\n<package format="3">\n'
        f"  <name>{package.name}</name>\n  <version>{package.version}</version>\n"
        f"  <description>{escape(package.origin)}</description>\n"
        '  <maintainer email="maintainers@vibro-ros.example">vibro_ros maintainers</maintainer>\n'
        f"  <license>{package.license}</license>\n{depends}"
        "  <member_of_group>rosidl_interface_packages</member_of_group>\n</package>\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
