"""CVODE of SUNDIALS by scikit-sundae: BDF on the whole equations, or Adams from event to event by its root finding.

scikit-sundae calls equations back from Python and takes no compiled function; `Callbacks` is the cheapest that Python
allows.
"""

from importlib.metadata import version as _version

import numpy as np
from sksundae.cvode import CVODE

from benchmark import located
from benchmark.equations import Callbacks, machine, start
from vibro_lab.accuracy.programs import PLAIN, TUNED, Answer, Setting, UnableError

SETTINGS = (*(Setting(rtol, f"BDF, rtol {rtol:g}", PLAIN) for rtol in (1e-5, 1e-8)),
            *(Setting(rtol, f"Adams with roots, rtol {rtol:g}", TUNED) for rtol in (1e-6, 1e-9, 1e-12)))
_WIDTH = 1e-3  # m/s, width over which a first script would smooth friction
_DIGITS = 1e-3  # atol over rtol, so that speeds of 1e-3 m/s are resolved


def version():
    """Return the versions of scikit-sundae and of the SUNDIALS in it."""
    return f"scikit-sundae {_version('scikit-sundae')}"


def prepare(problem, setting):
    """Prepare a run. Plain: no events, friction smoothed; tuned: CVODE restarted at every event."""
    callbacks = Callbacks(machine(problem, slow=setting.value), _WIDTH)
    if setting.use == PLAIN:
        return _plain(problem, callbacks, setting.value)
    return lambda: located.run(problem, callbacks, _steps(problem.times, callbacks, setting.value))


def _plain(problem, callbacks, rtol):
    if problem.parameters["normal"] == "hop":
        raise UnableError("a landing is a jump, and without events no speed can jump")

    def run():
        callbacks.begin(start(problem))
        solver = CVODE(callbacks.smooth, method="BDF", rtol=rtol, atol=_DIGITS * rtol, max_num_steps=10**7)
        solution = solver.solve(np.array(problem.times), start(problem))
        if not solution.success:
            raise UnableError(str(solution.message))
        return Answer(solution.y, callbacks=callbacks.seconds)

    return run


def _steps(times, callbacks, rtol):
    """Yield the steps of a run up to the next event, as `located.run` requires, with a stop at each sampled instant."""
    # plain functions, because scikit-sundae inspects their arguments before each run, which takes milliseconds for
    # numba's
    def right(t, y, out):
        callbacks.slope(t, y, out)

    def roots(t, y, out):
        callbacks.guards(t, y, out)

    roots.direction = [-1] * 4

    def integrate(t, y, end, brief):
        solver = CVODE(right, method="Adams", rtol=max(rtol, 1e-14), atol=_DIGITS * rtol,
                       max_num_steps=10**6, eventsfn=roots, num_events=4,
                       first_step=brief if brief < end - t else 0.0)
        solver.init_step(t, y)
        for stop in (time for time in times if time > t):
            step = solver.step(stop, tstop=end)
            if not step.success:
                raise UnableError(str(step.message))
            state = np.array(step.y)
            which = None if step.i_events is None else int(np.flatnonzero(np.ravel(step.i_events))[0])
            yield float(step.t), lambda time, state=state: state, which
            if which is not None:
                return

    return integrate
