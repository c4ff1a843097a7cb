"""`make docs`: the table of all parameters in docs/interface.md, from the tables that the program itself uses."""

import argparse
import math
import sys
from collections.abc import Iterable
from pathlib import Path

from vibro_ros.model.parameters import SCENE_PARAMETERS, Parameter, Value
from vibro_ros.scene_file import DEVICE_PARAMETERS, load_scene
from vibro_ros.study.generated_text import replaced

BEGIN = "<!-- parameters: written by `make docs` -->"
END = "<!-- end of parameters -->"


def parameter_table() -> str:
    """Markdown: the device's parameters, then the scene's, which have a column for the shipped scene `device`."""
    device = load_scene("device").parameters
    return "\n".join([
        "Of the node, which scenes do not contain:", "", *_rows(DEVICE_PARAMETERS, {}), "",
        "Of the scene. The default is the paper's; the node starts with the scene `device`, whose value is given "
        "where it differs:", "", *_rows(SCENE_PARAMETERS, device)])


def _rows(table: Iterable[Parameter], device: dict[str, Value]) -> list[str]:
    heads = ["name", "default", *(["`device`"] if device else []), "unit", "allowed", "meaning"]
    rows = [heads, ["---"] * len(heads)]
    for parameter in table:
        own = device.get(parameter.name, parameter.default)
        in_device = [_shown(own) if own != parameter.default else ""] if device else []
        rows.append([f"`{parameter.name}`", _shown(parameter.default), *in_device, parameter.unit,
                     _allowed(parameter), parameter.description])
    return ["| " + " | ".join(row) + " |" for row in rows]


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`[{', '.join(value)}]`"
    if isinstance(value, str):
        return f"`{value}`" if value else "empty"
    return _number(value)


def _number(value: float) -> str:
    """Six digits, with a point, as a ROS parameter needs it to be a double."""
    text = f"{value:.6g}"
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{exponent}{power}"


def _allowed(parameter: Parameter) -> str:
    if isinstance(parameter.default, bool):
        return "`true`, `false`"
    if isinstance(parameter.default, tuple):
        return "list of texts"
    if isinstance(parameter.default, str):
        return ", ".join(f"`{choice}`" for choice in parameter.choices) or "text"
    if math.isinf(parameter.minimum) and math.isinf(parameter.maximum):
        return "any"
    return f"{'above' if parameter.positive else 'from'} {parameter.minimum:g} to {parameter.maximum:g}"


def updated(document: str) -> str:
    """`document` with the text between its two marks replaced by the table.

    Raises
    ------
    ValueError
        If the marks are not there, once each and in order.
    """
    return replaced(document, BEGIN, END, parameter_table())


def main(arguments: list[str] | None = None) -> int:
    """Write the table; 2 when the file cannot be read or written, or has no place for it."""
    parser = argparse.ArgumentParser(prog="docs", description="Write the parameters' table into a Markdown file.")
    parser.add_argument("file", type=Path, nargs="?", default=Path("docs/interface.md"), help="default: %(default)s")
    file = parser.parse_args(arguments).file
    try:
        file.write_text(updated(file.read_text(encoding="utf-8")), encoding="utf-8")
    except (OSError, ValueError) as error:
        print(f"docs: {file}: {getattr(error, 'strerror', None) or error}", file=sys.stderr)
        return 2
    print(f"docs: {file}: parameters written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
