"""ROS arguments: which belong to the node, and names that remapping makes useless."""

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.ros.node.arguments import check_names, own_arguments


@pytest.mark.parametrize("words, own", [
    (["crawl"], ["crawl"]),
    (["crawl", "--ros-args", "-p", "a:=1"], ["crawl"]),
    (["--ros-args", "-p", "a:=1", "--", "crawl"], ["crawl"]),
    (["-h", "--ros-args", "-r", "x:=y", "--", "a", "--ros-args", "--log-level", "warn"], ["-h", "a"]),
])
def test_own_arguments_are_those_outside_ros_args(words: list[str], own: list[str]):
    assert own_arguments(words) == own


@pytest.mark.parametrize("option", ["-p", "-r", "--params-file"])
def test_an_option_of_ros_outside_ros_args_is_named_with_its_remedy(option):
    with pytest.raises(ValueError, match=f"^{option}: is an option of ROS; write --ros-args before it, such as "
                                         f"--ros-args {option} "):
        own_arguments([option, "scene:=paper", "--ros-args", "-p", "a:=1"])


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
