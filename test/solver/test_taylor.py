"""A decaying term against closed forms: sliding blocks whose friction falls with the speed.

    v' = a - b exp(-v / s)  for v >= 0,  so that w = exp(v / s) obeys w' = (a w - b) / s:

    w = b / a + (w0 - b / a) exp(a t / s).
"""

import math

import mpmath
import numpy as np
import pytest
from small_system import Guard, Integration, build

from vibro_ros.solver import event_loop
from vibro_ros.solver.channels import Channels

SLIDING, STOPPED = 0, 1


def block(push, friction, speed, sign=1.0):
    """x'' = sign (push - friction exp(-|x'| / speed)) until x' = 0, where it stays."""
    channels = Channels(1, 0, 0, 0, 1)
    slide, factor, velocity = np.zeros((3, channels.count))
    slide[[channels.decay, channels.one]] = -sign * friction, sign * push
    factor[channels.one], velocity[channels.velocity(0)] = 1.0, sign
    stop = {channels.velocity(0): np.zeros(channels.count)}
    return build(channels, [[slide], [np.zeros(channels.count)]], [[Guard(velocity, (STOPPED,), jump=stop)], []],
                 decay=([factor, np.zeros(channels.count)], [-sign / speed, 0.0]))


def motion(push, friction, speed, start, times):
    """v at `times` for parameters in double precision, correct to double precision; 60 digits survive the cancellation
    in w.
    """
    with mpmath.workdps(60):
        push, friction, speed, start = map(mpmath.mpf, (push, friction, speed, start))
        bound = friction / push
        return np.array([float(speed * mpmath.log(
            bound + (mpmath.exp(start / speed) - bound) * mpmath.exp(push * mpmath.mpf(time) / speed)))
            for time in times])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("speed", [1e3, 1.0, 0.1, 0.01])
def test_a_block_is_stopped_by_friction_that_grows(speed, sign):
    """A18. v0 = 0.3, mu g = 2, (mu_s - mu) g = 5; to roundings of the 7 m/s that a segment of 1 s would take off."""
    push, friction, start = -2.0, 5.0, 0.3
    stop = speed / -push * math.log1p(math.expm1(start / speed) / (1.0 - friction / push))
    run = Integration(block(push, friction, speed, sign), [0.0], [sign * start])
    times = np.linspace(0.0, 0.99 * stop, 50)
    points, _, _ = run.sample(times)
    expected = motion(push, friction, speed, start, times)
    np.testing.assert_allclose(sign * points[:, 1], expected, rtol=0, atol=2e-15)
    rest, modes, _ = run.sample([stop + 1.0, stop + 10.0])
    assert list(modes) == [STOPPED, STOPPED] and np.all(rest[:, 1] == 0.0)
    ((time, *_),) = run.events
    assert time == pytest.approx(stop, abs=4e-16)


@pytest.mark.parametrize("speed", [1.0, 0.01, 1e-6])
def test_a_block_breaks_away(speed):
    """A18. From rest, pushed by a hundredth more than friction holds; compared until the decay is over, at 41 s, and
    long afterwards, when the 5 m/s that a segment of a second adds is rounded.
    """
    push, friction = 5.05, 5.0
    last = speed / push * math.log(1e20)
    times = np.linspace(0.0, last, 60)
    run = Integration(block(push, friction, speed), [0.0], [0.0])
    points, modes, _ = run.sample(times)
    expected = motion(push, friction, speed, 0.0, times)
    np.testing.assert_allclose(points[:, 1], expected, rtol=2e-14, atol=2e-16 * speed)
    assert np.all(modes == SLIDING)
    later, _, _ = run.sample([last + 1.0])
    assert later[0, 1] == pytest.approx(expected[-1] + push, rel=4e-15)


def test_what_has_decayed_costs_nothing():
    """A block that slides on ice for a thousand seconds needs only segments of the longest kind, once its decaying term
    has vanished.
    """
    run = Integration(block(1.0, 0.5, 1e-6), [0.0], [0.0])
    run.sample([1.0])
    begun = run.segments
    run.sample([1001.0])
    assert begun < 100 and run.segments - begun <= 1010


@pytest.mark.parametrize("speed", [1e-3, 1e-6])
def test_the_term_is_back_when_the_block_comes_down_to_it(speed):
    """From 0.3, far above v_s, v falls by 2 a second until the decaying term adds to that; the stop comes
    correspondingly sooner.
    """
    push, friction, start = -2.0, 5.0, 0.3
    stop = start / 2.0 - speed / 2.0 * math.log(1.0 - friction / push)  # exp(-0.3/s) is no number beside 1
    run = Integration(block(push, friction, speed), [0.0], [start])
    _, modes, _ = run.sample([1.0])
    ((time, *_),) = run.events
    assert modes[0] == STOPPED and run.status == event_loop.REACHED
    assert time == pytest.approx(stop, abs=4e-16)


@pytest.mark.parametrize("speed", [0.1, 0.01])
@pytest.mark.parametrize("begin", [0.3, 0.51, 0.97])
def test_the_term_may_set_in_at_any_time(begin, speed):
    """A18. A block glides until a clock, the dynamic coordinate, has run down; then friction sets in."""
    push, friction, start = -2.0, 5.0, 0.3
    channels = Channels(2, 1, 0, 0, 1)
    gliding, sliding, stopped = np.zeros((3, 2, channels.count))
    sliding[1, [channels.decay, channels.one]] = -friction, push
    factor, velocity, clock = np.zeros((3, channels.count))
    factor[channels.one], velocity[channels.velocity(1)], clock[channels.position(0)] = 1.0, 1.0, 1.0
    guards = [[Guard(clock, (1,))], [Guard(velocity, (2,), jump={channels.velocity(1): np.zeros(channels.count)})], []]
    none = np.zeros(channels.count)
    system = build(channels, [gliding, sliding, stopped], guards,
                   decay=([none, factor, none], [0.0, -1.0 / speed, 0.0]))
    stop = speed / -push * math.log1p(math.expm1(start / speed) / (1.0 - friction / push))
    run = Integration(system, [begin, 0.0], [-1.0, start])
    times = begin + np.linspace(0.0, 0.99 * stop, 50)
    points, _, _ = run.sample(times)
    expected = motion(push, friction, speed, start, times - begin)
    np.testing.assert_allclose(points[:, channels.velocity(1)], expected, rtol=0, atol=4e-15)
    np.testing.assert_allclose(points[:, channels.position(0)], begin - times, rtol=0, atol=4e-16)
    run.sample([begin + stop + 0.1])
    assert run.events[-1][0] == pytest.approx(begin + stop, abs=1e-15)
