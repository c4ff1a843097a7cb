"""Make the generated documents that are stale: `make documents`, or some of them, `make documents ONLY="effects map"`.

Each measured page has, in a comment at its end, the fingerprint of what decides its numbers: the reference digests of
the device's results (`test/reference/digests.json`, which tests hold), and the statements of every definition that its
generator reaches in the packages beside the device, without comments, docstrings, annotations and names of variables.
So a change of the device that changes no bit, and a change of code that the page does not use, leave the page valid.
`--check`, used by `make lint`, names the stale pages, and fails if there are any. The tests
compare pages without measured numbers with their generators.

A document that is interrupted goes on where it was: a search or a line of a map that is finished lies in
`out/documents/NAME-FINGERPRINT`, and each document gets its fingerprint as soon as it is made.
"""

import argparse
import ast
import functools
import hashlib
import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIGESTS = ROOT / "test/reference/digests.json"
#: Packages beside the device, whose definitions count one by one.
PACKAGES = {"tools": ROOT / "tools", "research": ROOT / "lab/research", "benchmark": ROOT / "lab/benchmark",
            "vibro_lab": ROOT / "lab/vibro_lab"}
#: Reference digests that a page depends on: of runs of the shipped scenes, and of random scenes.
BITS = ("scene/", "random/")
#: Of a document's commands and copies, stands for the folder of unfinished work.
WORK = "WORK"


@dataclass(frozen=True)
class Document:
    """A generated document."""

    page: str  # page with the fingerprint: the document, or the page that shows it
    commands: tuple[str, ...]  # commands that make it, each without `python -m`
    minutes: float  # approximate time that this takes on two quiet cores [min]
    # What measures it: a definition, ``tools.speeds:motion_table``, or every definition of a module and of the modules
    # below it, ``benchmark``.
    numbers: tuple[str, ...] = ()
    # Beginnings of the names of the reference digests that it depends on; none if no test holds its text.
    bits: tuple[str, ...] = BITS
    # Files that are copied after it is made: source to destination.
    copies: Mapping[str, str] = field(default_factory=dict)

    @property
    def measured(self) -> bool:
        """Whether its numbers are measured, so that its page has a fingerprint."""
        return bool(self.numbers)


DOCUMENTS = {
    "parameters": Document("docs/guide/parameters.md", ("tools.parameter_table",), 0.1),
    "topics": Document("docs/guide/node.md", ("tools.topic_table",), 0.1),
    "urdf": Document("docs/robot.md", ("tools.urdf_files",), 0.1),
    "picture": Document("docs/robot.md", ("tools.drawing", "tools.animation"), 1.0, ("tools.animation:write_gif",),
                        ("scene/device/exact",)),
    "motor": Document(
        "docs/guide/motor.md", ("tools.motor_page",), 2.0,
        ("tools.motor_page:flywheel_table", "tools.motor_page:sommerfeld_table"), ("scene/machine/exact", "random/")),
    "speeds": Document(
        "docs/speeds.md", ("tools.speeds",), 6.0,
        ("tools.speeds:distribution_table", "tools.speeds:motion_table", "tools.speeds:cost_table")),
    "effects": Document(
        "docs/robot.md", ("tools.effects",), 6.0, ("tools.effects:tables", "tools.effects:EFFECTS",
                                                   "tools.effects:cost_ratio"), (*BITS, "effect/")),
    "literature": Document("docs/literature.md", ("research.literature",), 4.0,
                           ("research.literature.__main__:PUBLISHED",)),
    "map": Document(
        "docs/guide/motions.md", (
            f"vibro_lab.study.command map --output {WORK}/map",
            "vibro_lab.study.command map --scene machine --motor-speed 90:165:16 --gap 0:0.006:4 "
            f"--output {WORK}/map_machine"), 18.0,
        ("vibro_lab.study.map:main",), ("scene/device/exact", "scene/machine/exact", "random/"),
        {f"{WORK}/map/map.png": "docs/map.png", f"{WORK}/map_machine/map.png": "docs/map_machine.png"}),
    "accuracy": Document("docs/accuracy.md", ("benchmark.run scenes --output docs",), 15.0,
                         ("benchmark", "vibro_lab.accuracy")),
    "benchmark": Document("docs/benchmark/benchmark.md", ("benchmark.run problems --quick --output docs",), 20.0,
                          ("benchmark", "vibro_lab.accuracy")),
    "paper": Document(
        "docs/paper.md", ("research.paper",), 18.0,
        ("research.paper.runs:judged", "research.paper.runs:full_effort", "research.paper.runs:single_runs",
         "research.paper.page:draw_reading")),
    "optimum": Document(
        "docs/speeds.md", (f"research.optimum --work {WORK}",), 30.0,
        ("vibro_lab.study.optimise:main", "research.optimum.__main__:SEARCHES", "research.optimum.__main__:lasting",
         "research.optimum.__main__:papers_robots", "research.optimum.__main__:motions_of_optima")),
}
"""Generated documents by name, the quick ones first."""


