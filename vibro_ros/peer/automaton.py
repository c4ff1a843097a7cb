"""The modes of the peer: what changes when a guard passes zero, as run-time parameters of the equations.

heyoka finds a root wherever the polynomial of an event starts at zero. heyoka's own remedy, a cooldown, would hide a
true event that follows at once, such as the bounces that die out, or N = 0 just after an impact. Therefore cooldowns
are off, and each quantity whose guard has fired is put on its new side of zero by less than a rounding error: a depth,
a height or a speed of the body by a nudge of the state, a force by an offset of its guard.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from vibro_ros.peer.body import Body
from vibro_ros.peer.equations import Equations
from vibro_ros.peer.plates import Plates
from vibro_ros.peer.run_state import RunState
from vibro_ros.peer.series import Series


class Automaton:
    """The modes of plates and body, and the actions of all guards.

    Parameters
    ----------
    equations : Equations
        The equations of the scene.
    state, parameters : ndarray, shapes (n,) and (m,)
        The integrator's own arrays of state and run-time parameters, which are changed in place.

    Attributes
    ----------
    run : RunState
        State, run-time parameters, forces and events of the run.
    """

    def __init__(self, equations: Equations, state: np.ndarray, parameters: np.ndarray):
        self.run = RunState(equations, state, parameters)
        series = Series(equations, state, parameters)
        self._body = Body(equations, self.run, series)
        self._plates = Plates(equations, self.run, self._body, series)
        self._body.feel_shock = self._plates.feel_shock

    def reset(self) -> None:
        """Return to what holds before a start: no events, plates open, no state of the body."""
        for part in (self.run, self._body, self._plates):
            part.reset()

    def actions(self) -> dict[str, Callable[[float, int], None]]:
        """The action of each of `Equations.guards`: a function of time [s] and the sign of the guard's derivative."""
        actions = self._plates.actions() | self._body.actions()
        return {name: partial(self._act, act) for name, act in actions.items()}

    def _act(self, action: Callable[[float, int], None], time: float, direction: int) -> None:
        action(time, direction)
        self._plates.release_unpressed(time)

    def settle(self, time: float) -> None:
        """Decide the states of all plates and of the body from the motion, also where a guard is exactly zero."""
        self._plates.settle(time)
        self._body.settle(time)
        self._plates.release_unpressed(time)
