"""Generate the sources of an interface package's types, in C, C++ and Python, with the generators of the ROS wheels.

`rosidl generate` cannot be used, because it fails at the wheels' entry points. The functions that it calls are called
here.
"""

import io
import json
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

from rosidl_adapter.action import convert_action_to_idl
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_adapter.srv import convert_srv_to_idl
from rosidl_generator_c import generate_c
from rosidl_generator_py import generate_py
from rosidl_generator_type_description import generate_type_hash
from rosidl_typesupport_c import generate_c as generate_typesupport_c
from rosidl_typesupport_fastrtps_c import generate_typesupport_fastrtps_c
from rosidl_typesupport_introspection_c import generate_c as generate_introspection_c

from tools.interfaces.definitions import InterfacePackage

FASTRTPS, INTROSPECTION = "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"
"""Type supports with which the wheels' middleware serialises messages, and describes types to its peers."""
_TO_IDL: dict[str, Callable] = {
    "msg": convert_msg_to_idl, "srv": convert_srv_to_idl, "action": convert_action_to_idl}
_VISIBILITY = ("rosidl_generator_c", FASTRTPS, INTROSPECTION)  # whose visibility headers cmake makes elsewhere


class Sources:
    """Generated sources of a package, in folders below `folder`; `prefix` is the folder of the installed ROS wheels.

    `share` has definitions, IDL and type descriptions, as in the package's share folder; `python` has the Python
    package, with the C sources of its extension. `native` and `introspection` have C and C++ sources; each contains the
    package's folder, so that it can be an include path. They are separate because their files have the same names.
    """

    def __init__(self, package: InterfacePackage, folder: Path, prefix: Path):
        self.share, self.python = folder / "share", folder / "python"
        self.native, self.introspection = folder / "native", folder / "introspection"
        self._package, self._folder, self._prefix = package, folder, prefix

    def generate(self) -> None:
        """Write all sources."""
        self.describe()
        native = self.native / self._package.name
        with redirect_stdout(io.StringIO()):  # the generators print every file that they read and write
            self._run("rosidl_generator_c", generate_c, native)
            self._run(FASTRTPS, generate_typesupport_fastrtps_c, native)
            self._run(INTROSPECTION, generate_introspection_c, self.introspection / self._package.name)
            self._run("rosidl_typesupport_c", lambda file: generate_typesupport_c(file, [FASTRTPS, INTROSPECTION]),
                      native)
            self._write_visibility(native)
            self._run("rosidl_generator_py", lambda file: generate_py(file, ["rosidl_typesupport_c"]), self.python)
        (self.python / "__init__.py").touch()

    def describe(self) -> None:
        """Write only the folder `share`: definitions, IDL and descriptions, which contain the types' hashes."""
        with redirect_stdout(io.StringIO()):
            self._write_idl()
            self._run("rosidl_generator_type_description", generate_type_hash, self.share)

    def _write_idl(self) -> None:
        for path, text in self._package.texts.items():
            file = self.share / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
            _TO_IDL[file.suffix[1:]](self.share, self._package.name, Path(path), file.parent)

    def _run(self, generator: str, generate: Callable[[str], object], output: Path) -> None:
        """Run one generator, which reads its arguments from a file."""
        for path in self._package.texts:
            (output / path).parent.joinpath("detail").mkdir(parents=True, exist_ok=True)
        arguments = self._folder / f"{generator}.json"
        arguments.write_text(json.dumps(self._arguments(generator, output)), encoding="utf-8")
        generate(str(arguments))

    def _arguments(self, generator: str, output: Path) -> dict[str, object]:
        idl = [str(Path(path).with_suffix(".idl")) for path in self._package.texts]
        return {
            "package_name": self._package.name,
            "output_dir": str(output),
            "template_dir": str(self._prefix / "share" / generator / "resource"),
            "idl_tuples": [f"{self.share}:{path}" for path in idl],
            "include_paths": [f"{name}:{self._prefix / 'share' / name}" for name in self._package.dependencies],
            "type_description_tuples": [f"{path}:{(self.share / path).with_suffix('.json')}" for path in idl],
            "ros_interface_files": [str(self.share / path) for path in self._package.texts],
            "ros_interface_dependencies": [],
            "target_dependencies": [],
        }

    def _write_visibility(self, native: Path) -> None:
        """Write the headers that control the visibility of a library's symbols."""
        name = self._package.name
        for generator in _VISIBILITY:
            template = self._prefix / "share" / generator / "resource" / f"{generator}__visibility_control.h.in"
            text = template.read_text().replace("@PROJECT_NAME@", name).replace("@PROJECT_NAME_UPPER@", name.upper())
            header = native / "msg" / template.stem
            header.parent.mkdir(exist_ok=True)
            header.write_text(text)
