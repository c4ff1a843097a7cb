"""Research is a client of the public interface of `vibro_ros` alone."""

import ast
from pathlib import Path

import pytest

import vibro_ros

ROOT = Path(__file__).resolve().parents[2]


def private_names(source: str) -> list[str]:
    """Return the names that a module takes from the package although they are not in `vibro_ros.__all__`."""
    nodes = list(ast.walk(ast.parse(source)))
    taken = [f"{node.module}.{name.name}" for node in nodes if isinstance(node, ast.ImportFrom)
             for name in node.names if (node.module or "").split(".")[0] == "vibro_ros"]
    taken += [name.name + "." for node in nodes if isinstance(node, ast.Import) for name in node.names
              if name.name.startswith("vibro_ros.")]
    taken += [f"vibro_ros.{node.attr}" for node in nodes if isinstance(node, ast.Attribute)
              and isinstance(node.value, ast.Name) and node.value.id == "vibro_ros"]
    return [name for name in taken if name not in {f"vibro_ros.{public}" for public in vibro_ros.__all__}
            and name != "vibro_ros.__file__"]


def test_research_imports_public_names_alone():
    files = list((ROOT / "research").rglob("*.py"))
    assert len(files) > 5
    assert {file.name: names for file in files if (names := private_names(file.read_text(encoding="utf-8")))} == {}


@pytest.mark.parametrize("source", [
    "from vibro_ros.model.scene import Scene", "import vibro_ros.model", "import vibro_ros\nvibro_ros.model",
    "from vibro_ros import model"])
def test_a_private_name_is_seen(source):
    assert private_names(source)
