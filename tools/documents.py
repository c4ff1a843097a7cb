"""Make the generated documents: `make documents`, or some of them, `make documents ONLY="effects map"`.

Each page has, in a comment at its end, the fingerprint of the sources that determine its numbers. `--check`, used by
`make lint`, names the documents whose sources have changed since.
"""

import argparse
import ast
import hashlib
import io
import re
import shutil
import subprocess
import sys
import time
import tokenize
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_PHYSICS = ("vibro_ros/solver", "vibro_ros/model", "vibro_ros/simulation", "config/scenes")
_SUFFIXES = {".py", ".yaml"}
_TELLS = "preparation.py"  # of the simulation, and decides no number: it says how far the compiler is


@dataclass(frozen=True)
class Document:
    """A generated document.

    Attributes
    ----------
    page : str
        Page with the fingerprint: the document, or the page that shows it.
    commands : tuple of str
        Commands that make it, each without `python -m`.
    minutes : float
        Approximate time that this takes on two cores [min].
    sources : tuple of str
        Files and folders that determine its numbers.
    copies : mapping of str to str
        Files that are copied after it is made: source to destination.
    """

    page: str
    commands: tuple[str, ...]
    minutes: float
    sources: tuple[str, ...]
    copies: Mapping[str, str] = field(default_factory=dict)


DOCUMENTS = {
    "parameters": Document(
        "docs/guide/parameters.md", ("tools.parameter_table",), 0.1,
        ("tools/parameter_table.py", "vibro_ros/model/parameters.py", "vibro_ros/configuration/scene_file.py",
         "config/scenes")),
    "topics": Document(
        "docs/guide/node.md", ("tools.topic_table",), 0.1, ("tools/topic_table.py", "vibro_ros/messages/topics.py")),
    "urdf": Document(
        "docs/robot.md", ("tools.urdf_files",), 0.1, ("tools/urdf_files.py", "vibro_ros/messages", "config/scenes")),
    "picture": Document(
        "docs/robot.md", ("tools.drawing", "tools.animation"), 1.0,
        ("tools/drawing.py", "tools/animation.py", "tools/mechanism.py", "vibro_ros/model", "config/scenes")),
    "motor": Document(
        "docs/guide/motor.md", ("tools.motor_page",), 2.0, (*_PHYSICS, "tools/motor_page.py", "tools/speeds.py")),
    "speeds": Document(
        "docs/speeds.md", ("tools.speeds",), 5.0,
        (*_PHYSICS, "lab/vibro_lab/orbits", "lab/vibro_lab/study/measures.py", "tools/speeds.py")),
    "effects": Document(
        "docs/robot.md", ("tools.effects",), 6.0, (*_PHYSICS, "lab/vibro_lab/orbits", "tools/effects.py")),
    "literature": Document(
        "docs/literature.md", ("research.literature",), 4.0,
        (*_PHYSICS, "lab/vibro_lab/orbits", "lab/research/literature", "lab/research/starts.py")),
    "map": Document(
        "docs/guide/motions.md", (
            "vibro_lab.study.command map --output out/study/map",
            "vibro_lab.study.command map --scene machine --motor-speed 90:165:16 --gap 0:0.006:4 "
            "--output out/study/map_machine"), 18.0,
        (*_PHYSICS, "lab/vibro_lab/orbits", "lab/vibro_lab/study/map.py"),
        {"out/study/map/map.png": "docs/map.png", "out/study/map_machine/map.png": "docs/map_machine.png"}),
    "accuracy": Document(
        "docs/accuracy.md", ("benchmark.run scenes --output docs",), 15.0,
        (*_PHYSICS, "lab/vibro_lab/accuracy", "lab/benchmark")),
    "benchmark": Document(
        "docs/benchmark/benchmark.md", ("benchmark.run problems --quick --output docs",), 20.0,
        (*_PHYSICS, "lab/vibro_lab/accuracy", "lab/benchmark")),
    "paper": Document(
        "docs/paper.md", ("research.paper",), 18.0, (*_PHYSICS, "lab/research/paper", "lab/research/starts.py")),
    "optimum": Document(
        "docs/speeds.md", ("research.optimum",), 30.0,
        (*_PHYSICS, "lab/vibro_lab/orbits", "lab/vibro_lab/study/optimise.py", "lab/vibro_lab/study/verification.py",
         "lab/research/optimum", "lab/research/starts.py")),
}
"""Generated documents by name, the quick ones first."""


