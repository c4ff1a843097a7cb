"""The mode automaton: what each guard's zero changes, as run-time parameters of the equations.

heyoka finds a root wherever an event's polynomial starts at zero, and its own remedy, a cooldown, would hide a true
event that follows at once (bounces that die out, N = 0 just after an impact). So cooldowns are off, and whatever fires
is put on its new side by less than a rounding error: a depth, a height or a speed of the body by a nudge of the state,
a force by an offset of its guard.
"""

import numpy as np

from vibro_ros.study.peer.body import Body
from vibro_ros.study.peer.equations import Equations
from vibro_ros.study.peer.plates import Plates
from vibro_ros.study.peer.present import Present
from vibro_ros.study.peer.series import Series


class Automaton:
    """Modes of plates and body.

    Parameters
    ----------
    equations : Equations
    state, switches : ndarray
        The integrator's own arrays, changed in place.

    Attributes
    ----------
    present : Present
        Run-time parameters by name, and events.
    """

    def __init__(self, equations: Equations, state: np.ndarray, switches: np.ndarray):
        self.present = Present(equations, state, switches)
        series = Series(equations, state, switches)
        self._body = Body(equations, self.present, series)
        self._plates = Plates(equations, self.present, self._body, series)
        self._body.feel_shock = self._plates.feel_shock

    def begin(self) -> None:
        """Forget everything, as before a start."""
        for part in (self.present, self._body, self._plates):
            part.begin()

    def actions(self) -> dict[str, object]:
        """What each of `Equations.guards` does: a function of time [s] and the sign of the guard's derivative."""
        actions = self._plates.actions() | self._body.actions()
        return {name: lambda t, d, act=act: (act(t, d), self._plates.release(t)) for name, act in actions.items()}

    def settle(self, time: float) -> None:
        """Decide every mode afresh, ties included."""
        self._plates.settle(time)
        self._body.settle(time)
        self._plates.release(time)
