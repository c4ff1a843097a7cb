"""Executable ``accuracy``: measure error and cost of every method for a scene."""

if __name__ == "__main__":  # before all imports, which take a second or two, in which a signal may arrive
    import sys

    from vibro_lab.executables import accuracy

    sys.exit(accuracy())

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tqdm import tqdm

from vibro_lab.accuracy.harness import EXPONENT, REFERENCE, Effort, Row, machine, row_writer
from vibro_lab.accuracy.programs import DEVICE, Program, Setting, UnableError
from vibro_lab.accuracy.report import advice, draw_scene, finding, reference_in_words
from vibro_lab.accuracy.scene_rows import AVERAGED, OWN_CHECK, lyapunov_time_in, rows_of_scene
from vibro_lab.executables import EXECUTABLES
from vibro_ros import Parser, SimulationError, exit_code, interrupted_code, load_scene, png, say, shipped

TABLE = "accuracy.csv"
_LEAST_HORIZON = 1e-3  # s, one sample


def measure(scene_name: str, programs: Mapping[str, Program], effort: Effort, write: Callable[[Row], None],
            checks: Sequence[tuple[Program, Setting]] = (OWN_CHECK,)) -> list[Row]:
    """Measure and return the rows of a scene with a progress bar; each row is passed to `write` at once."""
    measured: list[Row] = []
    scene = load_scene(scene_name)
    tqdm.write(f"{scene.name}: chaos and reference ...")
    with tqdm(desc=scene.name, unit="row", disable=None) as bar:
        for row in rows_of_scene(scene, programs, effort, checks):
            measured.append(row)
            write(row)
            if row.compared == EXPONENT:
                tqdm.write(f"{scene.name}: {lyapunov_time_in(measured)}")
            elif row.compared == REFERENCE:
                tqdm.write(f"{scene.name}: {reference_in_words(row)}")
            bar.set_postfix_str(f"{row.program} {row.setting}")
            bar.update()
    return measured


def findings(rows: Sequence[Row]) -> list[str]:
    """Return the findings from the rows of a scene, in sentences."""
    return [*(f"{need[0].upper()}{need[1:]}: {use}." for need, use in advice(rows).items()),
            *(finding(rows, method) for method in AVERAGED)]


def draw(rows: Mapping[str, Sequence[Row]], effort: Effort, folder: Path) -> dict[str, Path]:
    """Draw the diagram of every scene whose reference was checked; returns the files by scene."""
    pictures = {}
    for name, measured in rows.items():
        if any(row.compared == REFERENCE for row in measured):
            pictures[name] = folder / f"{Path(name).stem}.png"
            caption = f"{lyapunov_time_in(measured)}; medians of at most {effort.repeats} rounds\n{machine()}"
            pictures[name].write_bytes(png(draw_scene(measured, caption)))
    return pictures


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code."""
    return exit_code("accuracy", lambda: _measure(_parser().parse_args(words)))


def _measure(options: argparse.Namespace) -> int:
    try:
        effort = _asked_effort(options)
        scenes = shipped("scene") if options.all else [options.scene]
        for scene in scenes:
            load_scene(scene)  # a missing scene is refused before anything is written
        options.output.mkdir(parents=True, exist_ok=True)
        return _run(scenes, effort, options.output)
    except KeyboardInterrupt:
        say("accuracy", f"interrupted before the diagrams; the rows are in {options.output / TABLE}")
        return interrupted_code()
    except OSError as error:
        raise ValueError(f"{error.filename}: {error.strerror}; give a readable scene and a writable "
                         "--output") from error


def _run(scenes: Sequence[str], effort: Effort, folder: Path) -> int:
    code = 0
    rows: dict[str, list[Row]] = {}
    with row_writer(folder / TABLE) as write:
        try:
            for scene in scenes:
                def keep(row: Row) -> None:
                    rows.setdefault(row.problem, []).append(row)
                    write(row)

                try:
                    for text in findings(measure(scene, DEVICE, effort, keep)):
                        tqdm.write(f"{scene}: {text}")
                except (SimulationError, UnableError) as error:
                    say("accuracy", f"{scene}: exact cannot simulate it: {error}")
                    code = 1
        except KeyboardInterrupt:
            code = interrupted_code()
            say("accuracy", "interrupted; what was measured is kept")
    print("\n".join(map(str, (folder / TABLE, *draw(rows, effort, folder).values()))))
    return code


def _asked_effort(options: argparse.Namespace) -> Effort:
    if options.horizon is not None and not _LEAST_HORIZON <= options.horizon <= 1e3:
        raise ValueError(f"--horizon {options.horizon:g}: must be from {_LEAST_HORIZON:g} to 1000 s")
    if options.starts < 2:
        raise ValueError(f"--starts {options.starts}: must be at least 2, or there is no confidence interval")
    if not options.patience > 0.0:
        raise ValueError(f"--patience {options.patience:g}: must be positive")
    return Effort(horizon=options.horizon, starts=options.starts, patience=options.patience,
                  patience_for_averages=4.0 * options.patience)


def _parser() -> Parser:
    default = Effort()
    parser = Parser(
        prog="accuracy",
        description=f"{EXECUTABLES['accuracy'].does} Rows are CSV. Ctrl-C keeps what is done.",
        epilog="Exit code 0: all measured; 1: a scene cannot be simulated; 2: bad input, or nowhere to write; 129, "
        "130, 143: interrupted by SIGHUP, SIGINT, SIGTERM, what was measured is written.")
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--scene", metavar="NAME", help="shipped scene or scene file")
    which.add_argument("--all", action="store_true", help="every shipped scene")
    parser.add_argument("--horizon", type=float, metavar="S", help="compare trajectories within so many seconds "
                        "(default: 5 Lyapunov times, 1 s at most)")
    parser.add_argument("--starts", type=int, default=default.starts, metavar="N",
                        help=f"starts of a mean speed (default: {default.starts})")
    parser.add_argument("--patience", type=float, default=default.patience, metavar="S", help="run time after which a "
                        "setting is not repeated nor a finer one tried; four times that for a mean speed's starts "
                        f"(default: {default.patience:g})")
    parser.add_argument("--output", type=Path, default=Path("out/accuracy"), metavar="DIR",
                        help="where to write (default: out/accuracy)")
    return parser
