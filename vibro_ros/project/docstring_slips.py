"""Public docstrings that leave out a unit or a shape.

An entry of `Parameters`, `Attributes`, `Returns` or `Yields` whose type has a float names the unit in brackets, such as
`[m/s]`; an entry whose type has an ndarray names the shape, such as `shape (n,)`. Kernels have no types to go by, and a
summary line may say the unit in a sentence: only entries with a type are looked at.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

_SECTIONS = ("Parameters", "Attributes", "Returns", "Yields")
_SECTION = re.compile(rf"^({'|'.join(_SECTIONS)})\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", re.MULTILINE | re.DOTALL)
#: A unit in brackets, or a word that says which unit it is or that there is none.
_UNIT = re.compile(r"\[[^\]]+\]|\b(seconds?|units?|dimensionless|ratios?|factor|coefficients?|relative|log10)\b",
                   re.IGNORECASE)
#: A value of one of several types is a parameter's, which names its unit; the arrays of a container differ in shape.
_MANIFOLD = re.compile(r"\bstr\b|\bdict of|\bmapping of|\btuple of|\blist of")


def docstring_slips(root: Path) -> Iterator[str]:
    """Yield a sentence for each public entry without a unit or a shape, in the package of the repository at `root`."""
    for file in sorted((root / "vibro_ros").rglob("*.py")):
        for node in _public(ast.parse(file.read_text(encoding="utf-8")).body):
            text = ast.get_docstring(node) or ""
            for name, kind, description in _entries(text):
                if fault := _fault(kind, description, summary=text.partition("\n----")[0]):
                    yield f"{file.relative_to(root)}:{node.lineno}: {node.name}: {name}: {fault}"


def _public(body: list[ast.stmt]) -> Iterator[ast.ClassDef | ast.FunctionDef]:
    for node in body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from _public(node.body)


def _entries(text: str) -> Iterator[tuple[str, str, str]]:
    """Name, type and description of each entry in a docstring's sections."""
    for section, body in _SECTION.findall(text):
        for head, description in re.findall(r"^(\S.*)\n((?:[ ]+.*\n?|\n)*)", body, re.MULTILINE):
            name, _, kind = head.partition(" : ")
            yield (name, kind, description) if kind else (section, name, description)


def _fault(kind: str, description: str, summary: str) -> str:
    """What is missing of an entry, as a sentence; empty if nothing. A shape may be said of all in the summary."""
    if _MANIFOLD.search(kind):
        return ""
    if re.search(r"\bndarray\b", kind) and not re.search(r"\bshapes? \(", kind + description + summary):
        return "name the shape, such as `ndarray, shape (n,)`"
    if re.search(r"\bfloat\b", kind) and not _UNIT.search(description):
        return "name the unit, such as `[m/s]`, or write `dimensionless`"
    return ""
