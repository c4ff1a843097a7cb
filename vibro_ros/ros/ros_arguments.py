"""The ROS arguments that rcl would refuse without a word that helps, or ignore.

rcl answers a missing or malformed parameter file with an error of several lines, and skips a section for
another node in silence: a misspelt node name leaves every parameter at its default.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import yaml

from vibro_ros.ros.remapping import check_remapping
from vibro_ros.strict_yaml import read_yaml

PARAMETERS = "ros__parameters"


def own_arguments(words: Sequence[str]) -> list[str]:
    """`words` without the parts that are for ROS: from each `--ros-args` to `--` or the end."""
    return [word for word, for_ros in _marked(words) if not for_ros and word != "--"]


def _values(words: Sequence[str], *flags: str) -> tuple[str, ...]:
    """The values that follow any of `flags` in the parts for ROS."""
    values = []
    for_ros = iter([word for word, for_ros in _marked(words) if for_ros])
    for word in for_ros:
        if word in flags:
            value = next(for_ros, None)
            if value is None:
                raise ValueError(f"{word}: no value follows it; give one")
            values.append(value)
    return tuple(values)


def _marked(words: Sequence[str]) -> Iterator[tuple[str, bool]]:
    """Each word and whether it is for ROS."""
    for_ros = False
    for word in words:
        for_ros = (for_ros or word == "--ros-args") and word != "--"
        yield word, for_ros


def check_arguments(words: Sequence[str]) -> tuple[Path, ...]:
    """The parameter files among `words`, after checking them, every `-p name:=value` and every `-r old:=new`.

    Raises
    ------
    ValueError
        For an override that is not name:=value, a rule that `check_remapping` refuses, and a file that is missing, not
        YAML or without parameters.
    """
    for override in _values(words, "--param", "-p"):
        name, assigned, value = override.partition(":=")
        if not (name and assigned) or not _is_yaml(value):
            raise ValueError(f"-p {override}: not a parameter; write name:=value, such as motor.speed:=100.0")
    for rule in _values(words, "--remap", "-r"):
        check_remapping(rule)
    files = tuple(Path(name) for name in _values(words, "--params-file"))
    for path in files:
        if not any(True for _ in _sections(path)):
            raise ValueError(f"{path}: holds no parameters; begin it with `/**:` and `{PARAMETERS}:`")
    return files


def check_addressed(files: Sequence[Path], node: str) -> None:
    """Refuse a parameter file without a section for `node`, a fully qualified name.

    Raises
    ------
    ValueError
        Naming the file, the nodes that it does address, and the remedy.
    """
    for path in files:
        patterns = [pattern for pattern, _ in _sections(path)]
        if not any(_matches(pattern, node) for pattern in patterns):
            raise ValueError(f"{path}: holds parameters for {', '.join(patterns)}, none for this node; "
                             f"address them to {node} or to /**")


def _sections(path: Path) -> Iterator[tuple[str, Mapping[str, object]]]:
    """Node name (or pattern) and parameters of each section of a file."""
    yield from _nested_sections(read_yaml(path), "")


def _nested_sections(tree: object, prefix: str) -> Iterator[tuple[str, Mapping[str, object]]]:
    if not isinstance(tree, Mapping):
        return
    for key, value in tree.items():
        if key == PARAMETERS and isinstance(value, Mapping) and prefix:
            yield prefix, value
        else:
            yield from _nested_sections(value, f"{prefix}/{str(key).strip('/')}")


def _matches(pattern: str, node: str) -> bool:
    """Whether rcl applies the section `pattern` to `node`: `*` is one name, `/**` any number of them."""
    expression = re.escape(pattern).replace(r"/\*\*", r"(?:/\w+)*").replace(r"\*", r"\w+")
    return re.fullmatch(expression, node) is not None


def _is_yaml(text: str) -> bool:
    try:
        yaml.safe_load(text)
    except yaml.YAMLError:
        return False
    return True
