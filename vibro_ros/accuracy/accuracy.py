"""Executable ``accuracy``: what a digit of accuracy costs with every method, for a scene."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("accuracy"))

import argparse
import csv
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import astuple, fields, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from tqdm import tqdm

from vibro_ros.accuracy.diagram import draw_precision
from vibro_ros.accuracy.findings import (
    advice,
    baseline_in_words,
    findings,
    markdown,
    prices_in_words,
    reference_in_words,
    reference_of,
    speeds_table,
)
from vibro_ros.accuracy.measurement import Measurement
from vibro_ros.accuracy.methods import STUDIED, ComparedMethod, UnableError
from vibro_ros.accuracy.precision import INSTANTS, LEAST_TIME, RATE, RUNNING_SPEED, Effort, Growth, SceneStudy
from vibro_ros.configuration.scene_file import load_scene, shipped_scenes
from vibro_ros.orbits.starts import SETTLING
from vibro_ros.process.entry_point import FAILURE, Parser, exit_code, interrupted_code, say
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.simulation.motion import SimulationError
from vibro_ros.simulation.preparation import prepare_kernels

TABLE, TEXT = "accuracy.csv", "accuracy.md"
_PACKAGES = ("numpy", "numba", "scipy")
#: What is measured unless an option asks for more or less.
EFFORT = Effort()
_LEAST_HORIZON = 1e-3  # s, one sample


@contextmanager
def row_writer(path: Path):
    """Give a function that appends a `Measurement` to a new CSV file, on disk before it returns."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([field.name for field in fields(Measurement)])

        def write(row: Measurement) -> None:
            # more digits than any text shows: who makes the text from the rows again gets the same one
            writer.writerow(f"{cell:.10g}" if isinstance(cell, float) else cell for cell in astuple(row))
            file.flush()

        file.flush()
        yield write


def machine() -> str:
    """What costs depend on: versions, processor, date."""
    versions = ["vibro_ros from source", f"Python {platform.python_version()}",
                *(f"{package} {metadata.version(package)}" for package in _PACKAGES)]
    with suppress(metadata.PackageNotFoundError):
        versions[0] = f"vibro_ros {metadata.version('vibro_ros')}"
    return (f"{', '.join(versions)}; {platform.system()} {platform.machine()}, {os.cpu_count()} cores; "
            f"{datetime.now(UTC):%Y-%m-%d}")


