"""`exact` of vibro_ros: modes in closed form or series, every event located."""

import math
from importlib.metadata import version as _version

import numpy as np

import vibro_ros
from benchmark.contract import PLAIN, Answer, Setting

SETTINGS = [Setting(PLAIN, "as it comes", 0.0)]
_FIELDS = ("upper_position", "upper_velocity", "inclined_position", "inclined_velocity", "body_position",
           "body_velocity", "body_height", "body_vertical_velocity")


def version():
    """Of the package."""
    return f"vibro_ros {_version('vibro_ros')}"


def prepare(problem, setting):
    """A run at the sampled instants."""
    scene = vibro_ros.load_scene("paper").with_parameters(problem.scene())
    times = np.array(problem.times)

    def run():
        found = vibro_ros.simulate(scene, times=times)
        columns = [getattr(found, field, None) for field in _FIELDS]
        rows = np.array([np.full(len(times), math.nan) if column is None else column for column in columns]).T
        kinds, counts = np.unique(found.events["kind"], return_counts=True)
        return Answer(rows, {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)})

    run()
    return run
