"""A small command map of the scene `device` whose contents the tests know."""

import numpy as np

import vibro_ros
from vibro_ros.configuration.command_map import PATCHWORK, Axis, CommandMap, Curve, Found, parameters_that_count

SIDES = ("upper", "inclined")
SPEEDS, GAPS = Axis(10.0, 120.0, 12), Axis(0.0, 0.004, 5)


def mean_speed(motor_speed: float, gap: float) -> float:
    """Mean speed [m/s] of every motion with a period in the known map; it is linear, so that interpolation is exact."""
    return -1e-3 * motor_speed - 2.0 * gap


def known_map() -> CommandMap:
    """Motor speeds 10 to 120 rad/s and gaps 0 to 4 mm.

    Motion 0 has period 1, up to 60 rad/s. Motion 1 has period 2, from 60 rad/s on, so that both exist there. At 90
    rad/s nothing was found. At 100 rad/s there is motion 2 without a period, and from 110 rad/s on cells of no motion.
    """
    rows = []
    for i, speed in enumerate(SPEEDS.values.tolist()):
        for j, gap in enumerate(GAPS.values.tolist()):
            kinds = ([(0, 1)] if speed <= 60.0 else []) + ([(1, 2)] if 60.0 <= speed < 90.0 else [])
            kinds += [(2, 0)] if speed == 100.0 else [(PATCHWORK, 3)] if speed > 100.0 else []
            for motion, turns in kinds:
                value = mean_speed(speed, gap) - (0.02 if motion == 1 else 0.0)
                sure = int(len(kinds) == 1 and motion in (0, 1))
                rows.append((i, j, motion, turns, turns, sure, value, np.nan if j == 0 else 10.0 + j, 0.125, 0.5))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    scene = vibro_ros.load_scene("device")
    curve = Curve("fold", 1, (61.25, 62.5), (0.0, 0.004))
    return CommandMap("device", parameters_that_count(scene, SIDES), SIDES, SPEEDS, GAPS, Found(*columns), (curve,))
