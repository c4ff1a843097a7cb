"""Executable ``study``: its first argument names the study, whose own module parses the rest.

A study's `main` is a `StudyCommand`. It has the parts common to all studies: common options, scene, execution, lock of
the output folder, writing of files, stop signals and progress.
"""

if __name__ == "__main__":  # before all imports, which take a second or two, in which a signal may arrive
    import sys

    from vibro_lab.executables import study

    sys.exit(study())

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

from vibro_lab.executables import EXECUTABLES
from vibro_lab.orbits.turn_map import whole_number
from vibro_lab.study.execution import Execution
from vibro_ros import (
    PARAMETERS,
    Parser,
    Scene,
    ToleranceWarning,
    Value,
    core_count,
    exit_code,
    interrupted_code,
    load_scene,
    parameter_named,
    read_settings,
    replace_file,
    say,
)

STUDIES = {
    "sweep": "Vary parameters and tabulate what the robot does.",
    "optimise": "Search for the fastest or thriftiest robot.",
    "orbits": "Follow branches of periodic orbits over a parameter, and locate where they change.",
    "diagram": "Sweep a parameter up and down: states once a turn, hysteresis, exponents, chaos.",
    "basins": "Tell which start leads to which motion.",
    "map": "Find every motion over motor speed and gap.",
    "identify": "Find the parameters of the robot that made a recording, with intervals.",
}
"""Summary of each study by its name, which is also the name of its module; `main` there is a `StudyCommand`."""


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("study", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    name = next((word for word in words if word in STUDIES), "NAME")
    if words and words[0] not in ("-h", "--help", "--version") and words[0].startswith("-"):
        raise ValueError(f"{words[0]}: options come after the study's name; write "
                         f"{' '.join(['study', name, *(word for word in words if word != name)])}")
    options = _front_parser().parse_args(words[:1])
    try:
        study = import_module(f"vibro_lab.study.{options.study}")
    except ModuleNotFoundError as error:
        raise ValueError(f"{error.name}: not installed; `make study` installs what the studies need, as does "
                         '`pip install "./lab[study]"`') from error
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
"""Largest number of processes."""
# Time [s] for which the lock is tried, and between tries: workers of a killed study hold it until their run has ended.
_PATIENCE, _POLL = 3.0, 0.05


class Results(NamedTuple):
    """Results of a study: contents of files by name, lines for standard output, and whether a run failed."""

    files: Mapping[str, bytes]
    words: Iterable[str]
    failed: bool = False


@dataclass(frozen=True)
class StudyCommand:
    """The command line of a study. Called with the arguments after the study's name, it returns the exit code."""

    name: str  # name of the study, and of its folder below ``out/study``
    does: str  # description for its help: what it does and writes
    add_options: Callable[[Parser], object]  # adds the options that only this study has to a parser
    # Makes the design from the parsed options; it raises ValueError before anything is written.
    design_of: Callable[[argparse.Namespace], Any]
    # Takes the design, the locked folder and the execution, and yields `Results` as they are done.
    results: Callable[[Any, Path, Execution], Iterator[Results]]
    failure: str = "a run failed, or the disk is full"  # meaning of exit code 1, for its help
    goes_on: bool = True  # whether it keeps finished work and goes on from there

    def parser(self) -> Parser:
        """Return the parser of all options."""
        parser = Parser(
            prog=f"study {self.name}",
            description=self.does + (" Ctrl-C keeps finished work; the same command goes on from there." if self.goes_on
                                     else " Ctrl-C ends it; the same command begins anew."),
            epilog=f"Exit code 0: done; 1: {self.failure}; 2: bad input, or nowhere to write; 129, 130, 143: stopped "
            "by SIGHUP, SIGINT, SIGTERM" + (", finished work is kept." if self.goes_on else "."))
        parser.add_argument("--output", type=Path, default=Path("out/study") / self.name, metavar="DIR", help="where "
                            "to write (default: %(default)s)")
        parser.add_argument("--scene", default="device", metavar="NAME", help="shipped scene or scene file "
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
        """Run the study; finished work is kept if a signal stops it, and if the study can go on from there."""
        return exit_code("study", lambda: self._run(self.parser().parse_args(words)))

    def _run(self, options: argparse.Namespace) -> int:
        failed = False
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ToleranceWarning)  # `machine_of` prints it once
                execution, design = execution_of(options), self.design_of(options)
                with locked(options.output):
                    for result in self.results(design, options.output, execution):
                        for name, data in result.files.items():
                            replace_file(options.output / name, data)
                            print(options.output / name)
                        print("\n".join(result.words))
                        failed |= result.failed
        except KeyboardInterrupt:
            say("study", "interrupted; finished work is kept, and the same command goes on from there" if self.goes_on
                else "interrupted; the same command begins anew")
            return interrupted_code()
        return 1 if failed else 0


def machine_of(options: argparse.Namespace) -> Scene:
    """Return the scene given by `--scene` and `--set` (ValueError)."""
    scene = load_scene(options.scene).with_parameters(settings_of(options.set))
    if scene.broken_promise:
        say("study", f"warning: {scene.broken_promise}")
    return scene


def settings_of(words: Sequence[str]) -> dict[str, Value]:
    """Return the checked parameter values of all `--set NAME=VALUE`, by name."""
    return {name: parameter_named(name, PARAMETERS).checked(value) for name, value in read_settings(words).items()}


def execution_of(options: argparse.Namespace) -> Execution:
    """Return the execution given by `--workers` or `--scheduler` (ValueError)."""
    workers = core_count() if options.workers is None else options.workers
    return Execution(whole_number("--workers", workers, 1, MOST_WORKERS), options.scheduler)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make `folder`, and lock it against other studies until the context or the process ends.

    On a file system without locks the folder is not protected.
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


_LINE_PERIOD = 10.0  # s between progress lines where no bar can be drawn
_BAR_DELAY = 2.0  # s before a bar is drawn


class Progress:
    """Progress bar with the remaining time, or occasional lines if standard error is not a terminal; a context manager.

    `done` of the `total` units were done before. Within another one it is silent, because two remaining times would
    contradict each other.
    """

    _running = 0

    def __init__(self, what: str, unit: str, total: int, done: int = 0):
        self._silent = Progress._running > 0
        self._bar = tqdm(desc=what, total=total, initial=done, unit=unit, disable=self._silent or None,
                         delay=_BAR_DELAY, smoothing=0.1)
        self._what, self._unit, self._total, self._first, self._done = what, unit, total, done, done
        self._begun_at = self._last_report = time.monotonic()

    def __enter__(self) -> "Progress":
        Progress._running += 1
        return self

    def __exit__(self, *_: object) -> None:
        Progress._running -= 1
        self._bar.close()

    def add(self, count: int) -> None:
        """Note that `count` more are done."""
        self._done += count
        self._bar.update(count)
        now = time.monotonic()
        if self._bar.disable and not self._silent and now - self._last_report > _LINE_PERIOD:
            remaining = (now - self._begun_at) / (self._done - self._first) * (self._total - self._done)
            say("study", f"{self._what}: {self._done} of {self._total} {self._unit}s, "
                         f"{tqdm.format_interval(remaining)} left")
            self._last_report = now
