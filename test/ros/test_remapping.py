"""Rules of `-r`: what rcl takes passes, what it would refuse is one line with the remedy."""

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from vibro_ros.ros.node.remapping import NAMESPACE_LENGTH, TOPIC_LENGTH, check_names, check_remapping
from vibro_ros.ros.node.ros_arguments import check_arguments

GOOD = ("odom:=body/odom", "odom:=/lab/odom", "odom:=~/odom", "vibro_robot:odom:=x", "rostopic://odom:=x", "_a:=_b2",
        "rosservice://~/record:=tape", "~/record:=/tape", "/clock:=/sim/clock", "__ns:=/", "__ns:=/r1", "__ns:=/lab/r1",
        "__node:=r1", "__name:=r1", "other:__node:=r1", f"__ns:=/{'a' * (NAMESPACE_LENGTH - 1)}")
BAD = {
    "__ns:=r1": "'r1' cannot stand for __ns; give a namespace: / before each part",
    "__ns:=/1r": "'/1r' cannot stand for __ns",
    "__ns:=/r1/": "'/r1/' cannot stand for __ns",
    "__ns:=": "'' cannot stand for __ns",
    f"__ns:=/{'a' * NAMESPACE_LENGTH}": f"characters; give at most {NAMESPACE_LENGTH}",
    "__node:=1bad": "'1bad' cannot stand for __node; give a node's name",
    "__node:=a/b": "'a/b' cannot stand for __node",
    "motor_speed:=1bad": "'1bad' cannot stand for motor_speed; give a topic's or service's name",
    "motor_speed:=/a//b": "'/a//b' cannot stand for motor_speed",
    "motor_speed:=a/": "'a/' cannot stand for motor_speed",
    "motor_speed:=": "'' cannot stand for motor_speed",
    "motor_speed:=a b": "'a b' cannot stand for motor_speed",
    "motor_speed:={node}/x": "'{node}/x' cannot stand for motor_speed",
    "motor_speed:=a\nb": r"'a\nb' cannot stand for motor_speed",
    "motor_speed:=ä": "'ä' cannot stand for motor_speed",
    "nothing": "not a rule; write old:=new",
    ":=x": "not a rule",
    "*:=x": "not a rule",
    "1bad:odom:=x": "not a rule",
}


def node_is_made(rule: str) -> bool:
    """Whether rcl takes the rule; its word counts."""
    context = Context()
    try:
        rclpy.init(args=["--ros-args", "-r", rule], context=context)
        node = Node("vibro_robot", context=context)
        for topic in ("odom", "motor_speed"):
            node.resolve_topic_name(topic)
        node.destroy_node()
    except Exception:
        return False
    finally:
        context.try_shutdown()
    return True


@pytest.mark.parametrize("rule", GOOD)
def test_a_good_rule_passes(rule, domain_id):
    check_remapping(rule)
    if len(rule) < TOPIC_LENGTH:  # no room is left for the node's own topics
        assert node_is_made(rule)


@pytest.mark.parametrize(("rule", "words"), BAD.items(), ids=range(len(BAD)))
def test_a_bad_rule_is_refused_with_the_remedy_and_rcl_refuses_it_too(rule, words, domain_id):
    with pytest.raises(ValueError) as refusal:
        check_arguments(["--ros-args", "--remap", rule])
    assert str(refusal.value).startswith(f"-r {rule}: ")
    assert words in str(refusal.value)
    assert not node_is_made(rule)


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
