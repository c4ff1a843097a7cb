"""List the public names in docs/public_names.md: `python -m tools.public_names`.

The page is a promise, and this program writes only what keeps the promise: a name that the code has and the page lacks
is added, a name that the code has lost is an error until package.xml has a new major version. The lab promises no name.
"""

import contextlib
import inspect
import io
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import vibro_ros
from tools.generated_text import replaced
from vibro_ros.bag.reader import Bag
from vibro_ros.configuration.scene_file import shipped
from vibro_ros.messages.topics import BAG, COMMAND, NODE, TOPICS, full_name
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.ros.controller.controller import NAMES as ACTIONS
from vibro_ros.ros.controller.controller import PARAMETERS as OF_CONTROLLER
from vibro_ros.ros.live.view import PARAMETERS as OF_VIEW
from vibro_ros.ros.node.parameters import TABLE as OF_ROBOT
from vibro_ros.simulation.samples import Run

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "public_names.md"
GUIDE = ROOT / "docs" / "guide"
BEGIN = "<!-- names: written by `python -m tools.public_names` -->"
END = "<!-- end of names -->"

PYTHON, ATTRIBUTES = "function, method or class | parameters, or attributes", ": attributes"

RETURNED = (Bag, Run)
"""Classes that users meet as what a public function returns."""

CHOSEN = {
    "Scene": ("describe", "name", "parameters", "with_parameters"),
    "SensedSimulator": ("take_measurements",),
    "Simulator": ("advance_to", "checkpoint", "command", "disturbances", "fail", "push", "reset", "restore", "sample",
                  "set_parameters", "set_state", "state", "statistics", "take_events", "time"),
    "Bag": ("arrays", "duration", "flaws", "metadata", "path", "series", "start_ns", "to_pandas", "topics"),
}
"""Public attributes of the classes that have others for the package's own use, or from their base; of each other class
every attribute without a leading underscore is public."""

Names = Mapping[str, Mapping[str, tuple[str, ...]]]
"""For each table of the page, by its head: for each first cell, the names in the second."""


@cache
def names_of_the_code() -> Names:
    """Return the public names as the code has them.

    Those of services, frames, joints, events, scripts and of a bag's custom data come from tables of the guide, which
    test/ros/test_guide.py and lab/test/tools/test_documents.py compare with running robots and with the code.
    """
    return {
        PYTHON: dict(_python()),
        "executable | options": dict(_executables()),
        "direction | topics": {
            "in": tuple(full_name(name) for name, one in TOPICS.items() if one.when == COMMAND),
            "out": tuple(full_name(name) for name, one in TOPICS.items() if one.when not in (COMMAND, BAG))},
        "node | services and actions": {
            "`vibro_robot`": _of_guide("node.md", "service | type | does", "name | type | does"),
            "`vibro_controller`": tuple(ACTIONS.values())},
        "node, or group of the robot's parameters | parameters": dict(_parameters()),
        "kind | shipped names": {kind: shipped(kind) for kind in ("scene", "script", "sweep")},
        "of a bag | names": {
            "topics": tuple(full_name(name) for name, one in TOPICS.items()
                            if one.when != NODE or name == "operations"),
            "custom data": _of_guide("recordings.md", "key of the custom data | value")},
        "other names | names": {
            "frames": _of_guide("node.md", "frame | in | is"),
            "joints": _of_guide("node.md", "joint | position | velocity | effort"),
            "kinds of events": _of_guide("python.md", "kind | when"),
            "keys of a script": _of_guide("scripts.md", "key of an entry | meaning")},
    }


def _python() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each function and method with its parameters, and each class with its attributes."""
    scene = vibro_ros.load_scene("paper")
    example = {"Scene": scene, "Simulator": vibro_ros.Simulator(scene),
               "SensedSimulator": vibro_ros.SensedSimulator(scene)}
    for name in vibro_ros.__all__:
        found = getattr(vibro_ros, name)
        if inspect.isfunction(found):
            yield f"`{name}`", _arguments(found)
        elif name in CHOSEN:
            yield f"`{name}`", _arguments(found)
            yield from _members(found, [one for one in CHOSEN[name] if hasattr(example[name], one)])
        else:
            yield f"`{name}`", ()
    for found in RETURNED:
        chosen = CHOSEN.get(found.__name__) or sorted({*_fields(found), *dir(found)})
        yield from _members(found, [one for one in chosen if not one.startswith("_")
                                    and (hasattr(found, one) or one in _fields(found))])


def _fields(found: type) -> tuple[str, ...]:
    return tuple(one.name for one in fields(found)) if is_dataclass(found) else ()


def _members(found: type, names: Sequence[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
    methods = [name for name in names if inspect.isfunction(getattr(found, name, None))]
    if attributes := tuple(sorted(name for name in names if name not in methods)):
        yield f"`{found.__name__}`{ATTRIBUTES}", attributes
    for name in methods:
        yield f"`{found.__name__}.{name}`", _arguments(getattr(found, name))[1:]  # without the object itself


def _arguments(found: Any) -> tuple[str, ...]:
    """Return the names of the parameters of a function or class, in their order."""
    return tuple(f"**{one.name}" if one.kind is inspect.Parameter.VAR_KEYWORD else one.name
                 for one in inspect.signature(found).parameters.values())


def _executables() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each installed executable with the options of its `--help`."""
    for name, executable in EXECUTABLES.items():
        if executable.installed:
            live = _options(EXECUTABLES["live_view"].module) if name == "view" else ()
            yield f"`{name}`", tuple(sorted({*_options(executable.module), *live}))


