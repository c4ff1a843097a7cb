"""ROS arguments: which belong to the node, and names that remapping makes useless."""

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.configuration.scene_file import DEVICE_PARAMETERS
from vibro_ros.ros.node.arguments import check_names, own_arguments


@pytest.mark.parametrize("words, expected", [
    (["crawl"], ["crawl"]),
    (["crawl", "--ros-args", "-p", "a:=1"], ["crawl"]),
    (["--ros-args", "-p", "a:=1", "--", "crawl"], ["crawl"]),
    (["-h", "--ros-args", "-r", "x:=y", "--", "a", "--ros-args", "--log-level", "warn"], ["-h", "a"]),
])
def test_own_arguments_are_those_outside_ros_args(words: list[str], expected: list[str]):
    assert own_arguments(words) == expected


@pytest.mark.parametrize("words, remedy", [
    *([[option, "scene:=paper", "--ros-args", "-p", "a:=1"],
       f"{option}: is an option of ROS; write --ros-args before it, such as --ros-args {option} "]
      for option in ("-p", "-r", "--params-file")),
    (["--scene", "damped"], "--scene: is a parameter of ROS; write --ros-args -p scene:=damped"),
    (["--scene=damped"], "--scene=damped: is a parameter of ROS; write --ros-args -p scene:=damped"),
    (["scene:=damped", "x"], "scene:=damped: is a parameter of ROS; write --ros-args -p scene:=damped"),
    (["__ns:=/r1"], "__ns:=/r1: is an argument of ROS; write --ros-args -r __ns:=/r1"),
    (["odom:=o"], "odom:=o: is an argument of ROS; write --ros-args -p odom:=o for a parameter, -r odom"),
])
def test_an_argument_of_ros_outside_ros_args_is_shown_as_it_is_written(words, remedy):
    with pytest.raises(ValueError, match="^[^\n]*$") as refusal:
        own_arguments(words, DEVICE_PARAMETERS)
    assert str(refusal.value).startswith(remedy)
    assert own_arguments(["scene"], DEVICE_PARAMETERS) == ["scene"]


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
