"""The launch files and the first node of examples/: what they name exists in this package.

`launch` is not on PyPI, so a stand-in records what the files ask it for: names of executables, parameters and files are
checked here. That `launch` itself starts the nodes is not.
"""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import guide
import pytest

from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.configuration.shipped import shipped
from vibro_ros.model.parameters import SCENE_PARAMETERS, checked_parameters
from vibro_ros.process.executables import EXECUTABLES
from vibro_ros.ros.controller import controller

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FILES = sorted((EXAMPLES / "launch").glob("*.launch.py"))
MODULES = ("launch", "launch.actions", "launch.event_handlers", "launch.substitutions", "launch_ros",
           "launch_ros.actions", "launch_ros.parameter_descriptions", "launch_ros.substitutions")
PARAMETERS = {"robot": (*DEVICE_PARAMETERS, *SCENE_PARAMETERS), "controller": controller.PARAMETERS}


class Asked:
    """An object of `launch` that a launch file creates."""

    def __init__(self, kind, *given, **named):
        self.kind, self.given, self.named = kind, given, named

    def __iter__(self):
        """Yield this object and all objects that it contains."""
        yield self
        for one in (*self.given, *self.named.values()):
            for part in one if isinstance(one, (list, tuple)) else [one]:
                if isinstance(part, Asked):
                    yield from part


class StandIn(ModuleType):
    """A stand-in for a module of launch: every name of it creates an `Asked`."""

    __path__ = ()

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *given, **named: Asked(name, *given, **named)


@pytest.fixture
def launched(monkeypatch):
    def read(file: Path) -> list[Asked]:
        for name in MODULES:
            monkeypatch.setitem(sys.modules, name, StandIn(name))
        spec = importlib.util.spec_from_file_location(file.name.partition(".")[0], file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return list(module.generate_launch_description())
    return read


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_a_launch_file_names_what_there_is(launched, file):
    asked = launched(file)
    nodes = [one.named for one in asked if one.kind == "Node" and one.named["package"] == "vibro_ros"]
    assert nodes or any(one.kind == "IncludeLaunchDescription" for one in asked)
    for node in nodes:
        assert EXECUTABLES[node["executable"]].installed
        assert {*node} <= {"package", "executable", "namespace", "output", "parameters", "arguments", "on_exit"}
        for given in node.get("parameters", []):
            plain = {name: value for name, value in given.items()
                     if name != "use_sim_time" and not isinstance(value, Asked)}
            checked_parameters(plain, PARAMETERS[node["executable"]])
            assert {*given} - {"use_sim_time"} <= {one.name for one in PARAMETERS[node["executable"]]}
        assert {one for one in node.get("arguments", []) if isinstance(one, str)} <= {*shipped("script")}
    for path in (one.given[0] for one in asked if one.kind == "PathJoinSubstitution"):
        _, folder, *rest = path
        assert (EXAMPLES if folder == "launch" else EXAMPLES.parent).joinpath(folder, *rest).is_file()
    for one in asked:
        if one.kind == "LaunchConfiguration":
            assert one.given[0] in {other.given[0] for other in asked if other.kind == "DeclareLaunchArgument"}


def test_robot_time_begins_when_the_script_has_begun_and_once(launched):
    (handler,) = [one for one in launched(EXAMPLES / "launch" / "lock_step.launch.py") if one.kind == "OnProcessIO"]
    resume = handler.named["on_stderr"]
    lines = [ModuleType("line") for _ in range(3)]
    for line, text in zip(lines, (b"waiting for a robot", b"entry 1, 1 s: motor_speed", b"entry 10, 1 s"), strict=True):
        line.text = text
    said = [resume(line) for line in lines]
    assert [one is not None for one in said] == [False, True, False]
    assert said[1].named["cmd"][:4] == ["ros2", "service", "call", "/vibro_robot/pause"]


def test_the_page_shows_the_first_node_and_every_launch_file():
    page = guide.PAGES["first_node.md"]
    assert f"```py\n{(EXAMPLES / 'first_node.py').read_text()}```\n" in page
    assert {name for name in guide.first_column("file", "starts")} == {file.name for file in FILES}