class Accuracy:
    """A study of scenes that keeps what it has measured.

    Attributes
    ----------
    rows : dict
        Scene to its rows so far.
    growths : dict
        Scene to its `Growth`.
    """

    def __init__(self, methods: Mapping[str, ComparedMethod], effort: Effort, say: Callable[[str], None] = tqdm.write):
        self._methods, self._effort, self._say = methods, effort, say
        self.rows: dict[str, list[Measurement]] = {}
        self.growths: dict[str, Growth] = {}

    def measure(self, scene_name: str, write: Callable[[Measurement], None], effort: Effort | None = None) -> None:
        """Measure a scene, with a progress bar; each row is handed to `write` at once."""
        scene = load_scene(scene_name)
        self._say(f"{scene.name}: chaos and reference ...")
        study = SceneStudy(scene, effort or self._effort)
        self.growths[scene.name] = study.growth
        self._say(f"{scene.name}: {study.growth}")
        self._say(f"{scene.name}: {reference_in_words(study.comparison.uncertainty)}")
        rows = self.rows.setdefault(scene.name, [])
        with tqdm(total=study.count(self._methods), desc=scene.name, unit="row", disable=None) as bar:
            for row in study.rows(self._methods):
                rows.append(row)
                write(row)
                bar.set_postfix_str(f"{row.method} {row.value:g}")
                bar.update()
        for text in self.findings(scene.name):
            self._say(f"{scene.name}: {text}")

    def findings(self, name: str) -> list[str]:
        """What the rows of a scene tell, one sentence each."""
        rows = self.rows[name]
        advised = advice(rows, self.growths[name].comparable).items()
        return [*prices_in_words({name: rows}), *(f"{need[0].upper()}{need[1:]}: {use}." for need, use in advised),
                *findings(rows)]

    def write_text_and_diagrams(self, folder: Path, interrupted: bool) -> tuple[Path, ...]:
        """Write what the rows measured so far tell; returns the files."""
        pictures = self.draw(folder)
        parts = ["# What accuracy costs"]
        if interrupted:
            parts += ["", "**Interrupted: only a part was measured.**"]
        for name in pictures:
            parts += ["", f"Findings in the scene `{name}`, in brackets costs, RK4 = 1:", "",
                      *(f"- {text}" for text in self.findings(name))]
        parts += ["", self.how_measured()]
        for name, picture in pictures.items():
            parts += ["", self.section(name, picture.name), "", markdown(self.rows[name])]
        text = folder / TEXT
        text.write_text("\n".join(parts) + "\n", encoding="utf-8")
        return text, *pictures.values()

    def how_measured(self) -> str:
        """Machine, rounds and baseline, in Markdown."""
        return (f"Measured on: {machine()}.\n\n"
                f"{baseline_in_words(self.rows)} Costs are medians of at most {self._effort.repeats} rounds, each the "
                f"median of the runs that {LEAST_TIME:g} s allow, as ratios to the baseline, run in turn with them. "
                f"Every run whose cost is measured is sampled at {RATE:g} Hz. A ladder ends where a run takes more "
                f"than {self._effort.patience:g} s.\n\n"
                f"Errors are looked for in other runs, at {INSTANTS} instants of each horizon that lie off the grids "
                "of samples and steps; `every position` is the body along the ground, its height and both masses. A "
                f"scene whose motor stands still at first is studied running, at {RUNNING_SPEED:g} rad/s from the "
                f"start. A mean speed is that of {self._effort.duration:g} s, after {SETTLING:g} s to settle; its "
                "starts are independent: in the first second motor speed and gaps are drawn at random. "
                "Fewer than 95 of 100 intervals hold where a rare start goes far astray, as by `rk4` at 0.0001 s in "
                "`paper`.")

    def draw(self, folder: Path) -> dict[str, Path]:
        """Draw every scene that has rows; scene to its diagram."""
        pictures = {}
        for name, rows in self.rows.items():
            if rows:
                pictures[name] = folder / f"{Path(name).stem}.png"
                caption = f"{self.growths[name]}; medians of at most {self._effort.repeats} rounds\n{machine()}"
                draw_precision(rows, caption).savefig(pictures[name])
        return pictures

    def section(self, name: str, picture: str) -> str:
        """One scene in Markdown: diagram, chaos, reference and mean speeds."""
        rows, chaos = self.rows[name], str(self.growths[name])
        reference, allowed = reference_of(rows), self.growths[name].comparable
        if reference.horizon > allowed:
            horizon = (f"Trajectories are compared within {reference.horizon:g} s as asked for, BEYOND the "
                       f"{allowed:.2g} s that chaos allows: the errors show it as much as the methods.")
        else:
            horizon = f"Trajectories are compared within {reference.horizon:g} s only; beyond, averages are."
        return "\n\n".join([f"## {name}", f"![{name}: error over cost, and mean speed over the step]({picture})",
                            f"{chaos[0].upper()}{chaos[1:]}. {horizon}", reference_in_words(reference),
                            speeds_table(rows)])


def chosen_methods(names: Sequence[str] | None, studied: Mapping[str, ComparedMethod]) -> dict[str, ComparedMethod]:
    """The methods named of those `studied`, in their order; all for None.

    Raises
    ------
    ValueError
        For no name, and for a name that is not studied.
    """
    if names is not None and not names:
        raise ValueError(f"--methods: none named; methods are {', '.join(studied)}")
    for name in names or ():
        if name not in studied:
            raise ValueError(f"{name or repr(name)}: no such method; methods are {', '.join(studied)}")
    return {name: method for name, method in studied.items() if names is None or name in names}


def main(words: Sequence[str], studied: Mapping[str, ComparedMethod] = STUDIED, effort: Effort = EFFORT) -> int:
    """Run the executable with the methods `studied` and what the words leave of `effort`; returns its exit code."""
    return exit_code("accuracy", lambda: _measure(_parser(studied, effort).parse_args(words), studied, effort))


