"""Strict YAML within limits: duplicate keys are errors, 1e-3 is a number, no file can hang or crash the program.

Depth and number of values are counted event by event before any object is made. Aliases are refused, because a few
lines of them can expand to a billion values, and because rcl refuses them, too. Tags other than `!!str` are ignored, as
rcl ignores them: launch files write lists as `!!python/tuple`, and no tag may construct an object.
"""

import re
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from vibro_ros.process.files import read_file


@dataclass(frozen=True)
class Limits:
    """Limits of a document: bytes, number of keys and values, and nesting depth of lists and mappings."""

    size: int = 2**20
    values: int = 100_000
    depth: int = 32


LIMITS = Limits()  # limits of a file that a user writes

INTEGER_BITS = 4096
"""Longest integer [bits]: Python cannot print one of some thousand digits, not even in an error message."""


class _LimitError(yaml.MarkedYAMLError):
    """The document exceeds its `Limits`."""

    kind = "not read"


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """PyYAML's safe loader, made stricter.

    In PyYAML the last of duplicate keys wins, 1e-3 and 1.0e7 are texts, and values that do not suit their tags raise
    arbitrary exceptions. Here duplicates are errors, these are numbers, and the exceptions are MarkedYAMLError.
    """

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        seen = set()
        for key_node, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            key = self.construct_key(key_node)
            if key in seen:
                raise yaml.MarkedYAMLError(problem=f"{key!r} is given twice", problem_mark=node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_key(self, node: yaml.Node) -> Hashable:
        key = self.construct_object(node, deep=True)
        if not isinstance(key, Hashable):
            raise yaml.MarkedYAMLError(problem="a key that is a list or a mapping; give a text",
                                       problem_mark=node.start_mark)
        return key

    def construct_object(self, node: yaml.Node, deep: bool = False) -> object:
        if node.tag != self.DEFAULT_SCALAR_TAG or not isinstance(node, yaml.ScalarNode):
            plain = isinstance(node, yaml.ScalarNode) and not node.style
            node.tag = self.resolve(type(node), node.value, (plain, False))
        try:
            value = super().construct_object(node, deep)
        except (ValueError, KeyError, IndexError, AttributeError, OverflowError) as error:  # of PyYAML's converters
            raise yaml.MarkedYAMLError(problem=f"{_shown(node)} cannot be read as {node.tag.rpartition(':')[2]}",
                                       problem_mark=node.start_mark) from error
        if isinstance(value, int) and value.bit_length() > INTEGER_BITS:
            raise yaml.MarkedYAMLError(problem=f"{_shown(node)} is an integer of more than {INTEGER_BITS} bits",
                                       problem_mark=node.start_mark)
        return value


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?([0-9][0-9_]*\.?|[0-9_]*\.[0-9][0-9_]*)[eE][-+]?[0-9]+$"),
    list("-+.0123456789")
)


class Pairs(tuple):
    """The (key, value) pairs of a mapping in which a key may occur more than once, in the order of the document."""


class _PairsLoader(_Loader):
    """The same loader, but each mapping becomes `Pairs`."""


_PairsLoader.add_constructor("tag:yaml.org,2002:map", lambda loader, node: Pairs(
    (loader.construct_key(key), loader.construct_object(value, deep=True)) for key, value in node.value))


def parse_yaml(text: str, limits: Limits = LIMITS, pairs: bool = False) -> object:
    """Parse a YAML document; None when it is empty. With `pairs`, each mapping is given as `Pairs`.

    ValueError, with the line, when it is not YAML or exceeds the limits.
    """
    try:
        depth = values = 0
        for event in yaml.parse(text, _Loader):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            values += isinstance(event, yaml.NodeEvent)
            reason = (f"the alias *{event.anchor}; write the value out" if isinstance(event, yaml.AliasEvent) else
                      f"lists and mappings nested more than {limits.depth} deep" if depth > limits.depth else
                      f"more than {limits.values} keys and values" if values > limits.values else "")
            if reason:
                raise _LimitError(problem=reason, problem_mark=event.start_mark)
        return yaml.load(text, _PairsLoader if pairs else _Loader)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise ValueError(f"{line}{getattr(error, 'kind', 'not YAML')}: {error.problem or error.context}") from error
    except (yaml.YAMLError, UnicodeError) as error:  # a character that YAML forbids, half a surrogate pair
        raise ValueError(f"not YAML: {' '.join(str(error).split())}") from error


def read_scalar(text: str) -> object:
    """Return `text` read as a YAML scalar: a number, a boolean or a text; the text itself if it is anything else."""
    try:
        value = parse_yaml(text)
    except ValueError:
        return text
    return value if isinstance(value, (bool, int, float, str)) else text


def read_settings(words: Sequence[str]) -> dict[str, object]:
    """Return the value of each `--set NAME=VALUE` by name (ValueError for another form, or a name given twice)."""
    settings: dict[str, object] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals):
            raise ValueError(f"--set {word}: give NAME=VALUE, such as ground.friction=0.3")
        if name in settings:
            raise ValueError(f"--set {word}: {name} is given twice; keep one")
        settings[name] = read_scalar(value)
    return settings


def read_yaml(path: Path, limits: Limits = LIMITS, follow: bool = True, pairs: bool = False) -> object:
    """Parse the regular file at `path`, a link only if `follow`, as `parse_yaml` (ValueError names the file)."""
    try:
        return parse_yaml(read_file(path, limits.size, follow).decode(), limits, pairs)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}; give the path of a YAML file") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not YAML: byte {error.start} is not UTF-8") from error
    except ValueError as error:
        line, colon, reason = str(error).partition(": ")
        where = f"{path}, {line}: {reason}" if colon and line.startswith("line ") else f"{path}: {error}"
        raise ValueError(where) from error


def _shown(node: yaml.Node) -> str:
    text = node.value if isinstance(node, yaml.ScalarNode) else f"a {node.id}"
    return repr(text if len(text) <= 40 else f"{text[:40]}…")
