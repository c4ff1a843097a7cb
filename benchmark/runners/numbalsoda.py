"""numbalsoda: LSODA compiled together with the equations; it has no events, so friction is smoothed.

Plain: its default tolerance and 1e-6 with a width of 1e-3 m/s; tuned: widths and tolerances that go down together.
"""

from functools import lru_cache
from importlib.metadata import version as _version

import numba
import numpy as np
from numbalsoda import lsoda, lsoda_sig

from benchmark.contract import PLAIN, TUNED, Answer, Setting, UnableError
from benchmark.equations import machine, smooth_slope, start

SETTINGS = [Setting(PLAIN, "rtol 0.001, width 1e-3 m/s", 1e-3), Setting(PLAIN, "rtol 1e-6, width 1e-3 m/s", 1e-6),
            Setting(TUNED, "rtol 1e-8, width 1e-5 m/s", 1e-8), Setting(TUNED, "rtol 1e-10, width 1e-7 m/s", 1e-10)]
_WIDTHS = {1e-3: 1e-3, 1e-6: 1e-3, 1e-8: 1e-5, 1e-10: 1e-7}  # m/s, by tolerance


def version():
    """Of the package."""
    return f"numbalsoda {_version('numbalsoda')}"


@lru_cache(maxsize=1)
def _compiled(numbers, width):
    @numba.cfunc(lsoda_sig)
    def slope(t, y, out, data):
        smooth_slope(t, numba.carray(y, (8,)), width, numbers, numba.carray(out, (8,)))

    return slope


def prepare(problem, setting):
    """A run of LSODA at the sampled instants."""
    if problem.parameters["normal"] == "hop":
        raise UnableError("a landing is a jump, and without events no speed can jump")
    slope, times, first = _compiled(machine(problem), _WIDTHS[setting.value]), np.array(problem.times), start(problem)

    def run():
        states, success = lsoda(slope.address, first, times, rtol=setting.value, atol=1e-3 * setting.value,
                                mxstep=10**7)
        if not success:
            raise UnableError("LSODA gave up")
        return Answer(states)

    return run
