"""A study that takes seconds, and methods that are wrong in ways that it must show."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from vibro_ros.accuracy.methods import METHODS, Answer, UnableError
from vibro_ros.accuracy.precision import Effort

QUICK = Effort(repeats=1, horizon=0.1, starts=2, duration=0.5)
if find_spec("heyoka"):
    from tools.peer.accuracy import EFFORT

    QUICK = replace(QUICK, checks=EFFORT.checks)


def with_less_damping(scene, times, step):
    damping = {f"{side}.spring.damping": 0.9 * scene[f"{side}.spring.damping"] for side in ("upper", "inclined")}
    return METHODS["rk4"](scene.with_parameters(damping), times, step)


def exploding(scene, times, step):
    answer = METHODS["rk4"](scene, times, step)
    return Answer(times, np.full_like(answer.samples, np.nan), answer.events, 1, 1, 1.0)


def unable(scene, times, step):
    raise UnableError("cannot do it")
