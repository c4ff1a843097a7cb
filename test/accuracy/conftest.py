"""Rows of a study that takes seconds."""

import pytest
from quick_study import QUICK, exploding, unable, with_less_damping

import vibro_ros
from vibro_ros.accuracy.measurement import Measurement
from vibro_ros.accuracy.methods import METHODS, STUDIED, ComparedMethod
from vibro_ros.accuracy.precision import SceneStudy


@pytest.fixture(scope="session")
def rows() -> list[Measurement]:
    """Rows of the scene damped, by right, wrong, exploding and unable methods."""
    steps = (1e-4, 1e-5, 1e-6)
    table = {"exact": METHODS["exact"], "rk4": ComparedMethod(METHODS["rk4"].run, "step", steps, compiled=True),
             "planted": ComparedMethod(with_less_damping, "step", steps),
             "exploding": ComparedMethod(exploding, "step", (1e-4,)),
             "unable": ComparedMethod(unable, "step", (1e-4,)), "baseline": STUDIED["baseline"]}
    study = SceneStudy(vibro_ros.load_scene("damped"), QUICK)
    measured = list(study.rows(table))
    assert len(measured) <= study.count(table)
    return measured
