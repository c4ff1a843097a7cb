"""Names in the documents that do not exist: files, functions, parameters, topics, executables, make targets, words."""

import re
from collections.abc import Iterator
from pathlib import Path

from vibro_ros.bag.robot_topics import ROBOT_TOPICS
from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.model.parameters import SCENE_PARAMETERS
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.project.code_names import CodeNames
from vibro_ros.project.pages import Page, pages

#: Words between backticks that no source has, because they belong to other programs or are examples of a user's choice.
FOREIGN = frozenset({"chrt", "fifo", "my", "my_script", "vibro_robot_r1_"})
_INSTALLED = frozenset(name for name, one in EXECUTABLES.items() if one.installed) | {"python"}
_PARAMETERS = frozenset(parameter.name for parameter in (*SCENE_PARAMETERS, *DEVICE_PARAMETERS))
_GROUPS = frozenset(name.partition(".")[0] for name in _PARAMETERS if "." in name)
_TOPICS = frozenset({*ROBOT_TOPICS, "diagnostics", "clock"})
_FILE = re.compile(r"([\w.-]+/)*[\w.-]+\.(py|md|yaml|toml|svg|png|gif|csv|txt|xml|cfg|json|parquet)")
_DOTTED = re.compile(r"([^\W\d]\w*(?:\.[^\W\d]\w*)+)(?=$|[([=])")

#: Commands that a document shows: pattern, what the name in it is, and which names there are.
_COMMANDS: tuple[tuple[str, str, frozenset[str]], ...] = (
    (r"\.venv/bin/([\w-]+)", "installed executable", _INSTALLED),
    (r"ros2 run vibro_ros (\w+)", "installed executable", _INSTALLED),
    (r"python -m (vibro_ros[\w.]*)", "module that can be run", frozenset(one.module for one in EXECUTABLES.values())),
    (r"--set ([a-z][\w.]+)=", "parameter", _PARAMETERS),
    (r"ros2 topic \w+ (?:--\w+ )*(?:/\w+)*/(\w+)", "topic", _TOPICS),
)


def name_slips(root: Path) -> Iterator[str]:
    """Yield a sentence for each name in a document of the repository at `root` that does not exist."""
    code = CodeNames(root)
    for page in pages(root):
        yield from _command_slips(page, code)
        for place, token in page.tokens():
            for look in (_path_fault, _test_fault, _member_fault, _word_fault):
                if fault := look(token, page, code):
                    yield f"{place}: {fault}"
                    break


def _command_slips(page: Page, code: CodeNames) -> Iterator[str]:
    commands = (*_COMMANDS, (r"(?:`|^ +)make ([a-z][\w-]*)", "make target", code.targets),
                (r"-p ([\w.]+):=", "parameter", _PARAMETERS | code.parameters | {"use_sim_time"}))
    for pattern, kind, names in commands:
        for place, match in page.found(pattern, page.text):
            if match[1] not in names:
                yield f"{place}: {match[1]} is no {kind}"
    for place, match in page.found(r"bin/(python|controller) ([\w/.]+)", page.text):
        shipped = {"python": "{}", "controller": "config/controller/{}.yaml"}[match[1]].format(match[2])
        if match[2] not in page.readers_files and not (page.root / shipped).is_file():
            yield f"{place}: there is no {shipped}"


def _path_fault(token: str, page: Page, code: CodeNames) -> str:
    """Why `ros/inputs.py:Inputs.apply` or `docs/guide` names nothing; empty if there is such a thing."""
    file, _, name = token.partition(":")
    folders = (page.root, page.root / "vibro_ros", page.root / page.path.parent)
    first = file.partition("/")[0] if re.fullmatch(r"[\w.-]+/[\w./-]+", file) else ""
    if first in {"", "out", ".venv"} or not any((folder / first).is_dir() for folder in folders):
        return ""
    found = [folder / file for folder in folders if (folder / file).exists()]
    if not found:
        return f"there is no {file}"
    defined = code.modules.get(found[0].relative_to(page.root), set())
    return f"{file} has no {name}" if name and not name.startswith(":") and name not in defined else ""


def _test_fault(token: str, page: Page, code: CodeNames) -> str:
    """Why `test_rest.py::test_a_mass_rests` names nothing."""
    match = re.fullmatch(r"(?:[\w/]+/)?(test_\w+\.py)(?:::(test_\w+))?", token)
    if not match:
        return ""
    found = [names for file, names in code.modules.items() if file.name == match[1]]
    if not found:
        return f"there is no test {match[1]}"
    return "" if match[2] is None or match[2] in found[0] else f"{match[1]} has no {match[2]}"


def _member_fault(token: str, page: Page, code: CodeNames) -> str:
    """Why `guide.angle`, `Simulator.state` or `vibro_ros.accuracy.methods.METHODS` names nothing."""
    match = _DOTTED.match(token)
    if not match or _FILE.fullmatch(token) or match[1] in _PARAMETERS:
        return ""
    owner, name = match[1].split(".")[-2:]
    owners = {one for one, _ in code.members}
    known = _GROUPS | owners | {"vibro_ros"}
    if match[1].split(".")[0] not in known or _is_module(match[1], page.root):
        return ""
    if {(owner, name), (owner.capitalize(), name)} & code.members:  # `scene.describe` is any Scene's
        return ""
    return f"there is no {match[1]}"


def _is_module(dotted: str, root: Path) -> bool:
    path = root / dotted.replace(".", "/")
    return path.is_dir() or path.with_suffix(".py").is_file()


def _word_fault(token: str, page: Page, code: CodeNames) -> str:
    """Which word of the token stands in no source."""
    if re.search(r"\d{4}_\d\d_\d\d", token):  # the name of a bag
        return ""
    words = [word for word in re.findall(r"[^\W\d]\w*", token) if not word.isupper() and word not in FOREIGN]
    missing = [word for word in words if word not in code.words and word.strip("_0123456789") not in code.words | {""}]
    return f"{missing[0]}: no source has this word" if missing else ""


