"""scipy's `solve_ivp`: the whole equations at once with its defaults and tighter, or DOP853 from event to event.

`solve_ivp` and its solvers call equations back from Python; `LowLevelCallable` serves scipy's quadrature, not these.
"""

from importlib.metadata import version as _version

import numpy as np
from scipy.integrate import DOP853, solve_ivp
from scipy.optimize import brentq

from benchmark import located
from benchmark.equations import Callbacks, machine, start
from vibro_lab.accuracy.programs import PLAIN, TUNED, Answer, Setting, UnableError

SETTINGS = (*(Setting(rtol, f"RK45, rtol {rtol:g}", PLAIN) for rtol in (1e-3, 1e-6)),
            *(Setting(rtol, f"DOP853 with events, rtol {rtol:g}", TUNED) for rtol in (1e-6, 1e-9, 1e-12)))
_WIDTH = 1e-3  # m/s, width over which a first script would smooth friction
_FIRST_STEP = 1e-7  # s, after an event: a blow may follow another within a step of usual length


def version():
    """Return scipy's version."""
    return f"scipy {_version('scipy')}"


def prepare(problem, setting):
    """Prepare a run. Plain: no events, friction smoothed; tuned: every event located on the dense output, with a
    restart in the next mode.
    """
    callbacks = Callbacks(machine(problem, slow=setting.value), _WIDTH)
    return _plain(problem, callbacks, setting.value) if setting.use == PLAIN else (
        lambda: located.run(problem, callbacks, _steps(callbacks, setting.value)))


def _plain(problem, callbacks, rtol):
    if problem.parameters["normal"] == "hop":
        raise UnableError("a landing is a jump, and without events no speed can jump")

    def run():
        callbacks.begin(start(problem))
        solution = solve_ivp(_returned(callbacks.smooth, 8), (0.0, problem.times[-1]), start(problem),
                          t_eval=problem.times, rtol=rtol, atol=1e-3 * rtol)
        if not solution.success:
            raise UnableError(solution.message)
        return Answer(solution.y.T, callbacks=callbacks.seconds)

    return run


def _returned(function, size):
    """Return a function that returns, as an array of shape (size,), what `function` writes into its last argument."""
    def returning(t, y):
        out = np.empty(size)
        function(t, y, out)
        return out

    return returning


def _steps(callbacks, rtol):
    """Steps of DOP853, as `located.run` takes them; an event is a zero of a guard on the dense output."""
    slope, guards = _returned(callbacks.slope, 8), _returned(callbacks.guards, 4)

    def integrate(t, y, end, brief):
        solver = DOP853(slope, t, y, end, rtol=max(rtol, 3e-14), atol=1e-3 * rtol,
                        first_step=min(_FIRST_STEP, brief, end - t))
        previous = guards(t, y)
        while solver.status == "running":
            if solver.step():
                raise UnableError("the step became too small")
            now, values = solver.t, guards(solver.t, solver.y)
            dense = solver.dense_output()
            roots = [(_root(guards, dense, k, solver.t_old, now), k)
                     for k in range(len(values)) if previous[k] > 0.0 >= values[k]]
            roots += [(solver.t_old, k) for k in (0, 1) if values[k] < previous[k] <= 0.0]  # bounced off and came back
            if roots:
                now, which = min(roots)
                yield now, dense, which
                return
            previous = values
            yield now, dense, None

    return integrate


def _root(guards, dense, k, begin, end):
    return brentq(lambda t: guards(t, dense(t))[k], begin, end, xtol=1e-15, rtol=1e-15)
