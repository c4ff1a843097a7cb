"""Executable ``study``: its first word names the study, whose own module takes the others."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("study"))

from collections.abc import Sequence
from importlib import import_module

from vibro_ros.process.entry_point import Parser, exit_code
from vibro_ros.process.executables import EXECUTABLES

STUDIES = {
    "sweep": "Vary parameters and tabulate what the robot does.",
    "optimise": "Search for the fastest or thriftiest robot.",
    "orbits": "Follow branches of periodic orbits over a parameter, and locate where they change.",
    "diagram": "Sweep a parameter up and down: states once a turn, hysteresis, exponents, chaos.",
    "basins": "Tell which start leads to which motion.",
    "map": "Find every motion over motor speed and gap: the command map that `controller` reads.",
}
"""What each study does, by its name, which is that of its folder: `main` in `command.py` there takes the words that
follow the study's name, and returns the exit code."""


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("study", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words[:1])
    try:
        study = import_module(f"vibro_ros.study.{options.study}.command")
    except ModuleNotFoundError as error:
        raise ValueError(f"{error.name}: not installed; `make study` installs what the studies need, as does "
                         '`pip install ".[study]"`') from error
    return study.main(words[1:])


def _parser() -> Parser:
    listed = "; ".join(f"{name}: {does}" for name, does in STUDIES.items())
    parser = Parser(
        prog="study", description=f"{EXECUTABLES['study'].does} {listed}",
        epilog="Exit code 0: done; 1: a run failed; 2: bad input, or something is not installed; 129, 130, 143: "
        "stopped by SIGHUP, SIGINT, SIGTERM, finished work is kept. `study NAME --help` shows its options.")
    parser.add_argument("study", choices=STUDIES, metavar="NAME", help=f"of {', '.join(STUDIES)}")
    return parser