def main(words: Sequence[str]) -> int:
    """Make documents, or check them; returns 1 if one of them failed or a page is stale, else 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *DOCUMENTS], metavar="NAME",
                        help=f"of {', '.join(DOCUMENTS)} (default: those that are stale or take no time)")
    parser.add_argument("--check", action="store_true", help="only name the stale pages")
    options = parser.parse_args(words)
    if not options.check:
        quick = [name for name, document in DOCUMENTS.items() if not document.measured]
        return make(options.names or [*quick, *stale()])
    names = stale()
    for name in names:
        document = DOCUMENTS[name]
        print(f"{document.page}: what decides the numbers of {name} has changed; `make documents ONLY={name}` makes "
              f"them again, about {document.minutes:g} min on two quiet cores")
    return int(bool(names))


def stale() -> list[str]:
    """Return the names of the documents whose fingerprints have changed since they were made."""
    return [name for name, document in DOCUMENTS.items() if document.measured
            and stored_fingerprint((ROOT / document.page).read_text(encoding="utf-8"), name) != fingerprint(document)]


def make(names: Sequence[str]) -> int:
    """Make the documents one after the other, and print the remaining time."""
    planned, done, begun = sum(DOCUMENTS[name].minutes for name in names), 0.0, time.monotonic()
    for number, name in enumerate(names):
        document, passed = DOCUMENTS[name], (time.monotonic() - begun) / 60.0
        pace = passed / done if done > 1.0 else 1.0  # minutes that a planned minute takes on this machine
        print(f"documents: {name}, {number + 1} of {len(names)}; about {pace * (planned - done):.0f} min left",
              flush=True)
        digest = fingerprint(document) if document.measured else ""
        work = f"out/documents/{name}-{digest}"
        for command in document.commands:
            words = command.replace(WORK, work).split()
            if subprocess.run([sys.executable, "-m", *words], cwd=ROOT, check=False).returncode:
                print(f"documents: {name} failed; `make documents ONLY={name}` tries it again", file=sys.stderr)
                return 1
        for made, place in document.copies.items():
            shutil.copy(ROOT / made.replace(WORK, work), ROOT / place)
        if document.measured:
            page = ROOT / document.page
            page.write_text(marked(page.read_text(encoding="utf-8"), name, digest), encoding="utf-8")
        done += document.minutes
    print(f"documents: made in {(time.monotonic() - begun) / 60.0:.0f} min")
    return 0


def fingerprint(document: Document) -> str:
    """Digest of the reference digests and of the definitions that decide the numbers of a document."""
    reference = json.loads(DIGESTS.read_text(encoding="utf-8"))
    parts = [f"{name} {digest}" for name, digest in sorted(reference.items()) if name.startswith(document.bits)]
    parts += [f"{module}:{name} {text}" for (module, name), text in sorted(reached(document.numbers).items())]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def reached(numbers: Sequence[str]) -> dict[tuple[str, str], str]:
    """Return the definitions that `Document.numbers` reach, as text without words, by module and name."""
    waiting = [place for number in numbers for place in _begins(number)]
    texts: dict[tuple[str, str], str] = {}
    while waiting:
        module_name, name = place = waiting.pop()
        module = module_of(module_name)
        if place in texts:
            continue
        if whole := module_of(f"{module_name}.{name}"):  # a module in the place of a value
            texts[place] = ""
            waiting += [(whole.name, defined) for defined in whole.definitions]
        elif not module:
            continue
        elif name in module.definitions:
            nodes = module.definitions[name]
            texts[place] = " ".join(_structure(node, _local_names(node)) for node in nodes)
            waiting += [used for node in nodes for used in _used(module, node)]
        elif name in module.imports:
            waiting.append(module.imports[name])
    return texts


def _begins(number: str) -> Iterator[tuple[str, str]]:
    """Yield the definitions that an entry of `Document.numbers` names."""
    module, _, name = number.partition(":")
    if name:
        yield module, name
        return
    base = PACKAGES[module.partition(".")[0]].parent.joinpath(*module.split("."))
    for file in sorted(base.rglob("*.py")) if base.is_dir() else [base.with_suffix(".py")]:
        words = file.relative_to(PACKAGES[module.partition(".")[0]].parent).with_suffix("").parts
        dotted = ".".join(words[:-1] if words[-1] == "__init__" else words)
        if whole := module_of(dotted):
            yield from ((dotted, defined) for defined in whole.definitions)


@dataclass(frozen=True)
class Module:
    """What a module defines and imports, by name; an import is a module and a name in it."""

    name: str
    definitions: dict[str, list[ast.stmt]]
    imports: dict[str, tuple[str, str]]


@functools.cache
def module_of(name: str) -> Module | None:
    """Return a module of `PACKAGES` by its dotted name; None for any other."""
    package, *words = name.split(".")
    if package not in PACKAGES:
        return None
    place = PACKAGES[package].joinpath(*words)
    file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    if not file.is_file():
        return None
    module, tree = Module(name, {}, {}), ast.parse(file.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            home = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
            for alias in node.names:
                target, _, last = (home + alias.name).rpartition(".")
                module.imports[alias.asname or alias.name.partition(".")[0]] = (target, last)
    for statement in tree.body:
        for defined in _defined(statement):
            module.definitions.setdefault(defined, []).append(statement)
    return module


def _defined(statement: ast.stmt) -> list[str]:
    """Return the names that a statement of a module defines."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return [statement.name]
    targets = statement.targets if isinstance(statement, ast.Assign) else (
        [statement.target] if isinstance(statement, ast.AnnAssign) else [])
    return [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]


