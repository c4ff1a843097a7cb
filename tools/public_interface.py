"""Compare the Python interface with that of the last release, by griffe: `python -m tools.public_interface --check`.

`released_interface.txt` has the public names of the device with their parameters, as the last release has them. It lies
in the repository, so that a clone without tags and a clone without history have it too. A release writes it:
`python -m tools.public_interface`.
"""

import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import griffe

ROOT = Path(__file__).resolve().parents[1]
FILE = Path(__file__).with_name("released_interface.txt")
HEAD = "# Public names of version {}; written by `python -m tools.public_interface`."


def interface() -> str:
    """Return the public names of the code as a stub file has them, each class with what it inherits."""
    package = griffe.load("vibro_ros", search_paths=[ROOT])
    return "\n".join(line for name in sorted(map(str, package.exports or ()))
                     for line in _lines(name, _target(package[name]), "")) + "\n"


def breakages(released: str, public: str) -> list[str]:
    """Return in words, a line each, what a program written for one stub misses in another."""
    old, new = (griffe.visit("vibro_ros", FILE, text) for text in (released, public))
    style = griffe.ExplanationStyle.ONE_LINE
    breakages = [breakage.explain(style).partition(": ")[2] for breakage in griffe.find_breaking_changes(old, new)]
    return [re.sub(r"\x1b\[\d+m", "", line) for line in breakages]  # without colours


def complaints(released: str, public: str, version: str) -> list[str]:
    """Return a line for each promise of the release that the code breaks; none where the major version has risen."""
    promised = re.search(r"version ([\d.]+);", released)[1]  # type: ignore[index]
    if _major(version) > _major(promised):
        return []
    return [f"interface: {line}; version {promised} has it: bring it back, or give package.xml a new major version and "
            "name the change with its remedy in CHANGELOG.md" for line in breakages(released, public)]


def main(words: Sequence[str] = ()) -> int:
    """Write the stub, or with `--check` compare; returns 1 if a name went without a new major version."""
    version = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version") or ""
    if "--check" not in words:
        FILE.write_text(f"{HEAD.format(version)}\n{interface()}", encoding="utf-8")
        return 0
    lost = complaints(FILE.read_text(encoding="utf-8"), interface(), version)
    print("\n".join(lost), end="\n" * bool(lost), file=sys.stderr)
    return bool(lost)


def _lines(name: str, member: griffe.Object, indent: str) -> Iterator[str]:
    if isinstance(member, griffe.Class):
        yield f"{indent}class {name}:"
        inner = {name: _target(part) for name, part in sorted(member.all_members.items())
                 if part.is_public and not name.startswith("__") or name == "__init__"}
        for inner_name, part in inner.items():
            yield from _lines(inner_name, part, indent + "    ")
        if not inner:
            yield f"{indent}    ..."
    elif isinstance(member, griffe.Function):
        yield f"{indent}def {member.signature(name=name)}: ...".replace("(/, ", "(")  # griffe leaves `self` out alone
    elif isinstance(member, griffe.Attribute):
        yield f"{indent}{name}: {member.annotation or 'object'}"


def _target(member: griffe.Object | griffe.Alias) -> griffe.Object:
    return member.final_target if isinstance(member, griffe.Alias) else member


def _major(version: str) -> int:
    return int(version.partition(".")[0])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
