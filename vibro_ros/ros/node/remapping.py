"""Checks of `-r old:=new`, whose faults rcl says without a remedy, or only when a topic is made."""

import re
from collections.abc import Iterable

from rclpy.node import Node

NAMESPACE_LENGTH = 245
TOPIC_LENGTH = 247
"""Most characters of a namespace and of a topic's full name, in rcl and rmw."""
TAKEN = ("/diagnostics", "/clock", "/rosout", "/parameter_events")
"""Topics that nodes use beside their own."""

_TOKEN = r"[A-Za-z_][A-Za-z0-9_]*"
_NAME = rf"(?:~/|/)?{_TOKEN}(?:/{_TOKEN})*"
_RULE = re.compile(rf"(?:{_TOKEN}:)?(?P<old>__ns|__node|__name|(?:rostopic://|rosservice://)?{_NAME}):=(?P<new>(?s:.*))")
_NEW = {"__ns": rf"/|(?:/{_TOKEN})+", "__node": _TOKEN, "__name": _TOKEN}
_PARTS = "letters, digits and _, not beginning with a digit"
_REMEDIES = {
    "__ns": f"give a namespace: / before each part, of {_PARTS}, such as __ns:=/r1",
    "__node": f"give a node's name: {_PARTS}",
    "__name": f"give a node's name: {_PARTS}",
}
_REMEDY = f"give a topic's or service's name: parts of {_PARTS}, with / between them, such as odom:=/lab/odom"


def check_remapping(rule: str) -> None:
    """Refuse a rule of `-r` that is none.

    Raises
    ------
    ValueError
        Naming the rule, what is wrong with it and the remedy.
    """
    parts = _RULE.fullmatch(rule)
    if not parts:
        raise ValueError(f"-r {rule}: not a rule; write old:=new, such as odom:=/lab/odom or __ns:=/r1")
    old, new = parts["old"], parts["new"]
    if not re.fullmatch(_NEW.get(old, _NAME), new):
        raise ValueError(f"-r {rule}: {new!r} cannot stand for {old}; {_REMEDIES.get(old, _REMEDY)}")
    if old == "__ns" and len(new) > NAMESPACE_LENGTH:
        raise ValueError(f"-r {rule}: the namespace has {len(new)} characters; give at most {NAMESPACE_LENGTH}")


def check_names(node: Node, names: Iterable[str]) -> None:
    """Refuse remapping that makes a full name too long, or one name of two topics.

    Raises
    ------
    ValueError
        Naming the topics and the remedy.
    """
    names_of: dict[str, str] = {}
    for name in names:
        topic = _resolved(node, name)
        if topic in TAKEN:
            raise ValueError(f"{name}: has the name {topic}, which stands for something else; remap it to another")
        if topic in names_of:
            raise ValueError(f"{names_of[topic]} and {name} have one name, {topic}; remap one of them to another")
        names_of[topic] = name


def _resolved(node: Node, name: str) -> str:
    try:
        return node.resolve_topic_name(name)
    except RuntimeError:  # the names are good: remapping and namespace are checked before
        raise ValueError(f"{name}: its full name is too long; give a namespace or a remapping that leaves it at most "
                         f"{TOPIC_LENGTH} characters") from None
