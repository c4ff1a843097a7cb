"""scipy's integrators on a scene's tables, blind to events, as a first script integrates.

The mode is read off the state at each evaluation of the right-hand side, so that contact and friction are
discontinuities which the step control must find. There is no way to let a speed jump.
"""

from collections.abc import Callable

import numpy as np

from vibro_ros.accuracy.tables_by_scipy import SOLVERS, Tables, UnableError, Work, counted, step
from vibro_ros.solver.system import NOTHING


def blind(name: str, tables: Tables, times: np.ndarray, tolerance: float, work: Work):
    """Integrate by the solver `name` without event location: states at `times`; no events."""
    choose = _mode_by_state(tables)
    slope = counted(lambda t, y: tables.slope(t, y, choose(t, y)), work)
    solver = SOLVERS[name](slope, 0.0, tables.start, times[-1], rtol=max(tolerance, 1e-13), atol=tolerance)
    states, done = np.zeros((len(times), len(tables.start))), 0
    while done < len(times) and times[done] <= 0.0:
        states[done] = tables.start
        done += 1
    while solver.status == "running":
        step(solver, work)
        dense = solver.dense_output()
        upto = int(np.searchsorted(times, solver.t, side="right"))
        if upto > done:
            states[done:upto] = dense(times[done:upto]).T
            done = upto
    return states, []


def _mode_by_state(tables: Tables) -> Callable[[float, np.ndarray], int]:
    """The mode that positions and speeds alone tell, eqs. (4) and (5)."""
    model, forms = tables.model, tables.model.forms
    names = {mode.ground for mode in model.modes}
    if forms.body_hops or any("resting" in mode.states for mode in model.modes):
        raise UnableError("without events no speed can jump: no rigid plates and no landing")
    number = {mode.states: m for m, mode in enumerate(model.modes)}
    depths = [forms.penetration(side)[0] for side in forms.plates]
    pushes = [forms.plate_force(side) for side in forms.plates]
    may_let_go = ["released" in {mode.states[k] for mode in model.modes} for k in range(len(depths))]

    def contact(k: int, z: np.ndarray) -> str:
        if depths[k] @ z <= 0.0:
            return "open"
        return "released" if may_let_go[k] and pushes[k] @ z < 0.0 else "closed"

    def friction(time: float, y: np.ndarray, contacts: tuple[str, ...]) -> str:
        speed = y[tables.channels.velocity(forms.body)]
        if speed == 0.0:
            m = number[(*contacts, "stick")]
            guard = tables.broken_guard(m, tables.point(time, y, m))
            if guard == NOTHING:
                return "stick"
            return model.modes[tables.change(m, guard, tables.point(time, y, m))[0]].ground
        slipping = "slip_forward" if speed > 0.0 else "slip_backward"
        if "unloaded" not in names:
            return slipping
        m = number[(*contacts, "unloaded")]
        return slipping if tables.broken_guard(m, tables.point(time, y, m)) != NOTHING else "unloaded"

    def choose(time: float, y: np.ndarray) -> int:
        z = tables.point(time, y, tables.first_mode)
        contacts = tuple(contact(k, z) for k in range(len(depths)))
        return number[(*contacts, "grounded" if names == {"grounded"} else friction(time, y, contacts))]

    return choose
