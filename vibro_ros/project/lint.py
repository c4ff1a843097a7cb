"""`make lint`: slips in documents and docstrings that a machine can see, one line each."""

if __name__ == "__main__":  # before all imports, as in every executable
    import sys

    from vibro_ros.process.front_door import enter

    sys.exit(enter("lint"))

from collections.abc import Sequence
from pathlib import Path

from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import FAILURE, exit_code
from vibro_ros.project.docstring_slips import docstring_slips
from vibro_ros.project.link_slips import link_slips
from vibro_ros.project.name_slips import name_slips
from vibro_ros.project.term_slips import term_slips

CHECKS = (link_slips, name_slips, docstring_slips, term_slips)


def main(words: Sequence[str]) -> int:
    """Print every slip; the exit code is 0 when there is none."""
    return exit_code("lint", lambda: _lint(words))


def _lint(words: Sequence[str]) -> int:
    parser = Parser(prog="lint", description=EXECUTABLES["lint"].does)
    parser.add_argument("root", type=Path, nargs="?", default=Path(), help="the repository (default: this folder)")
    root = parser.parse_args(words).root.resolve()
    slips = [slip for check in CHECKS for slip in check(root)]
    print(*slips, sep="\n", end="\n" if slips else "")
    return FAILURE if slips else 0
