"""Low-pass filters of the rates of channels, such as of an acceleration: exact even where the channel jumps.

Butterworth's filter of second order has the poles p = r exp(±3 i pi/4). With one complex number c a filter,

    c(t) = integral of exp(p (t - s)) dz(s),        filtered rate of z = sqrt(2) r Im c(t).

Where z jumps by d, c jumps by d, so that c contains no infinite rate. Between jumps z is the mode's polynomial, and
the integral of its rate with exp(p (t - s)) is found by Gauss's rule, over steps of at most four time constants 1 / r.
There the series of the exponential is exact to rounding, and the rule is exact to degree 47.

A filter advances only to the end of a mode and to instants at which it is read; samples between do not advance it. So
its bits depend on the modes and on the instants at which it is read, not on how the time is divided into calls.
"""

import math

import numpy as np

from vibro_ros.solver.elementary import cos, exp, sin
from vibro_ros.solver.polynomial import gauss_legendre, value, values
from vibro_ros.solver.state import LOWPASS, UNKNOWN, State
from vibro_ros.solver.system import System
from vibro_ros.solver.typed import part
from vibro_ros.solver.vector import LENGTH, indices_above, lowered, magnitudes, repeated, store, total, vector

_NODES, _WEIGHTS = gauss_legendre(LENGTH)
_ORDER = np.arange(LENGTH, dtype=float)
# Longest step, in time constants: the first term that the series of exp about its middle omits is 2^24 / 24! = 3e-17.
_LONGEST = 4.0


def new_filters(channels: list[int], rate: float, point: np.ndarray) -> np.ndarray:
    """Return filters of the rates of `channels`, which were at rest before, for `State.lowpass`.

    Parameters
    ----------
    channels : list of int
        Channels whose rates are filtered: velocities.
    rate : float
        Magnitude of the poles [1/s], 2 pi times the frequency [Hz] at which 3 dB are lost.
    point : ndarray, shape (channels,)
        Every channel now.
    """
    filters = np.zeros(len(channels), LOWPASS)
    filters["channel"], filters["rate"], filters["value"], filters["reached"] = channels, rate, point[channels], UNKNOWN
    return filters


def filtered_rates(filters: np.ndarray) -> np.ndarray:
    """Return the filtered rates, shape (filters,), at the instant that the filters have reached."""
    return math.sqrt(2.0) * filters["rate"] * filters["quadrature"]


@part
def end_mode(system: System, state: State, x: float) -> None:
    """Advance the filters to the local time `x`, where the mode ends."""
    if len(state.lowpass) > 0:
        filter_up_to(system, state, x)
        for k in range(len(state.lowpass)):
            state.lowpass[k].reached = UNKNOWN


@part
def filter_up_to(system: System, state: State, x: float) -> None:
    """Advance the filters to the local time `x` of the present mode."""
    segment, rate, response = state.segment, state.scratch.lowpass_rate, state.scratch.lowpass_response
    for k in range(len(state.lowpass)):
        filter_state = state.lowpass[k]
        channel, start = filter_state.channel, max(filter_state.reached, segment.mode_start)
        before = value(state.z[channel], start)
        filter_state.in_phase += before - filter_state.value  # where the mode began, the channel may have jumped
        filter_state.value = value(state.z[channel], x) if x > start else before
        filter_state.reached = x
        if x <= start:
            continue
        store(rate, lowered(vector(_ORDER) * vector(state.z[channel])))
        rests: bool = indices_above(magnitudes(vector(rate)), 0.0) == 0
        duration, decay = segment.half * (x - start), math.sqrt(0.5) * filter_state.rate
        count = 1 if rests else int(duration * filter_state.rate / _LONGEST) + 1
        half, width = 0.5 * duration / count, (x - start) / count
        turn = decay * half  # from the step's middle to its end c is multiplied by exp((-1 + i) turn)
        shrinking, cosine, sine = exp(-turn), cos(turn), sin(turn)
        to_end, to_end_turned = shrinking * cosine, shrinking * sine
        if not rests:  # exp((1 - i) turn y), where y is the step's local time, as a polynomial of y
            real, imaginary = 1.0, 0.0
            for n in range(LENGTH):
                response[0, n], response[1, n] = real, imaginary
                real, imaginary = ((real + imaginary) * turn / (n + 1), (imaginary - real) * turn / (n + 1))
        for step in range(count):
            in_middle = filter_state.in_phase * to_end - filter_state.quadrature * to_end_turned
            turned = filter_state.in_phase * to_end_turned + filter_state.quadrature * to_end
            if not rests:
                nodes = repeated(start + (step + 0.5) * width) + 0.5 * width * vector(_NODES)
                weighted = values(rate, nodes) * vector(_WEIGHTS)
                in_middle += 0.5 * width * total(weighted * values(response[0], vector(_NODES)))
                turned += 0.5 * width * total(weighted * values(response[1], vector(_NODES)))
            filter_state.in_phase = in_middle * to_end - turned * to_end_turned
            filter_state.quadrature = in_middle * to_end_turned + turned * to_end
