"""`study literature`: published results of other machines beside this model, with verdicts and pictures."""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from research.literature import capsule_finding, gap_speed_finding, impact_oscillator_finding, two_phase_finding
from research.literature.published import VERDICTS, Finding, Studied, as_data, from_data, in_lines, overview, section
from vibro_ros.process.front_door import FAILURE, Parser, exit_code, say
from vibro_ros.process.stop_signals import interrupted_code
from vibro_ros.simulation.preparation import prepare_kernels

PUBLISHED: dict[str, Callable[[bool], Studied]] = {
    module.NAME: module.study
    for module in (capsule_finding, impact_oscillator_finding, two_phase_finding, gap_speed_finding)}
"""Every study of a publication by its name."""

TEXT, DATA = "literature.md", "findings.json"


def picture_name(name: str) -> str:
    """File name of a study's picture."""
    return f"{name}.png"


def found(names: Sequence[str], quick: bool, folder: Path) -> Iterator[Finding]:
    """Each study's finding in turn, its picture in `folder` before it is yielded."""
    for name in names:
        studied = PUBLISHED[name](quick)
        studied.draw().savefig(folder / picture_name(name), dpi=110)
        yield studied.finding


def document(findings: Sequence[Finding], pictures: str, opening: str) -> str:
    """The findings as a document in Markdown.

    Parameters
    ----------
    findings : sequence of Finding
        In the order of the document.
    pictures : str
        Folder of the pictures, as seen from the document, with a slash at its end if it is not empty.
    opening : str
        What stands before the first finding.
    """
    words = "\n".join(f"- **{verdict}**: {meaning}" for verdict, meaning in VERDICTS.items())
    parts = [opening, words, overview(list(findings)),
             *(section(finding, f"{pictures}{picture_name(finding.name)}") for finding in findings)]
    return "\n\n".join(parts) + "\n"


def write_findings(findings: Sequence[Finding], path: Path) -> None:
    """Write findings as JSON, from which `read_findings` makes the same again."""
    text = json.dumps([as_data(finding) for finding in findings], indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_findings(path: Path) -> list[Finding]:
    """The findings of a file by `write_findings`."""
    return [from_data(data) for data in json.loads(path.read_text(encoding="utf-8"))]


def main(words: Sequence[str]) -> int:
    """Run the study; returns its exit code."""
    return exit_code("study literature", lambda: _study(words))


def _study(words: Sequence[str]) -> int:
    options = _parser().parse_args(words)
    names = _chosen(options.names)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"--output {options.output}: {error.strerror}; give a folder that can be written") from error
    prepare_kernels("study literature", "exact")
    return _run(names, options)


def _run(names: Sequence[str], options: argparse.Namespace) -> int:
    findings: list[Finding] = []
    code = 0
    try:
        for finding in found(names, options.quick, options.output):
            findings.append(finding)
            print("\n".join(in_lines(finding)), flush=True)
    except (RuntimeError, OSError) as error:
        code = FAILURE
        say("study literature", f"{error}; {len(findings)} of {len(names)} studies are kept")
    except KeyboardInterrupt:
        code = interrupted_code()
        say("study literature", f"interrupted; {len(findings)} of {len(names)} studies are kept")
    opening = "# Published results beside this model"
    if len(findings) < len(names):
        opening += f"\n\n**Not complete: {len(findings)} of {len(names)} studies.**"
    text = options.output / TEXT
    text.write_text(document(findings, "", opening), encoding="utf-8")
    write_findings(findings, options.output / DATA)
    print(text)
    return code


def _chosen(names: Sequence[str]) -> list[str]:
    for name in names:
        if name not in PUBLISHED:
            raise ValueError(f"{name or repr(name)}: no such study; studies are {', '.join(PUBLISHED)}")
    return [name for name in PUBLISHED if not names or name in names]


def _parser() -> Parser:
    parser = Parser(
        prog="study literature",
        description="Hold published results of other machines against the model: mapping, check, claims, verdicts.",
        epilog="Exit code 0: done; 1: a run failed; 2: bad input, or nowhere to write; 129, 130, 143: stopped by "
        "SIGHUP, SIGINT, SIGTERM, finished studies are written.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PUBLISHED)} (default: all)")
    parser.add_argument("--quick", action="store_true",
                        help="fewer machines, gaps and starts, no one-way wheels; seconds")
    parser.add_argument("--output", type=Path, default=Path("out/study/literature"), metavar="DIR",
                        help="where to write (default: %(default)s)")
    return parser
