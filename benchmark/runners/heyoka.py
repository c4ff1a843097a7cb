"""heyoka: Taylor series of adaptive order with terminal events, the modes of a robot written for it by hand.

Its documentation advises the default tolerance; the cooldown of its events, which would hide the second of two events
in one instant, is off in both uses (`tools.peer` tells why). A ball that bounces has one event, which as documented
goes on as long as it is found; tuned, no step is much longer than the flight, and a landing slower than the tolerance
[m/s] is the last.
"""

import math
from importlib.metadata import version as _version

import heyoka as hy
import numpy as np

from benchmark.contract import PLAIN, TUNED, Answer, Setting, UnableError

SETTINGS = [Setting(PLAIN, "tolerance as it comes", 2.220446049250313e-16),
            *(Setting(TUNED, f"tolerance {tolerance:g}", tolerance) for tolerance in (1e-6, 1e-9, 1e-12))]
_MOST_LANDINGS = 5000
_ABOVE = 1e-40  # m, where a flight begins: on the ground itself no later event is seen


def version():
    """Of the package."""
    return f"heyoka {_version('heyoka')}"


def prepare(problem, setting):
    """A compiled integrator that runs from the start."""
    if problem.parameters["restitution"]:
        return _ball(problem, setting)
    from tools.peer import Peer
    from vibro_ros import load_scene

    try:
        peer = Peer(load_scene("paper").with_parameters(problem.scene()), setting.value)
    except ValueError as error:
        raise UnableError(str(error)) from error
    times = np.array(problem.times)

    def run():
        found = peer.integrate(times)
        kinds, counts = np.unique(found.events["kind"], return_counts=True)
        return Answer(found.samples, {str(kind): int(count) for kind, count in zip(kinds, counts, strict=True)})

    return run


def _ball(problem, setting):
    """A body alone that falls on the ground and bounces, from one terminal event to the next."""
    gravity, restitution, times = problem.parameters["g"], problem.parameters["restitution"], np.array(problem.times)
    (y, dy), tuned = hy.make_vars("y", "dy"), setting.kind != PLAIN
    ground = hy.t_event(y, direction=hy.event_direction.negative, cooldown=0.0)
    integrator = hy.taylor_adaptive([(y, dy), (dy, hy.expression(-gravity))], [0.0, 0.0], tol=setting.value,
                                    t_events=[ground])

    def run():
        rows, done, landings, longest = np.zeros((len(times), 8)), 0, 0, math.inf
        integrator.time, integrator.state[:] = 0.0, (problem.start["y"], problem.start["dy"])
        while landings < _MOST_LANDINGS:
            integrator.time = now = integrator.time  # drops its second double, by which the grid would begin too early
            later = times[done:]
            before = [now] if later[0] > now else []
            outcome, *_, found = integrator.propagate_grid(np.concatenate([before, later]), max_delta_t=longest)
            found = found[len(before):]
            rows[done:done + len(found), 6:] = found
            done += len(found)
            if outcome == hy.taylor_outcome.time_limit:
                return Answer(rows, {"landing": landings})
            fall, landings = -integrator.state[1], landings + 1
            if tuned and fall <= setting.value:
                return Answer(rows, {"landing": landings})
            integrator.state[:] = _ABOVE, restitution * fall
            longest = 3.0 * restitution * fall / gravity if tuned else math.inf
        raise UnableError(f"landings without end at {integrator.time:.6g} s")

    return run
