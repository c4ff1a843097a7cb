"""Velocity jumps: rigid blows with known answers, and their chattering to rest."""

import math

import numpy as np
from small_system import Guard, Integration, build, cosine_table

from vibro_ros.solver.channels import Channels


def form(channels, **parts):
    """Return a row of coefficients by the names of `Channels`' methods: position, velocity, signal, one."""
    row = np.zeros(channels.count)
    for name, factor in parts.items():
        row[channels.one if name == "one" else getattr(channels, name)(0)] = factor
    return row


def test_the_period_one_impact_oscillator():
    """A13. q'' + Ω² q = a Ω² cos(phase), rigid stop at q = d, restitution e: one blow a period at v.

    The orbit attracts, so that after many periods only rounding is left; v = 3.572472 m/s.
    """
    rate, speed, reach, stop, restitution = 111.80340, 100.0, 0.02, 0.03, 0.7
    channels = Channels(1, 1, 1, 0)
    velocity = form(channels, velocity=1.0)
    wall = Guard(form(channels, one=stop, position=-1.0), (0,), strike=True,
                 jump={0: form(channels, one=stop), 1: -restitution * velocity})
    row = form(channels, position=-rate**2, signal=reach * rate**2)
    system = build(channels, [[row]], [[wall]], cosine_table(), monitor=(0 * velocity, velocity, {}))
    run = Integration(system, [0.0], [0.0], speed=speed)
    period = 2 * math.pi / speed
    run.sample(period * np.arange(1, 2001))
    late = [(time, approach) for time, kind, approach, *_ in run.events if time > 1900 * period]
    response = reach * rate**2 / (rate**2 - speed**2)
    v = np.array([approach for _, approach in late])
    equation = (stop + v * (1 + restitution) / (2 * rate * math.tan(rate * period / 2)))**2 + (
        v * (1 - restitution) / (2 * speed))**2
    np.testing.assert_allclose(np.diff([time for time, _ in late]), period, rtol=0, atol=1e-12)
    np.testing.assert_allclose(equation, response**2, rtol=1e-11)
    np.testing.assert_allclose(v, 3.572472, rtol=0, atol=5e-7)
