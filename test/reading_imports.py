"""What modules import, and what docs/architecture.md draws; for the tests of both packages."""

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def drawn_arrows(head: str, package: str) -> dict[str, set[str]]:
    """Return the rooms that each room imports, from the picture with a `head`; "" is the package's own `__init__`."""
    picture = re.search(rf"^```txt\n( {head} →.*?)^```", ARCHITECTURE, re.MULTILINE | re.DOTALL)[1]
    head, *lines = picture.splitlines()
    column = {number.end() - 1: int(number[0]) for number in re.finditer(r"\d+", head)}
    rows = {int(line.split()[0]): line for line in lines}
    room = {number: line.split()[1].replace(package, "") for number, line in rows.items()}
    marks = {number: [column[mark.start()] for mark in re.finditer("●", line)] for number, line in rows.items()}
    assert list(room) == list(column.values()) == list(range(1, len(room) + 1))
    assert all(mark < number for number, row in marks.items() for mark in row), "an arrow points outwards"
    return {room[number]: {room[mark] for mark in row} for number, row in marks.items()}


def imported(module: str, source: str) -> Iterator[str]:
    """Yield the dotted name of everything that a module's source imports, at any depth of the text."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = module.split(".")[: -node.level] if node.level else []
            origin = ".".join([*parents, *filter(None, [node.module])])
            yield from (f"{origin}.{name.name}" for name in node.names)


def sources_in(folder: Path) -> dict[str, str]:
    """Return the source of every module in a package's folder by its dotted name."""
    files = sorted(folder.rglob("*.py"))
    return {".".join(file.relative_to(folder.parent).with_suffix("").parts): file.read_text() for file in files}


def summaries(folder: Path) -> dict[str, str]:
    """Return the first line of the docstring of each room in a package's folder."""
    return {file.parent.name: ast.get_docstring(ast.parse(file.read_text())).splitlines()[0]
            for file in folder.glob("*/__init__.py")}


def told_rooms(section: str) -> dict[str, str]:
    """Return what the table of rooms in a section of docs/architecture.md says of each."""
    text = ARCHITECTURE.partition(f"\n{section}\n")[2].partition("\n## ")[0]
    return dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.MULTILINE))


def cycle(sources: dict[str, str]) -> list[str]:
    """Return the modules of one import cycle among {dotted name: source}, empty if there is none."""
    names = {module.removesuffix(".__init__"): set(imported(module, source)) for module, source in sources.items()}
    graph = {module: {_owner(name, names) for name in wanted} - {module, None} for module, wanted in names.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def _owner(name: str, modules: dict[str, set[str]]) -> str | None:
    """Return the module that an imported name is, or in which it is defined."""
    return name if name in modules else next(iter({name.rpartition(".")[0]} & modules.keys()), None)
