"""`make setup`: the Python types that PyPI lacks, built into the environment from their definitions.

Nothing happens where the types are there already and nothing has changed from which they were made. The robot runs
without them, so that a missing or broken compiler is said in one line and is no failure.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from tools.interfaces.compilation import CompilerError, Libraries, find_compiler
from tools.interfaces.definitions import InterfacePackage, interface_packages
from tools.interfaces.fingerprint import fingerprint
from tools.interfaces.generation import Sources
from tools.interfaces.installation import install, workshop
from vibro_ros.process.front_door import Parser, exit_code

STAMP = "interface_types.done"
"""File in the environment that holds the fingerprint of what its types were made from; written last."""


def main(words: Sequence[str]) -> int:
    """Build the types; 0 also where there is no compiler that works."""
    return exit_code("setup", lambda: _provide(_parser().parse_args(words).prefix))


def _provide(prefix: Path) -> int:
    packages = interface_packages()
    names = " and ".join(package.name for package in packages)
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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