def _options(module: str) -> tuple[str, ...]:
    with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.suppress(SystemExit):
        import_module(module).main(["--help"])
    return tuple(sorted({*re.findall(r"^ +(?:-\w, )?(--[a-z-]+)", printed.getvalue(), re.MULTILINE)} - {"--help"}))


def _parameters() -> Iterator[tuple[str, tuple[str, ...]]]:
    groups: dict[str, list[str]] = {}
    for parameter in OF_ROBOT:
        group = parameter.name.partition(".")[0] if "." in parameter.name else ""
        groups.setdefault(f"`{group}.`" if group else "`vibro_robot`", []).append(parameter.name)
    yield from ((group, tuple(names)) for group, names in groups.items())
    yield "`vibro_controller`", tuple(one.name for one in OF_CONTROLLER)
    yield "`vibro_view`", tuple(one.name for one in OF_VIEW)


def _of_guide(page: str, *heads: str) -> tuple[str, ...]:
    """Return the names in the first columns of tables of the guide."""
    text = (GUIDE / page).read_text(encoding="utf-8")
    rows = [row for head in heads for row in text.partition(f"| {head} |\n")[2].partition("\n\n")[0].splitlines()[1:]]
    return tuple(name for row in rows for name in re.findall(r"`([^`]+)`", row.split(" | ")[0]))


def tables(names: Names) -> str:
    """Return the page's tables in Markdown."""
    parts = []
    for head, rows in names.items():
        parts.append("\n".join([f"| {head} |", "|---|---|", *(
            f"| {first} | {', '.join(f'`{name}`' for name in found)} |" for first, found in rows.items())]))
    return "\n\n".join(parts)


def flat(names: Names) -> set[str]:
    """Return a text for each name, with its table and row, and with its place among the parameters of a function."""
    texts = set()
    for head, rows in names.items():
        row_is, names_are = head.split(" | ")
        for first, found in rows.items():
            ordered = head == PYTHON and not first.endswith(ATTRIBUTES)
            texts.add(f"{row_is} {first}")
            texts |= {f"{names_are} of {first}: {f'number {number} ' * ordered}`{name}`"
                      for number, name in enumerate(found, start=1)}
    return texts


def names_of_the_page(text: str) -> Names:
    """Return the names that the page has between its marks."""
    found: dict[str, dict[str, tuple[str, ...]]] = {}
    for table in filter(None, text.partition(BEGIN)[2].partition(END)[0].strip().split("\n\n")):
        head, _, *rows = table.splitlines()
        cells = [row.strip("|").split("|") for row in rows]
        found[head.strip("| ")] = {first.strip(): tuple(re.findall(r"`([^`]+)`", second)) for first, second in cells}
    return found


def major_of_the_page(text: str) -> int:
    """Return the major version whose names the page lists."""
    return int(re.search(r"names of version (\d+)", text)[1])  # type: ignore[index]


def major_of_the_package() -> int:
    """Return the major version in package.xml."""
    version = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version") or ""
    return int(version.partition(".")[0])


def complaints(page: str) -> list[str]:
    """Return in words what is wrong with the page, and what to do; empty if it lists what the code has."""
    code, listed = flat(names_of_the_code()), flat(names_of_the_page(page))
    lost = [f"gone from the code, but promised by docs/public_names.md: {name}. Bring it back; or, with a new major "
            "version in package.xml, name it under `Gone` in CHANGELOG.md with the remedy and run `python -m "
            "tools.public_names`" for name in sorted(listed - code)]
    added = [f"public in the code, but not in docs/public_names.md: {name}. Name it under `New` in CHANGELOG.md and "
             "run `python -m tools.public_names`; or begin its name with an underscore"
             for name in sorted(code - listed)]
    return lost + added


def main(words: Sequence[str] = ()) -> int:
    """Write the names into the page; returns 1 if that would break the promise of its major version."""
    page = PAGE.read_text(encoding="utf-8")
    major = major_of_the_package()
    lost = [line for line in complaints(page) if line.startswith("gone")]
    if lost and 0 < major <= major_of_the_page(page):
        print("\n".join(lost), file=sys.stderr)
        return 1
    page = re.sub(r"names of version \d+", f"names of version {major}", page)
    PAGE.write_text(replaced(page, BEGIN, END, tables(names_of_the_code())), encoding="utf-8")
    print(f"{PAGE}: names of version {major} written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
