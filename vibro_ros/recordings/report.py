"""The `report` executable: summarises a recording, or compares two, in words, numbers and a picture."""

if __name__ == "__main__":  # before all imports: they take a second or two, in which a signal may come
    import sys

    from vibro_ros.process.entry_point import enter

    sys.exit(enter("report"))

import json
from collections.abc import Sequence
from pathlib import Path

from vibro_ros.bag.stream import BagError, bag_errors
from vibro_ros.process.entry_point import Parser, exit_code
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.process.files import one_line, user_path
from vibro_ros.process.pictures import png
from vibro_ros.recordings.energy import energy_of
from vibro_ros.recordings.plots import plot_pair, plot_run
from vibro_ros.recordings.summary import as_caption, as_text, load_samples, pair_as_text, summarise


def write_report(bag_folder: Path, output: Path | None = None,
                 other: Path | None = None) -> tuple[str, tuple[Path, ...]]:
    """Write summary.txt, summary.json and report.png about a recording, or about two in comparison.

    They go into the folder `output`, which is made if missing, by default ``<bag folder>_report`` or ``<bag
    folder>_against_<name of the other>`` beside the recording. Nothing is ever written into a recording. Returns the
    summary as text, and the files written. BagError when a recording cannot be read or `output` lies inside it;
    OSError when `output` cannot be written.
    """
    folders = [user_path(given).resolve() for given in (bag_folder, other) if given]
    ending = f"against_{folders[1].name}" if other else "report"
    output = user_path(output).resolve() if output else folders[0].with_name(f"{folders[0].name}_{ending}")
    if any(output.is_relative_to(folder) for folder in folders):
        raise BagError(f"{output}: lies inside the recording, which is never written to; give another --output")
    bags = [load_samples(folder) for folder in folders]
    summaries = [summarise(bag) | {"energy": energy_of(bag)} for bag in bags]
    if other:
        text, figure = pair_as_text(*summaries), plot_pair(*bags)
    else:
        text, figure = as_text(summaries[0]), plot_run(bags[0], as_caption(summaries[0]), summaries[0]["energy"])
    output.mkdir(parents=True, exist_ok=True)
    files = tuple(output / name for name in ("summary.txt", "summary.json", "report.png"))
    files[0].write_text(text, encoding="utf-8")
    written = json.dumps(summaries if other else summaries[0], indent=2, ensure_ascii=False)
    files[1].write_text(f"{written}\n", encoding="utf-8")
    files[2].write_bytes(png(figure))
    return text, files


def main(words: Sequence[str]) -> int:
    """Run the executable; returns its exit code, 2 when the recording cannot be reported on."""
    return exit_code("report", lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    with bag_errors(options.bag):
        try:
            text, files = write_report(options.bag, options.output, options.other)
        except OSError as error:
            where = error.filename or options.output or f"{options.bag}_report"
            raise BagError(f"{where}: cannot write: {error.strerror or error}; give a writable --output") from error
    print(text)
    print("\n".join(map(one_line, files)))
    return 0


def _parser() -> Parser:
    parser = Parser(prog="report", description=f"{EXECUTABLES['report'].does} Distance, speed, impacts, power and gaps "
                    "in the stream are summed up; of two recordings, their differences.",
                    epilog="Exit code 0: written; 2: no readable recording, or nowhere to write; 129, 130, 143: "
                    "stopped by SIGHUP, SIGINT, SIGTERM.")
    parser.add_argument("bag", type=Path, metavar="BAG_FOLDER", help="folder of the recording")
    parser.add_argument("other", type=Path, metavar="OTHER_BAG_FOLDER", nargs="?",
                        help="a second recording: one table and one picture compare the two")
    parser.add_argument("--output", type=Path, metavar="DIR",
                        help="where to write (default: BAG_FOLDER_report, or BAG_FOLDER_against_OTHER)")
    return parser
