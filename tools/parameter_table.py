"""Make the tables of all parameters in docs/guide/parameters.md, from the program's own definitions."""

import argparse
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from tools.generated_text import write_between
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS, load_scene
from vibro_ros.model.parameters import SCENE_PARAMETERS, Parameter, Value

BEGIN = "<!-- parameters: written by `make documents` -->"
END = "<!-- end of parameters -->"


def parameter_table() -> str:
    """Return the tables in Markdown: the device's parameters, then the scene's with a column for the scene `device`."""
    device = load_scene("device").parameters
    return "\n".join([
        "Of the node, which scenes do not contain:", "", *_rows(DEVICE_PARAMETERS, {}), "",
        "Of the scene. The default is the paper's; the node starts with the scene `device`, whose value is given "
        "where it differs:", "", *_rows(SCENE_PARAMETERS, device)])


def _rows(table: Iterable[Parameter], device: Mapping[str, Value]) -> list[str]:
    heads = ["name", "default", *(["`device`"] if device else []), "unit", "allowed", "meaning"]
    rows = [heads, ["---"] * len(heads)]
    for parameter in table:
        device_value = device.get(parameter.name, parameter.default)
        in_device = [_shown(device_value) if device_value != parameter.default else ""] if device else []
        rows.append([f"`{parameter.name}`", _shown(parameter.default), *in_device, parameter.unit,
                     _allowed(parameter), f"{parameter.description}{'; *live*' * parameter.while_running}"])
    return ["| " + " | ".join(row) + " |" for row in rows]


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`[{', '.join(map(str, value))}]`"
    if isinstance(value, str):
        return f"`{value}`" if value else "empty"
    return _number(value)


def _number(value: float) -> str:
    """Format a number with six digits and with a point, which makes it a double as a ROS parameter."""
    text = f"{value:.6g}"
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{exponent}{power}"


def _allowed(parameter: Parameter) -> str:
    if isinstance(parameter.default, bool):
        return "`true`, `false`"
    if parameter.is_numbers:
        return f"{len(parameter.default)} numbers from {parameter.minimum:g} to {parameter.maximum:g}"
    if isinstance(parameter.default, tuple):
        return "list of texts"
    if isinstance(parameter.default, str):
        return ", ".join(f"`{choice}`" for choice in parameter.choices) or "text"
    if math.isinf(parameter.minimum) and math.isinf(parameter.maximum):
        return "any"
    if parameter.smallest:
        return f"0, or from {parameter.smallest:g} to {parameter.maximum:g}"
    return f"{'above' if parameter.positive else 'from'} {parameter.minimum:g} to {parameter.maximum:g}"


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, nargs="?", default=Path("docs/guide/parameters.md"),
                        help="default: %(default)s")
    file = parser.parse_args(words).file
    write_between(file, BEGIN, END, parameter_table)
    print(f"{file}: parameters written")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
