"""Commands for several joints in one JointState, as the topic-based hardware of ros2_control sends them.

The crank is commanded by velocity [rad/s], a plate by position [m], the quantities of `joint_states`. An array as long
as the list of names has one number for each name, in that order. joint_state_topic_hardware_interface writes shorter
arrays, with a number only for each joint that has a command interface of this kind; an array of that length belongs to
those joints, in their order. A number that is not finite is no command, because controllers that are not active leave
NaN. A message that names a joint twice commands nothing, because it would be ambiguous which of the two numbers holds.
"""

import math
from collections import Counter
from typing import Any

from vibro_ros.model.parameters import quoted
from vibro_ros.model.scene import Scene

COMMANDED = {"crank": ("velocity", "motor_speed"), "upper_plate": ("position", "upper_gap"),
             "inclined_plate": ("position", "inclined_gap")}
"""For each joint that takes commands: the array of a JointState, and the argument of `Simulator.command`."""

MEASURED = ("upper_mass", "inclined_mass")  # the robot's other joints, which have states alone


def joint_commands(message: Any, scene: Scene) -> tuple[dict[str, float], list[str]]:
    """Return the commands in a JointState of any ROS library, as arguments of `Simulator.command`, and its faults.

    A fault is a sentence on a part of the message that commands nothing. A plate's gap is its position minus the length
    of the rod in `scene`.
    """
    names, commands, faults = list(message.name), dict[str, float](), list[str]()
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
                faults.append(f"{quoted(name)} is not commanded by {kind}; give {_TAKEN}")
                continue
            argument = COMMANDED[name][1]
            rod = f"crank.{argument.removesuffix('_gap')}_rod"
            commands[argument] = number - scene[rod] if kind == "position" else number
    faults += [f"{quoted(name)} is no joint of this robot; give {_TAKEN}" for name in names
               if name not in (*COMMANDED, *MEASURED) and not any(quoted(name) in fault for fault in faults)]
    return commands, faults


_TAKEN = ", ".join(f"{joint} by {array}" for joint, (array, _) in COMMANDED.items())


def _kind(name: str) -> str:
    return COMMANDED.get(name, ("", ""))[0]
