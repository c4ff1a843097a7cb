"""Random starts of a scene that are independent of each other.

A loss-free scene is not ergodic: its long-term motion depends on its start, and starts along one line, such as
equidistant speeds, may miss some motions. A start is therefore random: three stretches within the first second, each of
random length and with a random motor speed and random gaps. The random generator is seeded by the start's number.
"""

import numpy as np

from vibro_ros import Scene, Simulator

STARTING = 1.0
"""Duration [s] of the random part of a start, with other motor speeds and gaps than the scene's."""
SETTLING = 4.0
"""Time [s] from which on a start's mean speed is measured."""
RUNNING_SPEED = 100.0
"""Motor speed [rad/s] that a scene gets whose motor stands still but has to turn, unless `motor.max_speed` is lower."""
# Number of stretches; earliest end of a stretch [s]; least speed or voltage as a share of the scene's; largest change
# of a gap as a share of the crank's radius.
_STRETCHES, _FIRST_END, _SLOWEST, _GAPS = 3, 0.1, 0.5, 0.1


def drawn_start(scene: Scene, number: int) -> Simulator:
    """Return a device at time `STARTING` after random start `number`.

    Start `number` of two scenes uses the same random numbers, so that differences do not come from the draw.
    """
    return start_device(scene, np.random.default_rng((0, number)))


def start_device(scene: Scene, draw: np.random.Generator) -> Simulator:
    """Return a device after a random start, at the motor speed or voltage of `scene`, its plates moving to its gaps."""
    device, reach = Simulator(scene), _GAPS * scene["crank.radius"]
    name, command = motor_command(scene)
    gaps = {f"{side}_gap": scene[f"{side}.gap"] for side in scene.guides}
    for end in (*np.sort(draw.uniform(_FIRST_END, STARTING, _STRETCHES - 1)), STARTING):
        aside = {}
        for side, gap in gaps.items():
            rod = scene[f"crank.{side.removesuffix('_gap')}_rod"]
            aside[side] = min(max(gap + draw.uniform(-reach, reach), -rod), rod)
        device.command(**{name: command * draw.uniform(_SLOWEST, 1.0)}, **aside)
        device.advance_to(end)
    device.command(**{name: command}, **gaps)
    return device


def started_at_share(scene: Scene, share: float, command: float) -> Simulator:
    """Return a device that gets the motor `command` [rad/s or V] after a first second at (1 + `share`) / 2 of it."""
    device = Simulator(scene)
    device.command(**{scene.motor_command: command * (1.0 + share) / 2.0})
    device.advance_to(STARTING)
    device.command(**{scene.motor_command: command})
    return device


def motor_command(scene: Scene) -> tuple[str, float]:
    """Name of the command of the motor of `scene`, and its value in the scene: a speed [rad/s], or a voltage [V]."""
    return scene.motor_command, scene[scene.motor_command.replace("_", ".")]


def running(scene: Scene) -> Scene:
    """Return `scene`, with `motor.speed` set to `RUNNING_SPEED`, or its maximum if lower, if it is 0."""
    if scene["motor.speed"]:
        return scene
    return scene.with_parameters({"motor.speed": min(RUNNING_SPEED, scene["motor.max_speed"])})
