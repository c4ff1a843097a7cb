"""Where built types go in an environment, so that Python, the middleware and `ros2 interface` find them.

A package is there as a whole or not at all for whoever imports it: its Python package comes last and goes first. Each
folder and file is made elsewhere in the environment and renamed.
"""

import fcntl
import os
import shutil
import sysconfig
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from xml.sax.saxutils import escape

from tools.interfaces.compilation import Libraries
from tools.interfaces.definitions import InterfacePackage
from tools.interfaces.generation import Sources

_INDEX = Path("share", "ament_index", "resource_index")


@contextmanager
def workshop(prefix: Path) -> Iterator[Path]:
    """A new folder in the environment, which is gone afterwards; one process at a time has it."""
    folder = prefix / "interface_types.part"
    descriptor = os.open(prefix, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        with suppress(OSError):  # of a file system that knows no locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        shutil.rmtree(folder, ignore_errors=True)  # of a process that was killed
        folder.mkdir()
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(descriptor)


def install(package: InterfacePackage, sources: Sources, libraries: Libraries, prefix: Path) -> None:
    """Move what was made for a package to its places, instead of what is there; on an exception nothing stays there."""
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
    """Remove an installed package; what is not there is passed over."""
    if (python := _python_package(name, prefix)).exists():
        python.rename(prefix / "interface_types.part" / f"{name}.old")  # as a whole, and then file by file
    shutil.rmtree(prefix / "share" / name, ignore_errors=True)
    for file in [*(prefix / "lib").glob(f"lib{name}__*.so"), *(prefix / _INDEX).glob(f"*/{name}")]:
        file.unlink()


def _python_package(name: str, prefix: Path) -> Path:
    return Path(sysconfig.get_path("platlib", vars={"platbase": str(prefix)})) / name


def _index_entries(package: InterfacePackage, prefix: Path) -> dict[Path, str]:
    """What the ament index says of the package, by file."""
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
