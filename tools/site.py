"""Hooks of mkdocs for this repository: pages outside docs/, pages that are made here, and links to files that are not
pages.

`mkdocs.yml` names this file as its hook. README is the site's first page. A link to another file of the repository is
checked, and becomes plain text on the site.
"""

import logging
import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

import vibro_lab
import vibro_ros

ROOT = Path(__file__).resolve().parents[1]
#: Pages outside docs/, by their names on the site.
OUTSIDE = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", ".github/CONTRIBUTING.md": "contributing.md",
           ".github/SECURITY.md": "security.md", ".github/CODE_OF_CONDUCT.md": "code_of_conduct.md",
           ".github/QUALITY_DECLARATION.md": "quality_declaration.md"}
#: Classes of what public functions return, which a program does not import by name.
RESULTS = ("vibro_ros.simulation.samples.Run", "vibro_ros.bag.reader.Bag", "vibro_lab.orbits.orbit.Orbit",
           "vibro_lab.orbits.branch.Branch", "vibro_lab.orbits.branch.Special",
           "vibro_lab.orbits.recurrence.SettledMotion", "vibro_lab.orbits.attractors.Attractors",
           "vibro_lab.orbits.attractors.Attractor", "vibro_lab.orbits.chaos.LyapunovSpectrum",
           "vibro_lab.identification.identify.Identification", "vibro_lab.identification.identify.Alternative")
_LINK = re.compile(r"(?P<shown>!?\[[^]]*\])\((?P<path>[^)#:\s]+)(?P<anchor>#[^)\s]*)?\)")
#: Code, in which no link is changed, or a link, whose text may contain code.
_CODE_OR_LINK = re.compile(rf"^```.*?^```|`[^`\n]+`|{_LINK.pattern}", re.MULTILINE | re.DOTALL)
_log = logging.getLogger("mkdocs.hooks.site")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages outside docs/, the page of all docstrings, and the page of all pictures."""
    for name, page in OUTSIDE.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding="utf-8")))
    files.append(File.generated(config, "python_interface.md", content=python_interface()))
    files.append(File.generated(config, "gallery.md", content=gallery()))
    return files


def python_interface() -> str:
    """Return the page with the docstring of every public name, which mkdocstrings fills."""
    names = {"Device": [f"vibro_ros.{name}" for name in sorted(vibro_ros.__all__)],
             "Lab": [f"vibro_lab.{name}" for name in sorted(vibro_lab.__all__)], "What functions return": RESULTS}
    sections = ["\n".join([f"## {title}\n", *(f"::: {name}" for name in listed)]) for title, listed in names.items()]
    return "\n\n".join(["# Python interface", "Every public name with units, shapes and errors, as `help` shows it. "
                        "[Python](guide/python.md) shows how the names work together.", *sections]) + "\n"


def gallery() -> str:
    """Return the page with every picture of the documents, its description and the page that explains it."""
    lines, pictures = ["# Gallery", ""], set()
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for link in _LINK.finditer(page.read_text(encoding="utf-8")):
            picture = os.path.relpath(page.parent / link["path"], ROOT / "docs")
            if link["shown"].startswith("!") and picture not in pictures:
                pictures.add(picture)
                page_path = os.path.relpath(page, ROOT / "docs")
                lines += [f"{link['shown']}({picture})\n",
                          f"{link['shown'].strip('![]')}: [{page.stem}]({page_path})\n"]
    return "\n".join(lines)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the page with links of the repository replaced by links of the site."""
    outside = {site: name for name, site in OUTSIDE.items()}
    source = Path(outside.get(page.file.src_uri, f"docs/{page.file.src_uri}"))

    def of_site(link: re.Match) -> str:
        if not link["path"]:
            return link[0]
        target = Path(os.path.normpath(source.parent / link["path"]))
        page_there = OUTSIDE.get(str(target)) or (str(target.relative_to("docs")) if target.parts[0] == "docs" else "")
        if page_there:
            folder = Path(page.file.src_uri).parent
            return f"{link['shown']}({os.path.relpath(page_there, folder)}{link['anchor'] or ''})"
        if not (ROOT / target).exists():
            _log.warning("%s: the link to %s leads nowhere", source, link["path"])
        return link["shown"].strip("![]")

    return _CODE_OR_LINK.sub(of_site, markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Return the page with a place to break a line between a test's file and its name, which are long in tables."""
    return html.replace(".py::test_", ".py::<wbr>test_")
