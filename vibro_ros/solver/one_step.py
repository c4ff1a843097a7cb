"""Methods of fixed step: how one step is taken in one mode.

Each fills `Step.end`, the channels at the step's end, from `Step.start`, the channels at its start.
"""

from typing import NamedTuple

import numpy as np

from vibro_ros.solver.channels import channels_of
from vibro_ros.solver.compilation import kernel
from vibro_ros.solver.laws import Laws, no_laws
from vibro_ros.solver.moreau import step_velocities
from vibro_ros.solver.right_hand_side import accelerate, fill_forcing_at
from vibro_ros.solver.system import System

#: Schemes.
RK4 = 0
SEMI_IMPLICIT_EULER = 1
MOREAU = 2


#: What `Step.found` holds.
FOUND = np.dtype([
    ("outcome", np.int64),  # of the friction law
    ("mode", np.int64),  # at the step's end
], align=True)


class Step(NamedTuple):
    """What a method of fixed step keeps beside `State`, whose segment then is the step.

    Attributes
    ----------
    scheme : int
        How to step.
    length : float
        Length of a step [s].
    start, end : ndarray, shape (channels,)
        All channels at both ends of the present step, in the mode in which the step is taken.
    start_acceleration, end_acceleration : ndarray, shape (coordinates,)
        The coordinates' accelerations there.
    stage : ndarray, shape (channels,)
        Room for the channels between.
    stage_acceleration : ndarray, shape (coordinates,)
        Room for the accelerations between.
    velocity_sum, acceleration_sum : ndarray, shape (coordinates,)
        Weighted sums over the stages.
    laws : Laws
        The laws of Moreau's scheme.
    gap, drift, approach, least_rate : ndarray, shape (m,)
        Gap of each contact at the start, the part of the gap's rate that the ramps make, its rate at the start, and the
        least rate at the end should the gap close.
    impulse : ndarray, shape (m + 1,)
        Impulses of the contacts and of friction during the step.
    found : ndarray of FOUND, shape (1,)
        What Moreau's scheme has found.
    """

    scheme: int
    length: float
    start: np.ndarray
    end: np.ndarray
    start_acceleration: np.ndarray
    end_acceleration: np.ndarray
    stage: np.ndarray
    stage_acceleration: np.ndarray
    velocity_sum: np.ndarray
    acceleration_sum: np.ndarray
    laws: Laws
    gap: np.ndarray
    drift: np.ndarray
    approach: np.ndarray
    least_rate: np.ndarray
    impulse: np.ndarray
    found: np.ndarray


def new_step(system: System, scheme: int, length: float, laws: Laws | None = None) -> Step:
    """Room for steps of `length` [s] by `scheme`; `laws` for `MOREAU`."""
    channels = channels_of(system.size)
    count, coordinates = channels.count, channels.coordinates
    laws = laws or no_laws(coordinates, count)
    start, end, stage = np.zeros((3, count))
    start_acceleration, end_acceleration, stage_acceleration, velocity_sum, acceleration_sum = np.zeros((
        5, coordinates))
    gap, drift, approach, least_rate = np.zeros((4, len(laws.gap)))
    return Step(scheme, length, start, end, start_acceleration, end_acceleration, stage, stage_acceleration,
                velocity_sum, acceleration_sum, laws, gap, drift, approach, least_rate, np.zeros(len(gap) + 1),
                np.zeros(1, FOUND))


@kernel
def take_step(system, state, step):
    """Fill `Step.end`, by the step's scheme."""
    if step.scheme == RK4:
        _runge_kutta(system, state, step)
    elif step.scheme == MOREAU:
        step_velocities(system, state, step)
    else:
        _semi_implicit_euler(system, state, step)


@kernel
def _semi_implicit_euler(system, state, step):
    """v+ = v + h a(q, v, t) and then q+ = q + h v+, as game engines do; first order."""
    coordinates, h = system.size[0].coordinates, 2.0 * state.now[0].segment.half
    start, end = step.start, step.end
    for i in range(coordinates):
        end[coordinates + i] = start[coordinates + i] + h * step.start_acceleration[i]
        end[i] = start[i] + h * end[coordinates + i]
    fill_forcing_at(system, state, h, end)


@kernel
def _runge_kutta(system, state, step):
    """The classical method of fourth order, for q' = v and v' = a at once."""
    coordinates, mode = system.size[0].coordinates, state.now[0].automaton.mode
    h = 2.0 * state.now[0].segment.half
    start, end, stage, rate = step.start, step.end, step.stage, step.stage_acceleration
    speeds, accelerations = step.velocity_sum, step.acceleration_sum
    for i in range(coordinates):
        speeds[i] = start[coordinates + i]
        accelerations[i] = rate[i] = step.start_acceleration[i]
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