def main(words: Sequence[str]) -> int:
    """Make documents, or check them; returns 1 if one of them failed, else 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *DOCUMENTS], metavar="NAME",
                        help=f"of {', '.join(DOCUMENTS)} (default: all)")
    parser.add_argument("--check", action="store_true", help="only name the documents that are older than their code")
    options = parser.parse_args(words)
    if options.check:
        for name in older():
            print(f"{DOCUMENTS[name].page}: {name} is older than its code; `make documents ONLY={name}` makes it")
        return 0
    return make(options.names or list(DOCUMENTS))


def older() -> list[str]:
    """Return the names of the documents whose sources have changed since their fingerprints."""
    return [name for name, document in DOCUMENTS.items()
            if found_in((ROOT / document.page).read_text(encoding="utf-8"), name) != fingerprint(document.sources)]


def make(names: Sequence[str]) -> int:
    """Make the documents one after the other, and print the remaining time."""
    planned, done, begun = sum(DOCUMENTS[name].minutes for name in names), 0.0, time.monotonic()
    for number, name in enumerate(names):
        document, passed = DOCUMENTS[name], (time.monotonic() - begun) / 60.0
        pace = passed / done if done > 1.0 else 1.0  # minutes that a planned minute takes on this machine
        print(f"documents: {name}, {number + 1} of {len(names)}; about {pace * (planned - done):.0f} min left",
              flush=True)
        for command in document.commands:
            if subprocess.run([sys.executable, "-m", *command.split()], cwd=ROOT, check=False).returncode:
                print(f"documents: {name} failed; `make documents ONLY={name}` tries it again", file=sys.stderr)
                return 1
        for made, place in document.copies.items():
            shutil.copy(ROOT / made, ROOT / place)
        page = ROOT / document.page
        page.write_text(marked(page.read_text(encoding="utf-8"), name, fingerprint(document.sources)), encoding="utf-8")
        done += document.minutes
    print(f"documents: made in {(time.monotonic() - begun) / 60.0:.0f} min")
    return 0


def fingerprint(sources: Sequence[str]) -> str:
    """Digest of files, and of all sources in folders: their names and their contents without docstrings and comments.

    Comments at the end of a line of code are not removed.
    """
    digest = hashlib.sha256()
    for source in sources:
        place = ROOT / source
        files = sorted(place.rglob("*")) if place.is_dir() else [place]
        for file in files:
            if file.is_file() and (file.suffix in _SUFFIXES or file == place) and file.name != _TELLS:
                digest.update(f"{file.relative_to(ROOT)}\0{_without_words(file)}\0".encode())
    return digest.hexdigest()[:16]


def _without_words(file: Path) -> str:
    """Return a source's lines without docstrings, comments and empty lines."""
    text = file.read_text(encoding="utf-8")
    lines = dict(enumerate(text.splitlines(), start=1))
    for token in tokenize.generate_tokens(io.StringIO(text).readline) if file.suffix == ".py" else ():
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row] = lines[row][:column].rstrip()
    for node in ast.walk(ast.parse(text)) if file.suffix == ".py" else ():
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            for number in range(node.lineno, (node.end_lineno or node.lineno) + 1):
                lines.pop(number, None)
    return "\n".join(line for line in lines.values() if line.strip() and not line.lstrip().startswith("#"))


def found_in(page: str, name: str) -> str:
    """Return the fingerprint of a document on its page; empty if the page has none."""
    found = re.search(rf"^<!-- {name}: made from sources ([0-9a-f]+) -->$", page, re.MULTILINE)
    return found[1] if found else ""


def marked(page: str, name: str, digest: str) -> str:
    """Return the page with the fingerprint of a document, which replaces an earlier one or is added at the end."""
    line = f"<!-- {name}: made from sources {digest} -->"
    text, count = re.subn(rf"^<!-- {name}: made from sources .* -->$", line, page, flags=re.MULTILINE)
    return text if count else f"{page.rstrip()}\n\n{line}\n"


def without_marks(page: str) -> str:
    """Return the page without fingerprints, as its generator has written it."""
    return re.sub(r"\n*^<!-- \w+: made from sources .* -->\n", "", page, flags=re.MULTILINE).rstrip() + "\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
