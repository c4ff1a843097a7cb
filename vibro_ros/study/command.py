"""Executable ``study``: its first word names the study, whose own module takes the others.

A study's `main` is a `StudyCommand`: all that the command lines share, from the options to the files that are written,
with the machine, who computes, the locked folder, stops, and how far a study is.
"""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("study"))

import argparse
import contextlib
import fcntl
import os
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.configuration.strict_yaml import read_scalar
from vibro_ros.model.parameters import BY_NAME, Value, parameter_named
from vibro_ros.model.scene import Scene
from vibro_ros.process.entry_point import FAILURE, Parser, exit_code, interrupted_code, say
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.files import replace_file
from vibro_ros.simulation.processes import core_count
from vibro_ros.simulation.simulator import ToleranceWarning
from vibro_ros.study.execution import Execution
from vibro_ros.study.variation import whole_number

STUDIES = {
    "sweep": "Vary parameters and tabulate what the robot does.",
    "optimise": "Search for the fastest or thriftiest robot.",
    "orbits": "Follow branches of periodic orbits over a parameter, and locate where they change.",
    "diagram": "Sweep a parameter up and down: states once a turn, hysteresis, exponents, chaos.",
    "basins": "Tell which start leads to which motion.",
    "map": "Find every motion over motor speed and gap: the command map that `controller` reads.",
}
"""What each study does, by its name, which is that of its module; `main` there is a `StudyCommand`."""


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("study", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _front_parser().parse_args(words[:1])
    try:
        study = import_module(f"vibro_ros.study.{options.study}")
    except ModuleNotFoundError as error:
        raise ValueError(f"{error.name}: not installed; `make study` installs what the studies need, as does "
                         '`pip install ".[study]"`') from error
    return study.main(words[1:])


def _front_parser() -> Parser:
    listed = "; ".join(f"{name}: {does}" for name, does in STUDIES.items())
    parser = Parser(
        prog="study", description=f"{EXECUTABLES['study'].does} {listed}",
        epilog="Exit code 0: done; 1: a run failed; 2: bad input, or something is not installed; 129, 130, 143: "
        "stopped by SIGHUP, SIGINT, SIGTERM, finished work is kept. `study NAME --help` shows its options.")
    parser.add_argument("study", choices=STUDIES, metavar="NAME", help=f"of {', '.join(STUDIES)}")
    return parser


MOST_WORKERS = 4096
"""Processes that may be asked for."""
# The workers of a study that was killed hold its lock until they have ended the run that they are in [s].
_PATIENCE, _POLL = 3.0, 0.05


class Results(NamedTuple):
    """What a study gives: the bytes of its files by their names, the lines that it says, and whether a run failed."""

    files: Mapping[str, bytes]
    words: Iterable[str]
    failed: bool = False


@dataclass(frozen=True)
class StudyCommand:
    """The command line of a study. Called with the words that follow the study's name, it returns the exit code.

    Attributes
    ----------
    name : str
        Of the study, and of its folder below ``out/study``.
    does : str
        What it does and writes, for its help.
    add_options : callable
        Adds the options that no other study has.
    design_of : callable
        The design that the options give; it raises ValueError before anything is written.
    results : callable
        Takes the design, the locked folder and who computes, and yields `Results` as they are done.
    scene : str or None
        The scene unless `--scene` names one; None for a study that adds `--scene` and `--set` by itself.
    failure : str
        What exit code 1 means.
    """

    name: str
    does: str
    add_options: Callable[[Parser], object]
    design_of: Callable[[argparse.Namespace], Any]
    results: Callable[[Any, Path, Execution], Iterator[Results]]
    scene: str | None = "device"
    failure: str = "a run failed, or the disk is full"

    def parser(self) -> Parser:
        """All options."""
        parser = Parser(
            prog=f"study {self.name}",
            description=f"{self.does} Ctrl-C keeps finished work; the same command goes on from there.",
            epilog=f"Exit code 0: done; 1: {self.failure}; 2: bad input, or nowhere to write; 129, 130, 143: stopped "
            "by SIGHUP, SIGINT, SIGTERM, finished work is kept.")
        parser.add_argument("--output", type=Path, default=Path("out/study") / self.name, metavar="DIR", help="where "
                            "to write (default: %(default)s)")
        if self.scene:
            parser.add_argument("--scene", default=self.scene, metavar="NAME", help="shipped scene or scene file "
                                "(default: %(default)s)")
            parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="another value of the "
                                "scene, SI units, angles in rad; repeatable")
        self.add_options(parser)
        where = parser.add_mutually_exclusive_group()
        where.add_argument("--workers", type=int, metavar="N", help="processes on this machine (default: one a core); "
                           "they change no number")
        where.add_argument("--scheduler", metavar="ADDRESS", help="compute on the Dask cluster of this scheduler, such "
                           "as tcp://host:8786; the numbers are the same to the last bit")
        return parser

    def __call__(self, words: Sequence[str]) -> int:
        """Run the study; a stop signal keeps what is done."""
        return exit_code("study", lambda: self._run(self.parser().parse_args(words)))

    def _run(self, options: argparse.Namespace) -> int:
        failed = False
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ToleranceWarning)  # `machine_of` says it once
                execution, design = execution_of(options), self.design_of(options)
                with locked(options.output):
                    for found in self.results(design, options.output, execution):
                        for name, data in found.files.items():
                            replace_file(options.output / name, data)
                            print(options.output / name)
                        print("\n".join(found.words))
                        failed |= found.failed
        except KeyboardInterrupt:
            say("study", "interrupted; finished work is kept, and the same command goes on from there")
            return interrupted_code()
        return FAILURE if failed else 0


def machine_of(options: argparse.Namespace) -> Scene:
    """The machine that `--scene` and `--set` name (ValueError)."""
    scene = load_scene(options.scene).with_parameters(settings_of(options.set))
    if scene.broken_promise:
        say("study", f"warning: {scene.broken_promise}")
    return scene


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


_LINES = 10.0  # s between lines that say how far it is, where no bar can be drawn
_DELAY = 2.0  # s before a bar is drawn


class Progress:
    """A bar with the time that is left or, where standard error is no terminal, a line now and then; a context.

    Parameters
    ----------
    what : str
        What is done.
    unit : str
        What is counted, such as ``run``.
    total, done : int
        How many there are, and how many were done before [-].
    """

    def __init__(self, what: str, unit: str, total: int, done: int = 0):
        self._bar = tqdm(desc=what, total=total, initial=done, unit=unit, disable=None, delay=_DELAY, smoothing=0.1)
        self._what, self._unit, self._total, self._first, self._done = what, unit, total, done, done
        self._begun = self._said = time.monotonic()

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def add(self, count: int) -> None:
        """Note that `count` more are done."""
        self._done += count
        self._bar.update(count)
        now = time.monotonic()
        if self._bar.disable and now - self._said > _LINES:
            left = (now - self._begun) / (self._done - self._first) * (self._total - self._done)
            say("study", f"{self._what}: {self._done} of {self._total} {self._unit}s, "
                         f"{tqdm.format_interval(left)} left")
            self._said = now
