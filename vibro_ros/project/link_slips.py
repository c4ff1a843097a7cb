"""Links that lead nowhere: from document to document, and from sources to documents."""

import re
from collections.abc import Iterator
from pathlib import Path

from vibro_ros.project.pages import Page, pages


def link_slips(root: Path) -> Iterator[str]:
    """Yield a sentence for each link to a file or an anchor that does not exist, in the repository at `root`.

    Sources may name documents, too, such as docs/architecture.md.
    """
    every = {page.path: page for page in pages(root)}
    for page in every.values():
        for place, link in page.links():
            name, _, anchor = link.partition("#")
            target = (page.path.parent / name) if name else page.path
            target = Path(*_resolved(target.parts))
            if not (root / target).exists():
                yield f"{place}: the link {link} leads to no file"
            elif anchor and not _has(every.get(target), anchor):
                yield f"{place}: the link {link} leads to no heading of {target}"
    for file in (root / "Makefile", *sorted(root.glob("vibro_ros/**/*.py"))):
        for name in sorted(set(re.findall(r"\bdocs/[\w/]+\.\w+", file.read_text(encoding="utf-8")))):
            if not (root / name).exists():
                yield f"{file.relative_to(root)}: there is no {name}"


def _resolved(parts: tuple[str, ...]) -> list[str]:
    """The parts of a path without `..`."""
    kept: list[str] = []
    for part in parts:
        if part == ".." and kept:
            kept.pop()
        else:
            kept.append(part)
    return kept


def _has(page: Page | None, anchor: str) -> bool:
    return page is not None and anchor in page.anchors
