"""Parallel computation of many jobs, and random starts that are independent of each other."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

import numpy as np
from tqdm import tqdm

import vibro_ros

Item = TypeVar("Item")
Result = TypeVar("Result")


def computed(function: Callable[[Item], Result], items: Sequence[Item], words: str) -> list[Result]:
    """Compute `function` for all `items` on all cores; returns the results in order, `words` label the progress bar."""
    vibro_ros.simulate(vibro_ros.Scene("paper", {}), duration=0.01, rate=100.0)  # compiles once for all processes
    with ProcessPoolExecutor(min(os.cpu_count() or 1, len(items))) as pool:
        return list(tqdm(pool.map(function, items), words, total=len(items), disable=None))


def started(scene: vibro_ros.Scene, draw: np.random.Generator) -> vibro_ros.Simulator:
    """Return a device at 1 s, after three stretches of random length, motor speed and gaps, with the scene's commands.

    Such starts are independent of each other; starts along one line, such as equidistant speeds, are not.
    """
    device, speed, reach = vibro_ros.Simulator(scene), scene["motor.speed"], 0.1 * scene["crank.radius"]
    gaps = {f"{side}_gap": scene[f"{side}.gap"] for side in scene.guides}
    for end in (*np.sort(draw.uniform(0.1, 1.0, 2)), 1.0):
        aside = {}
        for name, gap in gaps.items():
            rod = scene[f"crank.{name.removesuffix('_gap')}_rod"]
            aside[name] = min(max(gap + draw.uniform(-reach, reach), -rod), rod)
        device.command(motor_speed=speed * draw.uniform(0.5, 1.0), **aside)
        device.advance_to(end)
    device.command(motor_speed=speed, **gaps)
    return device
