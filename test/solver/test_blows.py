"""Velocity jumps: rigid blows with known answers, and their chattering to rest."""

import math

import numpy as np
import pytest
from small_system import Guard, Integration, build, cosine_table

from vibro_ros.solver.events import MONITOR_KIND
from vibro_ros.solver.system import Channels

FLYING, RESTING = 0, 1


def form(channels, **parts):
    """A row by the names of `Channels`' methods: position, velocity, signal, one."""
    row = np.zeros(channels.count)
    for name, factor in parts.items():
        row[channels.one if name == "one" else getattr(channels, name)(0)] = factor
    return row


def bouncing_ball(restitution, gravity, rest_speed=1e-9):
    """q'' = -g above the ground q = 0, q' becomes -e q' there; it rests when it would rebound below `rest_speed`."""
    channels = Channels(1, 1, 0, 0)
    velocity = form(channels, velocity=1.0)
    ground = Guard(form(channels, position=1.0), (RESTING, FLYING),
                   jump={0: 0.0 * velocity, 1: -restitution * velocity},
                   first_jump={0: 0.0 * velocity, 1: 0.0 * velocity}, strike=True,
                   entry=form(channels, one=rest_speed, velocity=restitution))
    held = Guard(form(channels, one=gravity), (FLYING,))
    monitor = (form(channels, one=gravity), -velocity, {RESTING})
    return build(channels, [[form(channels, one=-gravity)], [form(channels)]], [[ground], [held]], monitor=monitor)


def test_a_bouncing_ball_rests_after_infinitely_many_impacts():
    """A12. From 1 m with e = 0.8 it rests after sqrt(2h/g)(1+e)/(1-e) = 4.0637 s, at finite cost.

    The bounces left out would last 2 v/g/(1-e) = 1e-9 s together, v = 1e-9 m/s being the slowest rebound.
    """
    height, restitution, gravity = 1.0, 0.8, 9.81
    run = Integration(bouncing_ball(restitution, gravity), [height], [0.0])
    fall = math.sqrt(2 * height / gravity)
    end = fall * (1 + restitution) / (1 - restitution)
    points, modes, _ = run.sample([end - 1e-6, end, end + 1.0, end + 100.0], room=200)
    np.testing.assert_array_equal(modes, [FLYING, RESTING, RESTING, RESTING])
    assert end == pytest.approx(4.0637, abs=5e-5)
    assert np.abs(points[1:, 0]).max() < 1e-17 and not points[1:, 1].any()
    blows = [(time, speed) for time, kind, speed, *_ in run.events if kind == MONITOR_KIND]
    count = np.arange(len(blows))
    assert 90 < len(blows) < 110
    np.testing.assert_allclose([speed for _, speed in blows], gravity * fall * restitution**count,
                               rtol=1e-12, atol=4e-14)  # roundings of g h in segments of h <= 1 s
    np.testing.assert_allclose([time for time, _ in blows],
                               fall * (1 + 2 * (restitution - restitution**(count + 1)) / (1 - restitution)),
                               rtol=0, atol=5e-13)  # those of the speeds, over g (1 - e)


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
