"""The site's page of the Python interface, made from docstrings: all public names, and classes of returned objects."""

import inspect
import re
from collections.abc import Iterator
from textwrap import indent

import vibro_ros
from vibro_ros.bag.reader import Bag
from vibro_ros.orbits.attractors import Attractor, Attractors
from vibro_ros.orbits.branch import Branch, Special
from vibro_ros.orbits.chaos import LyapunovSpectrum
from vibro_ros.orbits.orbit import Orbit
from vibro_ros.orbits.recurrence import SettledMotion
from vibro_ros.simulation.samples import Run

RETURNED = (Run, Bag, Orbit, Branch, Special, SettledMotion, Attractors, Attractor, LyapunovSpectrum)
#: Methods that the page shows of classes whose other methods are for the physics, or belong to `Simulator`.
USED = {"Scene": ["with_parameters", "describe"], "SensedSimulator": ["take_measurements", "fail"]}
_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
_PROMPT = re.compile(r"^(?:>>> .*\n?(?:(?!\n|>>> ).+\n?)*)+", re.MULTILINE)
_TABLE = re.compile(r"^ *={4,}[ =]*\n(?:.*\n)*? *={4,}[ =]*$", re.MULTILINE)


def public() -> Iterator[tuple[str, object]]:
    """Yield every public name with its object: functions, classes and their methods."""
    for name in vibro_ros.__all__:
        found = getattr(vibro_ros, name)
        yield name, found
        yield from _methods(name, found)


def _methods(name: str, found: object) -> Iterator[tuple[str, object]]:
    yield from ((f"{name}.{key}", value) for key, value in vars(found).items()
                if not key.startswith("_") and key in USED.get(name, [key])
                and (inspect.isfunction(value) or isinstance(value, property)))


def api_page() -> str:
    """Return the page in Markdown."""
    parts = ["# Python interface\n\n*What is each public name of `import vibro_ros`, with units, shapes and errors?* "
             "The page is made from the docstrings, which `help` shows, too."]
    parts += [_entry(name, found, "###" if "." in name else "##") for name, found in public()]
    parts += ["## What the functions return"]
    for kind in RETURNED:
        parts += [_entry(name, found, "###") for name, found in ((kind.__name__, kind), *_methods(kind.__name__, kind))]
    return "\n\n".join(parts) + "\n"


def _entry(name: str, found: object, level: str) -> str:
    text = inspect.getdoc(found) or ""
    call = f"\n\n    {name.rpartition('.')[2]}{inspect.signature(found)}" if inspect.isfunction(found) else ""
    return f"{level} {name}{call}\n\n{as_markdown(text)}"


def as_markdown(text: str) -> str:
    """Convert a numpydoc text to Markdown: section titles bold, parameters as lists, examples as code."""
    text = _TABLE.sub(lambda table: indent(table[0], "    "), text).replace("``", "`")
    start, *sections = _SECTION.split(text)
    blocks = [start.strip()]
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        if title not in ("Examples", "Notes"):
            body = re.sub(r"^(\S.*)$", r"- `\1`  ", body, flags=re.MULTILINE)
        blocks.append(f"**{title}**\n\n{body.strip()}")
    return _PROMPT.sub(lambda prompt: f"```pycon\n{prompt[0].rstrip()}\n```\n", "\n\n".join(blocks))
