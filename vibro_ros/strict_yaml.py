"""YAML read as its authors mean it: no key twice, and 1e-3 is a number."""

import re
from collections.abc import Hashable
from pathlib import Path

import yaml


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader without its two surprises (the last of equal keys wins; 1e-3 and 1.0e7 are texts)."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, object]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            raise yaml.MarkedYAMLError(problem=f"{twice!r} is given twice", problem_mark=node.start_mark)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?([0-9][0-9_]*\.?|[0-9_]*\.[0-9][0-9_]*)[eE][-+]?[0-9]+$"),
    list("-+.0123456789")
)


def read_scalar(text: str) -> object:
    """The value that `text` is in YAML: a number, true or false, else the text itself."""
    try:
        value = yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError, RecursionError):
        return text
    return value if isinstance(value, (bool, int, float, str)) else text


def read_yaml(path: Path) -> object:
    """The document in the file at `path`; None when it is empty.

    Raises
    ------
    ValueError
        Naming the file, for one that cannot be read or is not YAML.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}; give the path of a YAML file") from error
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ValueError(f"{path}{line}: not YAML: {error.problem}") from error
    except RecursionError as error:
        raise ValueError(f"{path}: not YAML: nested too deeply") from error
    except (yaml.YAMLError, ValueError) as error:  # ValueError: a text's encoding, a number's length
        raise ValueError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
