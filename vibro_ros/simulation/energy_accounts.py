"""The energy accounts of a device at an instant, in the words of its users."""

import numpy as np

from vibro_ros.model.energy import ACCOUNTS, LOSSES
from vibro_ros.model.tables import Model
from vibro_ros.solver import event_loop
from vibro_ros.solver.compilation import Laid
from vibro_ros.solver.energy import SPLIT, stored_on_accounts
from vibro_ros.solver.state import State


def open_accounts(model: Model, state: State, point: np.ndarray) -> None:
    """Note the energy that is stored at the start.

    Parameters
    ----------
    model : Model
        A compiled scene with `solver.accounts`.
    state : State
        Its state before the first segment.
    point : ndarray, shape (channels,)
        All channels at the start.
    """
    mode = int(state.now["automaton"]["mode"][0])
    state.now["accounts"]["stored"] = stored_on_accounts(model.system, mode, point)


def energy_accounts(model: Model, state: State, time: float) -> dict[str, float]:
    """Where energy came from and went since t = 0 [J].

    Parameters
    ----------
    model : Model
        A compiled scene with `solver.accounts`.
    state : State
        Its state by the method exact; nothing of it changes.
    time : float
        Instant [s] within the present segment.

    Returns
    -------
    dict of str to float
        What `Simulator.statistics` describes.
    """
    # A command at this instant would book all work up to here: it is given to a copy.
    ended = state._replace(**{name: getattr(state, name).copy()
                              for name in ("scale", "now", "ramp", "mode_point", "root", "monitor")})
    point = np.zeros(model.forms.channels.count)
    event_loop.interrupt(model.laid.layout, Laid(ended).layout, time, point)
    accounts, mode = ended.now["accounts"][0], int(ended.now["automaton"]["mode"][0])
    work, magnitude = dict(zip(ACCOUNTS, map(float, accounts["work"]), strict=False)), float(accounts["magnitude"])
    stored = stored_on_accounts(model.system, mode, point) - float(accounts["stored"])
    net = work.pop(ACCOUNTS[SPLIT])
    return {"motor_delivered": 0.5 * (magnitude + net), "motor_taken_back": 0.5 * (magnitude - net),
            **{name: 0.0 - amount if name in LOSSES else amount for name, amount in work.items()},
            "stored": stored, "residual": net + sum(work.values()) - stored}