def _measure(options: argparse.Namespace, studied: Mapping[str, ComparedMethod], effort: Effort) -> int:
    try:
        methods = chosen_methods(options.methods, studied)
        effort = _asked_effort(options, effort)
        scenes = shipped_scenes() if options.all else [options.scene]
        for scene in scenes:
            load_scene(scene)  # one that is not there is refused before anything is written
        options.output.mkdir(parents=True, exist_ok=True)
        prepare_kernels("accuracy", "auto")  # the baseline needs those of fixed steps
        return _run(scenes, Accuracy(methods, effort), options.output)
    except KeyboardInterrupt:
        say("accuracy", f"interrupted before the diagrams; the rows are in {options.output / TABLE}")
        return interrupted_code()
    except OSError as error:
        raise ValueError(f"{error.filename}: {error.strerror}; give a readable scene and a writable "
                         "--output") from error


def _run(scenes: Sequence[str], study: Accuracy, folder: Path) -> int:
    code, interrupted = 0, False
    with row_writer(folder / TABLE) as write:
        try:
            for scene in scenes:
                try:
                    study.measure(scene, write)
                except (SimulationError, UnableError) as error:
                    say("accuracy", f"{scene}: exact cannot simulate it: {error}")
                    code = FAILURE
        except KeyboardInterrupt:
            code, interrupted = interrupted_code(), True
            say("accuracy", "interrupted; what was measured is kept")
    print("\n".join(map(str, (folder / TABLE, *study.write_text_and_diagrams(folder, interrupted)))))
    return code


def _asked_effort(options: argparse.Namespace, effort: Effort) -> Effort:
    if options.repeats < 1:
        raise ValueError(f"--repeats {options.repeats}: must be at least 1")
    if options.horizon is not None and not _LEAST_HORIZON <= options.horizon <= 1e3:
        raise ValueError(f"--horizon {options.horizon:g}: must be from {_LEAST_HORIZON:g} to 1000 s")
    if options.starts < 2:
        raise ValueError(f"--starts {options.starts}: must be at least 2, or there is no confidence interval")
    if not options.patience > 0.0:
        raise ValueError(f"--patience {options.patience:g}: must be positive")
    return replace(effort, repeats=options.repeats, horizon=options.horizon, starts=options.starts,
                   patience=options.patience, patience_for_averages=4.0 * options.patience)


def _parser(studied: Mapping[str, ComparedMethod], default: Effort) -> Parser:
    parser = Parser(
        prog="accuracy",
        description=f"{EXECUTABLES['accuracy'].does} The table is Markdown and CSV. Ctrl-C keeps what is done.",
        epilog="Exit code 0: all measured; 1: a scene cannot be simulated; 2: bad input, or nowhere to write; 129, "
        "130, 143: interrupted by SIGHUP, SIGINT, SIGTERM, what was measured is written.")
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--scene", metavar="NAME", help="shipped scene or scene file")
    which.add_argument("--all", action="store_true", help="every shipped scene")
    parser.add_argument("--methods", nargs="*", metavar="METHOD", help=f"of {', '.join(studied)} "
                        "(default: all)")
    parser.add_argument("--horizon", type=float, metavar="S", help="compare trajectories within so many seconds "
                        "(default: 5 Lyapunov times, 1 s at most)")
    parser.add_argument("--repeats", type=int, default=default.repeats, metavar="N",
                        help=f"rounds of runs of which the median cost is taken (default: {default.repeats})")
    parser.add_argument("--starts", type=int, default=default.starts, metavar="N",
                        help=f"starts of a mean speed (default: {default.starts})")
    parser.add_argument("--patience", type=float, default=default.patience, metavar="S", help="run time after which a "
                        "setting is not repeated nor a finer one tried; four times that for a mean speed's starts "
                        f"(default: {default.patience:g})")
    parser.add_argument("--output", type=Path, default=Path("out/accuracy"), metavar="DIR",
                        help="where to write (default: out/accuracy)")
    return parser
