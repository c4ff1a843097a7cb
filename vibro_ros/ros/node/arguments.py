"""Checks of ROS arguments that rcl would ignore, or refuse with an unhelpful message.

rcl answers a missing or malformed parameter file with an error of several lines, and skips a section for another node
silently: a misspelt node name leaves every parameter at its default. Names that remapping makes equal or too long are
found only when a topic is created.
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from rclpy.node import Node

from vibro_ros.configuration import parameter_file
from vibro_ros.model.parameters import Parameter
from vibro_ros.process.files import user_path

OVERRIDE = ("--param", "-p")
REMAP = ("--remap", "-r")
FILE = "--params-file"
EXAMPLES = {**dict.fromkeys(OVERRIDE, "scene:=paper"), **dict.fromkeys(REMAP, "odom:=body/odom"), FILE: "robot.yaml"}
"""Example of a value for each option of ROS."""
TOPIC_LENGTH = 247  # longest full name of a topic [characters] in rcl and rmw
SHARED_TOPICS = ("/diagnostics", "/clock", "/rosout", "/parameter_events")
"""Topics that nodes share, which no other topic may be remapped to."""


def own_arguments(words: Sequence[str], table: Iterable[Parameter] = ()) -> list[str]:
    """Return `words` without the ROS arguments, which go from each `--ros-args` to `--` or the end.

    ValueError for an option of ROS, a parameter of `table` or a remapping outside of these parts; the message says how
    to write it.
    """
    program_words = [word for word, for_ros in _marked(words) if not for_ros and word != "--"]
    parameters = {parameter.name for parameter in table}
    for word, value in zip(program_words, [*program_words[1:], ""], strict=False):
        if word in (*OVERRIDE, *REMAP, FILE):
            raise ValueError(f"{word}: is an option of ROS; write --ros-args before it, such as --ros-args {word} "
                             f"{EXAMPLES[word]}")
        option, equals, value_in_word = word.partition("=")
        name = option.lstrip("-").removesuffix(":")
        if name in parameters and option != name:
            raise ValueError(f"{word}: is a parameter of ROS; write --ros-args -p "
                             f"{name}:={value_in_word if equals else value}")
        if ":=" in word:
            how = f"-r {word}" if name.startswith("__") else f"-p {word} for a parameter, -r {word} for another name"
            raise ValueError(f"{word}: is an argument of ROS; write --ros-args {how}")
    return program_words


def check_arguments(words: Sequence[str]) -> tuple[Path, ...]:
    """Return the paths of the parameter files named in `words` (ValueError if one is no parameter file)."""
    files = tuple(Path(value) for flag, value in _pairs(words) if flag == FILE)
    for path in files:
        parameter_file.sections(path)
    return files


def check_addressed(files: Sequence[Path], node: str) -> None:
    """Refuse parameter files without a section that applies to `node`, a fully qualified name (ValueError)."""
    for path in files:
        parameter_file.check_addressed(path, parameter_file.sections(path), node)


def folder_of(name: str, words: Sequence[str], node: str) -> Path:
    """Return the folder from which a relative path in the parameter `name` starts.

    That is the folder of the file that sets the parameter, or the current folder if the command line sets it.
    """
    folders: list[tuple[str, dict[str, Path]]] = []  # by pattern of nodes and name of parameter
    for flag, value in _pairs(words):
        if flag == FILE:
            file = Path(value)
            folders += [(pattern, {key: file.parent for key in values})
                        for pattern, values in parameter_file.sections(file)]
        else:
            pattern, _, key = value.partition(":=")[0].rpartition(":")
            folders.append((pattern or "/**", {key: Path()}))
    return parameter_file.merged(folders, node).get(name, Path())


def check_names(node: Node, names: Iterable[str]) -> None:
    """Refuse remappings that make a full name too long, or give two topics the same name (ValueError)."""
    names_of: dict[str, str] = {}
    for name in names:
        try:
            topic = node.resolve_topic_name(name)
        except RuntimeError:  # only the length can be wrong: rcl has refused bad rules and namespaces
            raise ValueError(f"{name}: its full name is too long; give a namespace or a remapping that leaves it at "
                             f"most {TOPIC_LENGTH} characters") from None
        if topic in SHARED_TOPICS:
            raise ValueError(f"{name}: has the name {topic}, which stands for something else; remap it to another")
        if topic in names_of:
            raise ValueError(f"{names_of[topic]} and {name} have one name, {topic}; remap one of them to another")
        names_of[topic] = name


def _pairs(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield option and value of each parameter file and parameter override among the ROS arguments."""
    for_ros = iter([word for word, for_ros in _marked(with_user_paths(words)) if for_ros])
    for word in for_ros:
        if word in (*OVERRIDE, FILE) and (value := next(for_ros, "")):  # rcl refuses an option without a value
            yield word, value


def with_user_paths(words: Sequence[str]) -> list[str]:
    """Return the words with `~` expanded in the paths of parameter files, which rcl reads as they are written."""
    return [str(user_path(word)) if option == FILE else word for option, word in zip(("", *words), words, strict=False)]


def _marked(words: Sequence[str]) -> Iterator[tuple[str, bool]]:
    """Yield each word and whether it is a ROS argument."""
    for_ros = False
    for word in words:
        for_ros = (for_ros or word == "--ros-args") and word != "--"
        yield word, for_ros
