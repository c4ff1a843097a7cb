"""ROS parameter files: their sections, and which of them rcl applies to a node.

A section is a mapping below the key `ros__parameters`; the keys above it, joined, are the node's name or a pattern of
names. `*` stands for one name and `**` for any number of them. A file may name a node, or a group of parameters, more
than once; `sections` gives all of them in order, as rcl reads them, and refuses a parameter that two of them give.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from vibro_ros.configuration.strict_yaml import Pairs, read_yaml

SECTION = "ros__parameters"  # key above the parameters of a node
FIXED_OF_RCLPY = {
    "use_sim_time": "take the time of stamps from /clock instead of the computer's clock",
    "start_type_description_service": "offer the service ~/get_type_description",
}
"""Boolean parameters that rclpy declares for every node, and their descriptions."""
OF_RCLPY = (*FIXED_OF_RCLPY, "qos_overrides")
"""First parts of the names of parameters that rclpy itself declares; `ros2 param dump` writes them, too."""

V = TypeVar("V")
Sections = list[tuple[str, dict[str, object]]]
"""For each section of a file, in order: node name or pattern as written, and parameters by dotted name."""


def sections(path: Path) -> Sections:
    """Read the sections of the file at `path` (ValueError: one line that names the file and the remedy)."""
    tree = read_yaml(path, pairs=True)
    try:
        sections_of_file = list(_sections(tree, ""))
        _refuse_twice(sections_of_file)
    except ValueError as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from None
    if not sections_of_file:
        raise ValueError(f"{path}: {_NO_PARAMETERS}")
    return sections_of_file


def check_addressed(path: Path, given: Sections, node: str) -> None:
    """Refuse a file without a section that applies to `node`, a fully qualified name (ValueError)."""
    patterns = [absolute(pattern) for pattern, _ in given]
    if not any(applies(pattern, node) for pattern in patterns):
        raise ValueError(f"{path}: holds parameters for {', '.join(patterns)}, none for this node; "
                         f"address them to {node} or to /**")


def absolute(pattern: str) -> str:
    """Return a section's pattern with a leading slash, which ROS allows to be left out."""
    return f"/{pattern.lstrip('/')}"


def applies(pattern: str, node: str) -> bool:
    """Return whether rcl applies the section `pattern` to `node`, a fully qualified name."""
    expression = re.escape(absolute(pattern)).replace(r"/\*\*", r"(?:/\w+)*").replace(r"\*", r"\w+")
    return re.fullmatch(expression, node) is not None


def merged(given: Iterable[tuple[str, Mapping[str, V]]], node: str) -> dict[str, V]:
    """Merge the sections of one file or of several for `node`, as rcl does.

    Among sections with equal patterns the later value wins. Among different patterns that apply to the node, the
    pattern whose first section comes last wins, however special it is and whatever comes after that section.
    """
    by_pattern: dict[str, dict[str, V]] = {}
    for pattern, values in given:
        by_pattern.setdefault(pattern, {}).update(values)
    return {name: value for pattern, values in by_pattern.items() if applies(pattern, node)
            for name, value in values.items()}


def own_parameters(values: Mapping[str, V]) -> dict[str, V]:
    """Return `values` without the parameters of rclpy."""
    return {name: value for name, value in values.items() if name.partition(".")[0] not in OF_RCLPY}


_NO_PARAMETERS = f"holds no parameters; a parameter file begins with `/**:` and below it `{SECTION}:`"


def _sections(tree: object, above: str) -> Iterator[tuple[str, dict[str, object]]]:
    if not isinstance(tree, Pairs):
        raise ValueError(f"{above}: {_NO_PARAMETERS}, alone" if above else _NO_PARAMETERS)
    for index, (key, value) in enumerate(tree):
        if key != SECTION:
            if above and str(key).startswith("/"):  # rcl joins the names by a slash of its own, and refuses two
                raise ValueError(f"{above}: {key}: begins with a slash below another name; write "
                                 f"{str(key).lstrip('/')}")
            yield from _sections(value, f"{above}{'/' * (above != '' and not above.endswith('/'))}{key}")
        elif above and isinstance(value, Pairs) and index == len(tree) - 1:  # after it rcl expects no other name
            yield above, _parameters(value)
        else:
            raise ValueError(f"{above}: {_NO_PARAMETERS}, alone" if above else _NO_PARAMETERS)


def _parameters(tree: Pairs) -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, leaf in _leaves(tree, ""):
        if name in flat:
            raise ValueError(f"{name}: is given twice; keep one")
        if isinstance(leaf, list):
            _refuse_mixture(name, leaf)
        flat[name] = leaf
    return flat


def _leaves(tree: Pairs, prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in tree:
        if value is None or value == Pairs():
            raise ValueError(f"{prefix}{key}: has no value; give one, or leave it out")
        if isinstance(value, Pairs):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _refuse_twice(given: Sections) -> None:
    """Refuse a parameter that two sections of one node or pattern give: rcl would silently take the later one."""
    names_by_pattern: dict[str, set[str]] = {}
    for pattern, values in given:
        names = names_by_pattern.setdefault(pattern, set())
        if again := sorted(names & values.keys()):
            raise ValueError(f"{again[0]}: is given twice for {pattern}; keep one")
        names.update(values)


def _refuse_mixture(name: str, values: list) -> None:
    """Refuse a list of elements that rcl reads as values of different types, because it then refuses the file."""
    kinds: dict[str, Any] = {}
    for value in values:
        kinds.setdefault(_kind(value), value)
    if len(kinds) <= 1:
        return
    if kinds.keys() == {"an integer", "a number with a point"}:
        remedy = f"write each number with a point, such as {float(kinds['an integer'])!r}"
    else:
        remedy = "give all of one type; in quotes, each is a text"
    mixture = " and ".join(f"{kind} ({value!r})" for kind, value in kinds.items())
    raise ValueError(f"{name}: its list mixes {mixture}, and ROS takes lists of one type; {remedy}")


def _kind(value: object) -> str:
    """Return the type that rcl gives to an element of a list, in words."""
    if isinstance(value, bool):
        return "a boolean"
    if isinstance(value, int) and -2**63 <= value < 2**63:
        return "an integer"
    return "a number with a point" if isinstance(value, int | float) else "a text"
