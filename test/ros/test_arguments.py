"""ROS arguments: which are ours, whom a parameter file addresses, and names that remapping makes useless."""

from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.ros.node.arguments import check_addressed, check_names, own_arguments


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


@pytest.mark.parametrize(("rule", "words"), {
    "odom:=joint_states": "odom and joint_states have one name, /lab/joint_states; remap one of them",
    "odom:=/diagnostics": "odom: has the name /diagnostics, which stands for something else; remap it",
    f"odom:={'a' * 300}": "odom: its full name is too long; give a namespace or a remapping that leaves it at most 247",
}.items(), ids=["two", "taken", "long"])
def test_names_that_cannot_be_told_apart_are_refused(rule, words, domain_id):
    context = Context()
    rclpy.init(args=["--ros-args", "-r", "__ns:=/lab", "-r", rule], context=context)
    node = Node("vibro_robot", context=context)
    with pytest.raises(ValueError, match=words[:40]) as refusal:
        check_names(node, ("motor_speed", "odom", "joint_states"))
    assert words in str(refusal.value)
    node.destroy_node()
    context.try_shutdown()
