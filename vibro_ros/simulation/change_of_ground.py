"""A motion that goes on over another ground: its state, in the tables of a scene with another friction coefficient."""

import numpy as np

from vibro_ros.model.tables import Model
from vibro_ros.solver.state import State, new_state


def carried_over(model: Model, state: State, point: np.ndarray, new_model: Model) -> tuple[State, np.ndarray]:
    """State and channels of `new_model` that go on from those of `model`, where the motion stands at a segment's end.

    The two models are of scenes that differ in `ground.friction` alone, so that coordinates, sliders and plates are the
    same. The states of the friction are not: there may be none where the coefficient is 0. A state that does not hold
    on the new ground, such as sticking, is left at the first event.

    Parameters
    ----------
    model, new_model : Model
        The scene so far, and the one that follows.
    state : State
        Of the first; not changed.
    point : ndarray, shape (channels of `model`,)
        Every channel now.
    new_model : Model
        The scene that follows.

    Returns
    -------
    State, ndarray, shape (channels of `new_model`,)
        To begin a segment with.
    """
    mode = _mode(model, int(state.now["automaton"]["mode"][0]), point, new_model)
    new = new_state(new_model.system, 0.0, state.ramp["value"], mode)
    for name in ("now", "ramp", "monitor"):
        getattr(new, name)[...] = getattr(state, name)
    new.now["automaton"]["mode"] = mode
    channels, new_point = new_model.forms.channels, np.zeros(new_model.forms.channels.count)
    kept = channels.ramp_rate(channels.ramps)  # what stands behind begins with the segment
    new_point[:kept] = point[:kept]
    return new, new_point


def _mode(model: Model, mode: int, point: np.ndarray, new_model: Model) -> int:
    """Number of the new mode with the same contacts, in which friction begins as the body moves."""
    *contacts, friction = model.modes[mode].states
    numbers = {one.states: number for number, one in enumerate(new_model.modes)}
    moving = ("stick", "slip_forward", "slip_backward")[int(np.sign(_body_velocity(model, point)))]
    return next(numbers[(*contacts, name)] for name in (friction, moving, "grounded") if (*contacts, name) in numbers)


def _body_velocity(model: Model, point: np.ndarray) -> float:
    """Velocity of the body along the ground [m/s]."""
    forms = model.forms
    return float(point[forms.channels.velocity(forms.body)]) if forms.body_moves else 0.0
