"""CVODE of SUNDIALS by scikit-sundae: BDF on the whole equations, or Adams from event to event by its root finding."""

from importlib.metadata import version as _version

import numpy as np
from sksundae.cvode import CVODE

from benchmark import located
from benchmark.equations import machine, smooth_slope, start
from vibro_ros.accuracy.programs import PLAIN, TUNED, Answer, Setting, UnableError

SETTINGS = (*(Setting(rtol, f"BDF, rtol {rtol:g}", PLAIN) for rtol in (1e-5, 1e-8)),
            *(Setting(rtol, f"Adams with roots, rtol {rtol:g}", TUNED) for rtol in (1e-6, 1e-9, 1e-12)))
_WIDTH = 1e-3  # m/s, over which a first script smooths friction
_DIGITS = 1e-3  # atol per rtol: speeds of 1e-3 m/s count


def version():
    """Of the package and of the SUNDIALS in it."""
    return f"scikit-sundae {_version('scikit-sundae')}"


def prepare(problem, setting):
    """Plain: no events, friction smoothed; tuned: one run of CVODE from event to event."""
    numbers = machine(problem, slow=setting.value)
    if setting.use == PLAIN:
        return _plain(problem, numbers, setting.value)
    return lambda: located.run(problem, numbers, _steps(problem.times, setting.value))


def _plain(problem, numbers, rtol):
    if problem.parameters["normal"] == "hop":
        raise UnableError("a landing is a jump, and without events no speed can jump")

    def slope(t, y, out):
        smooth_slope(t, y, _WIDTH, numbers, out)

    def run():
        solver = CVODE(slope, method="BDF", rtol=rtol, atol=_DIGITS * rtol, max_num_steps=10**7)
        found = solver.solve(np.array(problem.times), start(problem))
        if not found.success:
            raise UnableError(str(found.message))
        return Answer(found.y)

    slope(0.0, start(problem), np.empty(8))
    return run


def _steps(times, rtol):
    """One run to the next event as `located.run` takes it, by way of the sampled instants."""

    def integrate(slope, guards, t, y, end, brief):
        def right(at, state, out):
            out[:] = slope(at, state)

        def roots(at, state, out):
            out[:] = guards(at, state)

        roots.direction = [-1] * 4
        solver = CVODE(right, method="Adams", rtol=max(rtol, 1e-14), atol=_DIGITS * rtol, max_num_steps=10**6,
                       eventsfn=roots, num_events=4, first_step=brief if brief < end - t else 0.0)
        solver.init_step(t, y)
        for stop in (time for time in times if time > t):
            found = solver.step(stop, tstop=end)
            if not found.success:
                raise UnableError(str(found.message))
            state = np.array(found.y)
            which = None if found.i_events is None else int(np.flatnonzero(np.ravel(found.i_events))[0])
            yield float(found.t), lambda time, state=state: state, which
            if which is not None:
                return

    return integrate
