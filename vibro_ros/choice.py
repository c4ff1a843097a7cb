"""`solver.method: auto`: the cheapest method and step that keep a scene within `solver.accuracy`, by measurement."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vibro_ros.model.scene import Scene
from vibro_ros.solver.methods import SCHEMES

#: Length of the runs that are measured [s].
HORIZON = 0.2
_INSTANTS = 201
#: What `solver.accuracy` is divided by: the error of a step in one stretch of the motion varies from that in another.
SAFETY = 4.0
# `exact` is left only for what costs less by more than a measurement of time is off.
_CLEARLY_LESS = 0.8
# Steps that are tried [s]; `solver.step` allows them.
_COARSEST, _FINEST, _STEPS_A_DECADE = 1e-2, 1e-8, 4
# Step that shows what a step costs [s].
_TYPICAL = 1e-4

#: Positions [m], shape (coordinates, n), of a scene at instants [s], and the seconds that it takes to go on for as
#: long again; positions that are not finite if it cannot.
Measure = Callable[[Scene, np.ndarray], tuple[np.ndarray, float]]


@dataclass(frozen=True)
class Choice:
    """What `auto` has picked.

    Attributes
    ----------
    method : str
        A `solver.method`.
    step : float
        Its `solver.step` [s]; infinite for `exact`, which has none.
    error : float
        Largest error of a position within the horizon [m], measured against `exact`.
    cost, exact_cost : float
        Computing time by it and by `exact` [s per simulated s].
    """

    method: str
    step: float
    error: float
    cost: float
    exact_cost: float

    def __str__(self):
        if self.method == "exact":
            return f"exact: no step of fixed length is as accurate for less than its {1e3 * self.cost:.3g} ms a second"
        return (f"{self.method} with a step of {self.step:.3g} s: off by {self.error:.2g} m within {HORIZON:g} s, for "
                f"{1e3 * self.cost:.3g} ms a second (exact: {1e3 * self.exact_cost:.3g} ms)")


def choose(scene: Scene, measure: Measure) -> Choice:
    """Pick for `scene`, at its `motor.speed`, or at `motor.max_speed` if it starts at rest.

    The answer hangs on measured times: where two methods cost nearly the same, it may differ from run to run.
    """
    trial = _Trial(scene, measure)
    exact = Choice("exact", math.inf, 0.0, trial.exact_cost, trial.exact_cost)
    found = (trial.coarsest(name) for name in SCHEMES)
    return min([exact, *filter(None, found)], key=lambda choice: choice.cost)


def chosen(scene: Scene, choice: Choice) -> Scene:
    """`scene` with the method and step of `choice`."""
    step = {} if choice.method == "exact" else {"solver.step": choice.step}
    return scene.with_parameters({"solver.method": choice.method, **step})


class _Trial:
    """One scene's measurements."""

    def __init__(self, scene: Scene, measure: Measure):
        speed = scene["motor.speed"] or scene["motor.max_speed"]
        self._scene = scene.with_parameters({"motor.speed": speed, "solver.audit": False})
        self._measure, self._times = measure, np.linspace(0.0, HORIZON, _INSTANTS)
        self._limit = scene["solver.accuracy"] / SAFETY
        self._reference, self.exact_cost = self._run("exact", math.inf)

    def coarsest(self, method: str) -> Choice | None:
        """The longest step that is as accurate as asked for; None where that does not cost less than `exact`."""
        _, cost = self._run(method, _TYPICAL)
        finest = max(_FINEST, cost * _TYPICAL / (_CLEARLY_LESS * self.exact_cost))
        if finest > _COARSEST or self._error(method, finest) > self._limit:
            return None
        count = math.floor(_STEPS_A_DECADE * math.log10(_COARSEST / finest))
        steps = (_COARSEST * 10.0 ** (-k / _STEPS_A_DECADE) for k in range(count + 1))
        step = next((step for step in steps if self._error(method, step) <= self._limit), finest)
        positions, cost = self._run(method, step)
        if cost > _CLEARLY_LESS * self.exact_cost:
            return None
        return Choice(method, step, self._off(positions), cost, self.exact_cost)

    def _error(self, method: str, step: float) -> float:
        return self._off(self._run(method, step, repeats=1)[0])

    def _off(self, positions: np.ndarray) -> float:
        error = float(np.abs(positions - self._reference).max())
        return error if math.isfinite(error) else math.inf

    def _run(self, method: str, step: float, repeats: int = 3) -> tuple[np.ndarray, float]:
        """Positions, and the least cost of a few runs [s per simulated s]."""
        parameters = {"solver.method": method, **({"solver.step": step} if step < math.inf else {})}
        runs = [self._measure(self._scene.with_parameters(parameters), self._times) for _ in range(repeats)]
        return runs[0][0], min(seconds for _, seconds in runs) / HORIZON
