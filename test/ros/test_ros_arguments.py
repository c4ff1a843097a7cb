from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.ros.node.ros_arguments import check_addressed, check_arguments, own_arguments


def params_file(folder: Path, text: str) -> Path:
    path = folder / "params.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("words, own", [
    (["crawl"], ["crawl"]),
    (["crawl", "--ros-args", "-p", "a:=1"], ["crawl"]),
    (["--ros-args", "-p", "a:=1", "--", "crawl"], ["crawl"]),
    (["-h", "--ros-args", "-r", "x:=y", "--", "a", "--ros-args", "--log-level", "warn"], ["-h", "a"]),
])
def test_own_arguments_are_those_outside_ros_args(words: list[str], own: list[str]):
    assert own_arguments(words) == own


@pytest.mark.parametrize("override", ["motor.speed", "motor.speed=1.0", ":=1.0", "motor.speed:=[1"])
def test_an_override_that_is_no_assignment_is_refused(override: str):
    with pytest.raises(ValueError, match="write name:=value"):
        check_arguments(["--ros-args", "-p", override])


def test_outside_ros_args_nothing_is_an_override():
    assert check_arguments(["-p", "motor.speed"]) == ()


def test_the_files_are_returned(tmp_path: Path):
    path = params_file(tmp_path, "/**:\n  ros__parameters:\n    gravity: 9.81\n")
    assert check_arguments(["--ros-args", "--params-file", str(path)]) == (path,)


@pytest.mark.parametrize("text, reason", [
    ("/**:\n  ros__parameters:\n    mass: [1,\n", "not YAML"),
    ("", "holds no parameters"),
    ("gravity: 9.81\n", "holds no parameters"),
    ("- 1\n", "holds no parameters"),
    ("\x00", "not YAML"),
])
def test_a_bad_file_is_named_with_its_reason(tmp_path: Path, text: str, reason: str):
    path = params_file(tmp_path, text)
    with pytest.raises(ValueError, match=reason) as refusal:
        check_arguments(["--ros-args", "--params-file", str(path)])
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(ValueError, match=r"none\.yaml: No such file"):
        check_arguments(["--ros-args", "--params-file", str(tmp_path / "none.yaml")])


# ROS's own rules: `*` stands for one name, `**` for any number; nested keys join to one name
@pytest.mark.parametrize("section", [
    "/**", "/lab/vibro_robot", "lab/vibro_robot", "/*/vibro_robot", "/**/vibro_robot", "/lab/*", "/lab/**",
])
def test_a_section_for_this_node_is_found(tmp_path: Path, section: str):
    path = params_file(tmp_path, f"{section}:\n  ros__parameters:\n    gravity: 9.81\n")
    check_addressed([path], "/lab/vibro_robot")


def test_a_nested_section_is_found(tmp_path: Path):
    path = params_file(tmp_path, "/lab:\n  vibro_robot:\n    ros__parameters:\n      gravity: 9.81\n")
    check_addressed([path], "/lab/vibro_robot")


@pytest.mark.parametrize("section", ["vibro_robt", "/vibro_robot", "/*", "/lab", "/hall/*", "/lab/vibro_robot/**/x"])
def test_a_section_for_another_node_is_refused(tmp_path: Path, section: str):
    path = params_file(tmp_path, f"{section}:\n  ros__parameters:\n    gravity: 9.81\n")
    with pytest.raises(ValueError, match="none for this node; address them to /lab/vibro_robot"):
        check_addressed([path], "/lab/vibro_robot")


@pytest.mark.parametrize("section", [
    "/**", "/lab/vibro_robot", "lab/vibro_robot", "/*/vibro_robot", "/**/vibro_robot", "/lab/*", "/lab/**",
    "vibro_robt", "/vibro_robot", "/*", "/lab", "/hall/*", "/lab/vibro_robot/**/x",
])
def test_it_agrees_with_rcl_about_whom_a_section_is_for(tmp_path: Path, domain_id: int, section: str):
    path = params_file(tmp_path, f"{section}:\n  ros__parameters:\n    gravity: 9.81\n")
    context = Context()
    rclpy.init(context=context, domain_id=domain_id,
               args=["--ros-args", "-r", "__ns:=/lab", "--params-file", str(path)])
    node = Node("vibro_robot", context=context, automatically_declare_parameters_from_overrides=True)
    given = node.has_parameter("gravity")
    node.destroy_node()
    rclpy.shutdown(context=context)
    try:
        check_addressed([path], "/lab/vibro_robot")
    except ValueError:
        assert not given
    else:
        assert given
