"""The repository's documents, as what checks them reads them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_TOKEN = r"`([^`\n]+)`"
_LINK = r"\]\(([^)\s]+)\)"
_HEADING = re.compile(r"^#+ +(.+?) *$", re.MULTILINE)


@dataclass(frozen=True)
class Page:
    """A Markdown document.

    Attributes
    ----------
    root : Path
        The repository.
    path : Path
        The file, from the root.
    """

    root: Path
    path: Path

    @cached_property
    def text(self) -> str:
        """All of it."""
        return (self.root / self.path).read_text(encoding="utf-8")

    @cached_property
    def prose(self) -> str:
        """The text with blanks in the place of fenced blocks: as many lines."""
        return _FENCE.sub(lambda block: "\n" * block[0].count("\n"), self.text)

    def found(self, pattern: str, text: str) -> Iterator[tuple[str, re.Match]]:
        """Each match in `text`, which has the page's lines, with the place that a message begins with."""
        for match in re.compile(pattern, re.MULTILINE).finditer(text):
            yield f"{self.path}:{text.count(chr(10), 0, match.start()) + 1}", match

    def tokens(self) -> Iterator[tuple[str, str]]:
        """What stands between backticks outside fenced blocks, each with its place."""
        return ((place, match[1]) for place, match in self.found(_TOKEN, self.prose))

    def links(self) -> Iterator[tuple[str, str]]:
        """Targets of links and pictures, each with its place; those to other hosts are left out."""
        return ((place, match[1]) for place, match in self.found(_LINK, self.prose) if "://" not in match[1])

    @cached_property
    def readers_files(self) -> frozenset[str]:
        """Names of the files that the page tells its reader to write."""
        return frozenset(re.findall(r"[Ss]ave\s+this as `([\w.]+)`", self.text))

    @cached_property
    def anchors(self) -> frozenset[str]:
        """What links within the page may name, as GitHub makes them of the headings."""
        names: list[str] = []
        for heading in _HEADING.findall(self.prose):
            slug = re.sub(r"[^\w\- ]", "", re.sub(r"\]\([^)]*\)", "]", heading).lower()).replace(" ", "-")
            names.append(f"{slug}-{names.count(slug)}" if slug in names else slug)
        return frozenset(names)


def pages(root: Path) -> list[Page]:
    """Every document below a repository's root and its `docs`."""
    files = sorted([*root.glob("*.md"), *root.glob("docs/**/*.md")])
    return [Page(root, file.relative_to(root)) for file in files]
