"""The names that the repository's code has, for what checks the names in documents."""

import ast
import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

_SOURCES = ("vibro_ros/**/*.py", "test/**/*.py", "config/**/*.yaml", "Makefile", "setup.py", "setup.cfg", "package.xml",
            "ruff.toml", "requirements*.txt", ".ci/*")
_WORD = re.compile(r"[^\W\d]\w*")


@dataclass
class Definitions:
    """What a module or a class defines: by dotted name, `Outputs`, `Outputs.publish`, `TOPICS`."""

    names: set[str] = field(default_factory=set)

    def add(self, body: list[ast.stmt], owner: str = "") -> None:
        """Take in the statements of a module, or of the class `owner`."""
        for node in body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                self.names.add(f"{owner}{node.name}")
            if isinstance(node, ast.ClassDef):
                self.add(node.body, f"{owner}{node.name}.")
            self.names |= {f"{owner}{target.id}" for target in _targets(node) if isinstance(target, ast.Name)}
            if isinstance(node, ast.FunctionDef):
                self.names |= {f"{owner}{target.attr}" for part in ast.walk(node) for target in _targets(part)
                               if isinstance(target, ast.Attribute)}


def _targets(node: ast.AST) -> list[ast.expr]:
    """What a statement assigns to, tuples taken apart."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [part for target in targets for part in (target.elts if isinstance(target, ast.Tuple) else [target])]


class CodeNames:
    """The names of a repository's code.

    Parameters
    ----------
    root : Path
        The repository.
    """

    def __init__(self, root: Path):
        self._root = root

    @cached_property
    def modules(self) -> dict[Path, set[str]]:
        """What each module of the package and each test defines, by the file's path from the root."""
        found = {}
        for file in sorted([*self._root.glob("vibro_ros/**/*.py"), *self._root.glob("test/**/*.py")]):
            tree, definitions = ast.parse(file.read_text(encoding="utf-8")), Definitions()
            definitions.add(tree.body)
            if file.name == "__init__.py":  # what it hands on is its own
                definitions.names |= {name.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
                                      for name in node.names}
            found[file.relative_to(self._root)] = definitions.names
        return found

    @cached_property
    def members(self) -> set[tuple[str, str]]:
        """Every module with each of its names, every class with all of its: `("Simulator", "state")`."""
        pairs = {(file.stem.replace("__init__", file.parent.name), name) for file, names in self.modules.items()
                 for name in names}
        inner = {name for names in self.modules.values() for name in names if "." in name}
        pairs |= {(name.split(".")[-2], name.split(".")[-1]) for name in inner}
        return pairs | {(heir, name) for heir, base in self._heirs for owner, name in pairs if owner == base}

    @cached_property
    def _heirs(self) -> list[tuple[str, str]]:
        """Every class with each class that it inherits from directly."""
        trees = [ast.parse(file.read_text(encoding="utf-8")) for file in self._root.glob("vibro_ros/**/*.py")]
        return [(node.name, base.id) for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
                for base in node.bases if isinstance(base, ast.Name)]

    @cached_property
    def words(self) -> set[str]:
        """Every word of the sources, in names, texts and comments alike."""
        files = sorted(file for pattern in _SOURCES for file in self._root.glob(pattern) if file.is_file())
        return {word for file in files for word in _WORD.findall(file.read_text(encoding="utf-8"))} | {
            part for file in files for part in file.relative_to(self._root).with_suffix("").parts}

    @cached_property
    def parameters(self) -> set[str]:
        """Every parameter whose name stands in a call of `Parameter`."""
        files = self._root.glob("vibro_ros/**/*.py")
        return {name for file in files for name in re.findall(r'\bParameter\(\s*"([\w.]+)"', file.read_text("utf-8"))}

    @cached_property
    def targets(self) -> set[str]:
        """What `make` can be asked for."""
        return set(re.findall(r"^([\w-]+):", (self._root / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
