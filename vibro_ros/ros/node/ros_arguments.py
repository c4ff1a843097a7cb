"""The ROS arguments that rcl would refuse without a word that helps, or ignore.

rcl answers a missing or malformed parameter file with an error of several lines, and skips a section for
another node in silence: a misspelt node name leaves every parameter at its default.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from vibro_ros.configuration import parameter_file
from vibro_ros.ros.node.remapping import check_remapping

OVERRIDE = ("--param", "-p")
REMAPPING = ("--remap", "-r")


def own_arguments(words: Sequence[str]) -> list[str]:
    """`words` without the parts that are for ROS: from each `--ros-args` to `--` or the end."""
    return [word for word, for_ros in _marked(words) if not for_ros and word != "--"]


def _values(words: Sequence[str], *flags: str) -> tuple[str, ...]:
    """The values that follow any of `flags` in the parts for ROS."""
    return tuple(value for flag, value in _pairs(words) if flag in flags)


def _pairs(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each option in the parts for ROS whose value is checked here, and the value that follows it."""
    for_ros = iter([word for word, for_ros in _marked(words) if for_ros])
    for word in for_ros:
        if word in (*OVERRIDE, *REMAPPING, "--params-file"):
            value = next(for_ros, None)
            if value is None:
                raise ValueError(f"{word}: no value follows it; give one")
            yield word, value


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
    for override in _values(words, *OVERRIDE):
        name, assigned, value = override.partition(":=")
        if not (name and assigned) or not _is_yaml(value):
            raise ValueError(f"-p {override}: not a parameter; write name:=value, such as motor.speed:=100.0")
    for rule in _values(words, *REMAPPING):
        check_remapping(rule)
    files = tuple(Path(name) for name in _values(words, "--params-file"))
    for path in files:
        parameter_file.sections(path)
    return files


def check_addressed(files: Sequence[Path], node: str) -> None:
    """Refuse a parameter file without a section for `node`, a fully qualified name.

    Raises
    ------
    ValueError
        Naming the file, the nodes that it does address, and the remedy.
    """
    for path in files:
        parameter_file.check_addressed(path, parameter_file.sections(path), node)


def folder_of(name: str, words: Sequence[str], node: str) -> Path:
    """Folder from which a relative path in the parameter `name` starts: of the file that gives it, else the current.
    """
    given: list[tuple[str, dict[str, Path]]] = []
    for flag, value in _pairs(words):
        if flag == "--params-file":
            file = Path(value)
            given += [(pattern, {key: file.parent for key in values}) for pattern, values in
                      parameter_file.sections(file)]
        elif flag in OVERRIDE:
            of_node, _, key = value.partition(":=")[0].rpartition(":")
            given.append((of_node or "/**", {key: Path()}))
    return parameter_file.merged(given, node).get(name, Path())


def _is_yaml(text: str) -> bool:
    try:
        yaml.safe_load(text)
    except yaml.YAMLError:
        return False
    return True
