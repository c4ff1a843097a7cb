"""What the command lines of all studies share: the machine, who computes, the locked folder, stops, and files."""

import argparse
import contextlib
import fcntl
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.model.parameters import BY_NAME, Value, parameter_named
from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import Parser, exit_code, interrupted_code, say
from vibro_ros.process.files import replace_file
from vibro_ros.simulation.processes import core_count
from vibro_ros.study.execution import Execution
from vibro_ros.study.variation import whole_number

MOST_WORKERS = 4096
"""Processes that may be asked for."""
# The workers of a study that was killed hold its lock until they have ended the run that they are in [s].
_PATIENCE, _POLL = 3.0, 0.05


def run_study(study: Callable[[argparse.Namespace], int], parser: Parser, words: Sequence[str]) -> int:
    """The exit code of a study with the options that `words` give; a stop signal keeps what is done."""
    def run() -> int:
        options = parser.parse_args(words)
        try:
            return study(options)
        except KeyboardInterrupt:
            say("study", "interrupted; finished work is kept, and the same command goes on from there")
            return interrupted_code()

    return exit_code("study", run)


def study_parser(name: str, description: str, failure: str = "a run failed, or the disk is full") -> Parser:
    """The command line of a study, with `--output`; `failure` is what exit code 1 means."""
    parser = Parser(
        prog=f"study {name}",
        description=f"{description} Ctrl-C keeps finished work; the same command goes on from there.",
        epilog=f"Exit code 0: done; 1: {failure}; 2: bad input, or nowhere to write; 129, 130, 143: stopped by SIGHUP, "
        "SIGINT, SIGTERM, finished work is kept.")
    parser.add_argument("--output", type=Path, default=Path("out/study") / name, metavar="DIR", help="where to write "
                        "(default: %(default)s)")
    return parser


def add_machine(parser: Parser, scene: str) -> None:
    """Add `--scene`, by default `scene`, and `--set`."""
    parser.add_argument("--scene", default=scene, metavar="NAME", help="shipped scene or scene file (default: "
                        "%(default)s)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="another value of the scene, "
                        "SI units, angles in rad; repeatable")


def machine_of(options: argparse.Namespace) -> Scene:
    """The machine that `--scene` and `--set` name (ValueError)."""
    return load_scene(options.scene).with_parameters(settings_of(options.set))


def settings_of(words: Sequence[str]) -> dict[str, Value]:
    """The values that `--set NAME=VALUE` gives, each checked.

    Raises
    ------
    ValueError
        For an unknown name, a value out of range, and a name that is given twice.
    """
    found: dict[str, Value] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise ValueError(f"--set {word}: give NAME=VALUE, such as ground.friction=0.3")
        if name in found:
            raise ValueError(f"--set: {name} is given twice; keep one")
        found[name] = parameter_named(name, BY_NAME).checked(read_scalar(value))
    return found


def add_execution(parser: Parser) -> None:
    """Add `--workers` and `--scheduler`."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="processes on this machine (default: one a core); they "
                       "change no number")
    where.add_argument("--scheduler", metavar="ADDRESS", help="compute on the Dask cluster of this scheduler, such as "
                       "tcp://host:8786; the numbers are the same to the last bit")


def execution_of(options: argparse.Namespace) -> Execution:
    """Who computes, by `--workers` or `--scheduler` (ValueError)."""
    workers = core_count() if options.workers is None else options.workers
    return Execution(whole_number("--workers", workers, 1, MOST_WORKERS), options.scheduler)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make `folder`, and keep other studies from it until the context or the process ends.

    Where the file system knows no locks, nobody is kept away.

    Raises
    ------
    ValueError
        When another study uses it, or it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise ValueError(f"{folder}: {error.strerror}; give an --output that can be written") from error
    deadline = time.monotonic() + _PATIENCE
    try:
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise ValueError(f"{folder}: another study writes here; wait for its end, or give another "
                                     "--output") from None
                time.sleep(_POLL)
            except OSError:
                break
        yield
    finally:
        os.close(descriptor)


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the results of a study, each file whole or not at all, and print their paths (OSError)."""
    for name, data in files.items():
        replace_file(folder / name, data)
        print(folder / name)
