"""heyoka: Taylor series of adaptive order with terminal events; the modes of the robot are written by hand.

Plain uses the default tolerance, which heyoka's documentation recommends. The cooldown of events, which would hide the
second of two events at one instant, is off in both uses (`benchmark.heyoka_robot` gives the reason). A bouncing ball
has one event. Plain, the run goes on as long as heyoka finds this event, as its documentation shows; tuned, no step is
much longer than the flight, and a landing slower than the tolerance [m/s] is the last.
"""

import math
from functools import lru_cache
from importlib.metadata import version as _version

import heyoka as hy
import numpy as np

from benchmark.heyoka_robot import HeyokaRobot
from vibro_lab.accuracy.programs import (
    PLAIN,
    TUNED,
    Answer,
    Program,
    Setting,
    UnableError,
    drive_speed,
    event_array,
    ordered_events,
    tolerances,
)

SETTINGS = (Setting(2.220446049250313e-16, "tolerance as it comes", PLAIN),
            *(Setting(tolerance, f"tolerance {tolerance:g}", TUNED) for tolerance in (1e-6, 1e-9, 1e-12)))
_MOST_LANDINGS = 5000
_ABOVE = 1e-40  # m, height at which a flight starts, because from height 0 no later event is found


def version():
    """Return heyoka's version."""
    return f"heyoka {_version('heyoka')}"


def prepare(problem, setting):
    """Return a run by a compiled integrator."""
    if getattr(problem, "parameters", {}).get("restitution"):
        return _ball(problem, setting)
    try:
        robot = _robot(problem.scene, setting.value)
    except (RuntimeError, ValueError) as error:
        raise UnableError(f"heyoka: {error}") from error
    speed = drive_speed(problem.scene)
    commands = () if speed is None else ((0.0, {"motor_speed": speed}),)

    def run():
        try:
            solution = robot.integrate(problem.times, commands)
        except (RuntimeError, ValueError) as error:
            raise UnableError(f"heyoka: {error}") from error
        return Answer(solution.samples, lambda: ordered_events(solution.events))

    return run


@lru_cache(maxsize=1)
def _robot(scene, tolerance):
    """Return the robot of a scene, from a cache because it takes longer to compile than to run."""
    return HeyokaRobot(scene, tolerance)


def _ball(problem, setting):
    """Return a run of a body without masses that falls on the ground and bounces, from one terminal event to the next.
    """
    gravity, restitution, times = problem.parameters["g"], problem.parameters["restitution"], problem.times
    (y, dy), tuned = hy.make_vars("y", "dy"), setting.use != PLAIN
    ground = hy.t_event(y, direction=hy.event_direction.negative, cooldown=0.0)
    integrator = hy.taylor_adaptive([(y, dy), (dy, hy.expression(-gravity))], [0.0, 0.0], tol=setting.value,
                                    t_events=[ground])

    def run():
        rows, done, landings, longest = np.zeros((len(times), 8)), 0, [], math.inf
        integrator.time, integrator.state[:] = 0.0, (problem.start["y"], problem.start["dy"])
        while len(landings) < _MOST_LANDINGS:
            integrator.time = now = integrator.time  # drops the low part, with which the grid would start too early
            later = times[done:]
            leading = [now] if later[0] > now else []
            outcome, *_, points = integrator.propagate_grid(np.concatenate([leading, later]), max_delta_t=longest)
            points = points[len(leading):]
            rows[done:done + len(points), 6:] = points
            done += len(points)
            if outcome == hy.taylor_outcome.time_limit:
                return Answer(rows, lambda: event_array(landings))
            fall = -integrator.state[1]
            landings.append((integrator.time, "landing"))
            if tuned and fall <= setting.value:
                return Answer(rows, lambda: event_array(landings))
            integrator.state[:] = _ABOVE, restitution * fall
            longest = 3.0 * restitution * fall / gravity if tuned else math.inf
        raise UnableError(f"landings without end at {integrator.time:.6g} s")

    return run


#: heyoka on scenes: a tolerance for every second decade, and the strictest, which checks the reference.
ON_SCENES = Program("heyoka", tolerances(1e-5, 1e-7, 1e-9, 1e-11, 1e-13, 1e-15), prepare, version)
