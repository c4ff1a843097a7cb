"""Rows of a study that takes seconds, by right, wrong, exploding and unable programs."""

from dataclasses import replace

import numpy as np
import pytest

import vibro_ros
from vibro_lab.accuracy.harness import Effort, Row
from vibro_lab.accuracy.programs import DEVICE, Answer, Program, UnableError, steps
from vibro_lab.accuracy.scene_rows import rows_of_scene

QUICK = Effort(repeats=1, horizon=0.1, starts=2, duration=0.5, patience_for_averages=0.1)


def with_less_damping(problem, setting):
    scene = problem.scene
    damping = {f"{side}.spring.damping": 0.9 * scene[f"{side}.spring.damping"] for side in ("upper", "inclined")}
    return DEVICE["rk4"].prepare(replace(problem, scene=scene.with_parameters(damping)), setting)


def exploding(problem, setting):
    return lambda: Answer(np.full((len(problem.times), 8), np.nan))


def unable(problem, setting):
    raise UnableError("cannot do it")


@pytest.fixture(scope="session")
def rows() -> list[Row]:
    """Rows of the scene damped."""
    tried = steps(1e-4, 1e-5, 1e-6)
    programs = {"exact": DEVICE["exact"], "rk4": DEVICE["rk4"]._replace(settings=tried),
                "planted": Program("planted", tried, with_less_damping),
                "exploding": Program("exploding", steps(1e-4), exploding),
                "unable": Program("unable", steps(1e-4), unable)}
    return list(rows_of_scene(vibro_ros.load_scene("damped"), programs, QUICK))
