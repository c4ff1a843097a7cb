"""The executable `accuracy` with two robots that are written apart, heyoka's and the baseline.

`python -m tools.peer.accuracy --scene mine.yaml` measures a user's scene so. heyoka is one more method, and the first
check of the reference: its equations are written apart from the tables that `exact` and scipy's solvers integrate, so
that it checks those tables as well. Costs are ratios to Runge-Kutta 4 as one would write it by hand for one scene; with
a dc motor, to the device's own.
"""

import sys
from functools import lru_cache

import numpy as np

from tools import baseline
from tools.peer import Peer
from vibro_ros.accuracy.accuracy import main
from vibro_ros.accuracy.methods import (
    METHODS,
    STUDIED,
    Answer,
    ComparedMethod,
    drive_speed,
    event_array,
    ladder,
)
from vibro_ros.accuracy.precision import BY_DOP853, Check, Effort
from vibro_ros.accuracy.tables_by_scipy import UnableError
from vibro_ros.model.scene import Scene


@lru_cache(maxsize=1)
def _peer(scene: Scene, tolerance: float) -> Peer:
    """The peer, which takes longer to compile than to run: kept for the next run of the same scene."""
    return Peer(scene, tolerance)


def by_heyoka(scene: Scene, times: np.ndarray, tolerance: float) -> Answer:
    """The peer as a method; its tolerance is relative to the state, at least 1e-15."""
    speed = drive_speed(scene)
    commands = () if speed is None else ((0.0, {"motor_speed": speed}),)
    try:
        run = _peer(scene, tolerance).integrate(times, commands)
    except (RuntimeError, ValueError) as error:
        raise UnableError(f"heyoka: {error}") from error
    return Answer(times, run.samples, event_array(zip(run.events["time"], run.events["kind"], strict=True)), run.steps,
                  0, run.wall_time)


def by_baseline(scene: Scene, times: np.ndarray, step: float) -> Answer:
    """The baseline by hand; the device's own Runge-Kutta 4 for a dc motor, which the baseline does not have."""
    return METHODS["rk4"](scene, times, step) if scene.has_rotor else baseline.by_baseline(scene, times, step)


#: What costs are ratios to.
BASELINE = ComparedMethod(by_baseline, "step", (1e-5,))
#: Every method of a study, and heyoka; a setting every second decade.
STUDIED_APART = STUDIED | {
    "baseline": BASELINE, "heyoka": ComparedMethod(by_heyoka, "tolerance", ladder(1e-5, 1e-15)[::4], True)}
#: The usual effort, the reference checked by heyoka first.
EFFORT = Effort(checks=(Check("heyoka", by_heyoka, 1e-15), BY_DOP853), baseline=BASELINE)

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], STUDIED_APART, EFFORT))