def _used(module: Module, statement: ast.stmt) -> Iterator[tuple[str, str]]:
    """Yield the definitions that a statement names: of its module, or of a module that it imports as a whole."""
    for node in ast.walk(statement):
        if isinstance(node, ast.Name):
            yield module.name, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in module.imports:
            package, last = module.imports[node.value.id]
            yield f"{package}.{last}" if package else last, node.attr


#: Fields of a node that decide nothing, or that not every version of Python has.
_WORDS = {"annotation", "returns", "ctx", "kind", "type_comment", "type_params", "type_ignores"}


def _local_names(statement: ast.stmt) -> dict[str, str]:
    """Return numbers for the parameters and variables within a statement in their order, so that names do not count."""
    names = (node.arg if isinstance(node, ast.arg) else node.id for node in ast.walk(statement)
             if isinstance(node, ast.arg) or isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store))
    return {name: f"v{number}" for number, name in enumerate(dict.fromkeys(names)) if name not in _defined(statement)}


def _structure(node: object, local: Mapping[str, str]) -> str:
    """Return a syntax tree as text, without docstrings, annotations and positions, and with numbers for `local` names;
    the same for every Python.
    """
    if isinstance(node, list):
        return f"[{' '.join(_structure(part, local) for part in node if not _is_docstring(part))}]"
    if isinstance(node, ast.arg):
        return local[node.arg]
    if isinstance(node, ast.Name):
        return local.get(node.id, node.id)
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = (_structure(value, local) for name, value in ast.iter_fields(node)
              if name not in _WORDS and value is not None)
    return f"({type(node).__name__} {' '.join(fields)})"


def _is_docstring(node: object) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def stored_fingerprint(page: str, name: str) -> str:
    """Return the fingerprint of a document on its page; empty if the page has none."""
    mark = re.search(rf"^<!-- {name}: made from sources ([0-9a-f]+) -->$", page, re.MULTILINE)
    return mark[1] if mark else ""


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
