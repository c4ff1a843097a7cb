"""Definitions of the interface packages that PyPI lacks, and of this project's own package.

Those of `tf2_msgs` are in the pinned package rosbags. Those of `simulation_interfaces` 2.1.0 are declared in the folder
`declared`, but only the types that the robot serves. A type's hash does not depend on comments, so equal hashes show
that a declaration agrees with the package's own. `vibro_ros_interfaces` is an ordinary package in the folder
`interfaces`, which colcon builds with cmake.
"""

import hashlib
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import distributions
from pathlib import Path
from xml.etree import ElementTree

from rosbags.typesys import Stores, get_typestore

DECLARED = Path(__file__).parent / "declared"
OWN = Path(__file__).resolve().parents[2] / "interfaces"
_OF_ACTIONS = ("action_msgs", "builtin_interfaces", "service_msgs", "unique_identifier_msgs")
_OF_TF2_MSGS = ("TF2Error", "TFMessage")
_MAKERS = ("ros-", "empy", "numpy")  # distributions whose templates, headers and libraries are used
_NEXT_TYPE = "=" * 80  # line in rosbags' text of a type before each type that it contains


@dataclass(frozen=True)
class InterfacePackage:
    """An interface package, with its name, version and license as in its package.xml.

    `origin` is a sentence on the source of the definitions; `texts` are the definitions by their paths in the package,
    such as `msg/TFMessage.msg`. `dependencies` are the packages whose types they contain, including those for services
    and actions.
    """

    name: str
    version: str
    license: str
    origin: str
    texts: dict[str, str]
    dependencies: tuple[str, ...]


def interface_packages() -> tuple[InterfacePackage, ...]:
    """Return all packages that are built."""
    return _tf2_msgs(), _simulation_interfaces(), _vibro_ros_interfaces()


def _tf2_msgs() -> InterfacePackage:
    store = get_typestore(Stores.ROS2_JAZZY)
    texts = {f"msg/{name}.msg": store.generate_msgdef(f"tf2_msgs/msg/{name}", ros_version=2)[0].partition(_NEXT_TYPE)[0]
             for name in _OF_TF2_MSGS}
    return InterfacePackage("tf2_msgs", "0.36.4", "BSD",
                            "Messages of tf2, built from the definitions that rosbags holds.", texts,
                            ("builtin_interfaces", "geometry_msgs", "std_msgs"))


def _simulation_interfaces() -> InterfacePackage:
    return InterfacePackage("simulation_interfaces", "2.1.0", "Apache-2.0",
                            "Types that vibro_ros serves, declared by vibro_ros after the package of this name.",
                            _texts(DECLARED / "simulation_interfaces"),
                            (*_OF_ACTIONS, "geometry_msgs", "std_msgs"))


def _vibro_ros_interfaces() -> InterfacePackage:
    folder = OWN / "vibro_ros_interfaces"
    about = ElementTree.parse(folder / "package.xml").getroot()
    return InterfacePackage("vibro_ros_interfaces", str(about.findtext("version")), str(about.findtext("license")),
                            str(about.findtext("description")), _texts(folder), _OF_ACTIONS)


def _texts(folder: Path) -> dict[str, str]:
    files = sorted(file for kind in ("msg", "srv", "action") for file in folder.glob(f"{kind}/*.{kind}"))
    return {str(file.relative_to(folder)): file.read_text(encoding="utf-8") for file in files}


def fingerprint(packages: Iterable[InterfacePackage]) -> str:
    """Return a hash of the definitions, of this builder, of Python and of the distributions that are used."""
    makers = sorted({f"{name}=={found.version}" for found in distributions()
                     if (name := found.name.replace("_", "-").lower()).startswith(_MAKERS)})
    builder = [file.read_text(encoding="utf-8") for file in sorted(Path(__file__).parent.glob("*.py"))]
    parts = [platform.python_version(), platform.machine(), *makers, *builder, *map(repr, packages)]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()
