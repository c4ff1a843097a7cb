"""Drawn starts: devices that have begun in ways which are independent of each other.

A loss-free scene is not ergodic: what its body does for ever depends on how it began, and starts along one line, such
as equidistant speeds, may miss part of it. A start is therefore drawn: three stretches within the first second, each of
random length and with a random motor speed and random gaps, all from a generator of its own number.
"""

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.simulation.simulator import Simulator

STARTING = 1.0
"""Time [s] at other motor speeds and gaps."""
SETTLING = 4.0
"""Time [s] that a start is given before its mean speed counts."""
RUNNING_SPEED = 100.0
"""Motor speed [rad/s] of a scene whose motor stands still, where it has to turn and may turn so fast."""
# Stretches of a start; the first instant at which one may end [s]; least speed or voltage in parts of the scene's;
# largest change of a gap in parts of the crank's radius.
_STRETCHES, _FIRST_END, _SLOWEST, _GAPS = 3, 0.1, 0.5, 0.1


def drawn_start(scene: Scene, number: int, batch: int = 0) -> Simulator:
    """A device at `STARTING`, after the drawn start of a number; another `batch` has other starts.

    Start `number` of two scenes has the same random numbers, so that differences between them are not of the draw.
    """
    return started(scene, np.random.default_rng((batch, number)))


def started(scene: Scene, draw: np.random.Generator) -> Simulator:
    """A device after its start, at the motor speed or voltage of `scene`, its plates on their way to its gaps."""
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
    """A device at the motor speed [rad/s] or voltage [V] of `command`, after a first second at (1 + `share`) / 2 of it.
    """
    device = Simulator(scene)
    device.command(**{scene.motor_command: command * (1.0 + share) / 2.0})
    device.advance_to(STARTING)
    device.command(**{scene.motor_command: command})
    return device


def motor_command(scene: Scene) -> tuple[str, float]:
    """What commands the motor of `scene`, and its value there: a speed [rad/s], or a voltage [V]."""
    return scene.motor_command, scene[scene.motor_command.replace("_", ".")]


def running(scene: Scene) -> Scene:
    """`scene`, its motor turning from the start at `RUNNING_SPEED` if it stands still there."""
    if scene["motor.speed"]:
        return scene
    return scene.with_parameters({"motor.speed": min(RUNNING_SPEED, scene["motor.max_speed"])})
