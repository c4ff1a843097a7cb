"""The executable `study`: its first word names the study, whose own module takes the others."""

from collections import namedtuple
from collections.abc import Sequence
from importlib import import_module

from vibro_ros.process.command_line import Parser
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.front_door import exit_code

Study = namedtuple("Study", ["module", "does"])
Study.__doc__ = """One study.

Attributes
----------
module : str
    Module whose `main` takes the words that follow the study's name, and returns the exit code.
does : str
    What it does, in one sentence: the first of its `--help`.
"""

STUDIES = {
    "paper": Study("vibro_ros.study.paper", "Run every figure and claim of the paper under each of its readings."),
    "sweep": Study("vibro_ros.study.sweep", "Vary parameters and tabulate what the robot does."),
    "optimise": Study("vibro_ros.study.optimise", "Search for the parameters of the fastest or thriftiest robot."),
    "literature": Study("vibro_ros.study.literature", "Hold published results of other machines against the model."),
}
"""Every study by its name."""


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("study", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words[:1])
    return import_module(STUDIES[options.study].module).main(words[1:])


def _parser() -> Parser:
    listed = "; ".join(f"{name}: {study.does}" for name, study in STUDIES.items())
    parser = Parser(prog="study", description=f"{EXECUTABLES['study'].does} {listed}",
                    epilog="`study NAME --help` shows the options of a study, and its exit codes.")
    parser.add_argument("study", choices=STUDIES, metavar="NAME", help=f"of {', '.join(STUDIES)}")
    return parser
