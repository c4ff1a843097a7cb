"""Methods of fixed step: how one step is taken in one mode.

Each fills `Track.end`, the channels at the step's end, from `Track.start`, those at its start.
"""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.instant import accelerate, fill_forcing_at
from vibro_ros.solver.laws import Laws, no_laws
from vibro_ros.solver.moreau import step_velocities
from vibro_ros.solver.state import HALF, MODE
from vibro_ros.solver.system import Channels, System

#: Schemes.
RK4 = 0
SEMI_IMPLICIT_EULER = 1
MOREAU = 2


class Track(NamedTuple):
    """What a method of fixed step keeps beside `State`, whose clock then counts the steps.

    Attributes
    ----------
    scheme : int
        How to step.
    step : float
        Length of a step [s].
    start, end : ndarray, shape (channels,)
        All channels at both ends of the present step, in the mode that it is taken in.
    rates : ndarray, shape (2, coordinates)
        The coordinates' accelerations there.
    stage : ndarray, shape (channels,)
        Room for the channels between.
    slopes : ndarray, shape (3, coordinates)
        Weighted sums of velocities and of accelerations, and room for those of a stage.
    laws : Laws
        The laws of Moreau's scheme.
    gap, drift, approach, wanted : ndarray, shape (m,)
        Gap of each contact at the start, the part of its rate that the ramps make, its rate at the start, and the
        least one at the end should it close.
    impulse : ndarray, shape (m + 1,)
        Impulses of the contacts and of friction during the step.
    found : ndarray of int, shape (2,)
        The friction law's outcome, and the mode at the end.
    """

    scheme: int
    step: float
    start: np.ndarray
    end: np.ndarray
    rates: np.ndarray
    stage: np.ndarray
    slopes: np.ndarray
    laws: Laws
    gap: np.ndarray
    drift: np.ndarray
    approach: np.ndarray
    wanted: np.ndarray
    impulse: np.ndarray
    found: np.ndarray


def new_track(system: System, scheme: int, step: float, laws: Laws | None = None) -> Track:
    """Room for steps of `step` [s] by `scheme`; `laws` for `MOREAU`."""
    channels = Channels(*(int(size) for size in system.sizes))
    start, end, stage = np.zeros((3, channels.count))
    laws = laws or no_laws(channels.coordinates, channels.count)
    gap, drift, approach, wanted = np.zeros((4, len(laws.gap)))
    return Track(scheme, step, start, end, np.zeros((2, channels.coordinates)), stage,
                 np.zeros((3, channels.coordinates)), laws, gap, drift, approach, wanted, np.zeros(len(gap) + 1),
                 np.zeros(2, dtype=np.int64))


@kernel
def take_step(system, state, track):
    """Fill `Track.end`, by the track's scheme."""
    if track.scheme == RK4:
        _runge_kutta(system, state, track)
    elif track.scheme == MOREAU:
        step_velocities(system, state, track)
    else:
        _semi_implicit_euler(system, state, track)


@kernel
def _semi_implicit_euler(system, state, track):
    """v+ = v + h a(q, v, t) and then q+ = q + h v+, as game engines do; first order."""
    coordinates, h = system.sizes[0], 2.0 * state.clock[HALF]
    start, end = track.start, track.end
    for i in range(coordinates):
        end[coordinates + i] = start[coordinates + i] + h * track.rates[0, i]
        end[i] = start[i] + h * end[coordinates + i]
    fill_forcing_at(system, state, h, end)


@kernel
def _runge_kutta(system, state, track):
    """The classical method of fourth order, for q' = v and v' = a at once."""
    coordinates, mode = system.sizes[0], state.index[MODE]
    h = 2.0 * state.clock[HALF]
    start, end, stage = track.start, track.end, track.stage
    speeds, accelerations, rate = track.slopes[0], track.slopes[1], track.slopes[2]
    for i in range(coordinates):
        speeds[i] = start[coordinates + i]
        accelerations[i] = rate[i] = track.rates[0, i]
        stage[coordinates + i] = start[coordinates + i]
    for k in range(1, 4):
        part = h if k == 3 else 0.5 * h
        weight = 1.0 if k == 3 else 2.0
        for i in range(coordinates):
            stage[i] = start[i] + part * stage[coordinates + i]
            stage[coordinates + i] = start[coordinates + i] + part * rate[i]
        if k != 2:  # the second half step is at the instant of the first
            fill_forcing_at(system, state, part, stage)
        accelerate(system, mode, stage, rate)
        for i in range(coordinates):
            speeds[i] += weight * stage[coordinates + i]
            accelerations[i] += weight * rate[i]
    for channel in range(len(end)):
        end[channel] = stage[channel]  # the forcing at the end
    for i in range(coordinates):
        end[i] = start[i] + h / 6.0 * speeds[i]
        end[coordinates + i] = start[coordinates + i] + h / 6.0 * accelerations[i]
