"""Commands for the joints in one message, as hardware of ros2_control that works by topics sends them.

The crank is commanded by velocity [rad/s], a plate by position [m], the quantities of `joint_states`. An array that is
as long as the names belongs to them in their order. joint_state_topic_hardware_interface appends a number only for each
joint that has a command interface of the kind, so that an array as long as the list of such joints belongs to these in
their order. A number that is not finite is no command: controllers that are not active leave NaN. A message that names
a joint twice commands nothing, because no reader of the bag could say which of the two numbers held.
"""

import math
from collections import Counter
from typing import Any

from vibro_ros.model.parameters import quoted
from vibro_ros.model.scene import Scene

COMMANDED = {"crank": ("velocity", "motor_speed"), "upper_plate": ("position", "upper_gap"),
             "inclined_plate": ("position", "inclined_gap")}
"""By joint: which array commands it, and the argument of `Simulator.command` that this is."""


def joint_commands(message: Any, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """What a JointState of any ROS library commands: arguments of `Simulator.command`, and what is wrong with the rest.

    The rods' lengths of `scene` lie between a plate's position and its gap.
    """
    names, commands, faults = list(message.name), dict[str, float](), []
    if repeated := [name for name, count in Counter(names).items() if count > 1]:
        return {}, [f"{quoted(repeated[0])} is named {names.count(repeated[0])} times; name each joint once"]
    for kind in ("position", "velocity", "effort"):
        numbers, meant = list(getattr(message, kind)), [name for name in names if _kind(name) == kind]
        if len(numbers) == len(names):
            meant = names
        elif len(numbers) != len(meant) and numbers:
            faults.append(f"{kind}: {len(numbers)} numbers for {len(names)} names, {len(meant)} of them commanded so; "
                          "give one a name, or one for each joint that is commanded so")
            continue
        for name, number in zip(meant, map(float, numbers), strict=False):
            if not math.isfinite(number):
                continue
            if _kind(name) != kind:
                faults.append(f"{quoted(name)} is not commanded by {kind}; give " + ", ".join(
                    f"{joint} by {array}" for joint, (array, _) in COMMANDED.items()))
                continue
            argument = COMMANDED[name][1]
            rod = f"crank.{argument.removesuffix('_gap')}_rod"
            commands[argument] = number - scene[rod] if kind == "position" else number
    return commands, faults


def _kind(name: str) -> str:
    return COMMANDED.get(name, ("", ""))[0]
