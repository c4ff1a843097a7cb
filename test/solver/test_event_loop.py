"""The event loop on systems of a few rows: oscillators with friction or blows, with known answers, and the ends of the
loop.
"""

import math

import numpy as np
import pytest
from small_system import Guard, Integration, build, cosine_table

from vibro_ros.solver import event_loop
from vibro_ros.solver.channels import Channels

FORWARD, BACKWARD, STICK = 0, 1, 2
RATE = 100.0  # Ω of the spring [rad/s]
DRIVEN = Channels(1, 1, 1, 0)


def form(position=0.0, velocity=0.0, signal=0.0, constant=0.0):
    """Return a row of coefficients of the channels of a driven oscillator."""
    row = np.zeros(DRIVEN.count)
    row[[DRIVEN.position(0), DRIVEN.velocity(0), DRIVEN.signal(0), DRIVEN.one]] = position, velocity, signal, constant
    return row


def friction_oscillator(friction, drive=0.0):
    """Return q'' = -Ω² q + drive cos(phase) - friction sign(q'), which sticks while the force is below friction."""
    rows = [[form(-RATE**2, 0, drive, -friction)], [form(-RATE**2, 0, drive, friction)], [form()]]
    guards = [[Guard(form(velocity=1.0), (STICK, BACKWARD), jump={1: form()})],
              [Guard(form(velocity=-1.0), (STICK, FORWARD), jump={1: form()})],
              [Guard(form(RATE**2, 0, -drive, friction), (FORWARD,)),
               Guard(form(-RATE**2, 0, drive, friction), (BACKWARD,))]]
    return build(DRIVEN, rows, guards, cosine_table())


def test_coulombs_free_oscillator():
    """A16. Each half period reduces the amplitude by 2 f/Ω²; the oscillator rests within f/Ω² for good. From 1 with
    f/Ω² = 0.03 the turning points are 1, -0.94, 0.88 ... and the last, 0.02, is inside the dead zone.
    """
    band = 0.03
    run = Integration(friction_oscillator(band * RATE**2), [1.0], [0.0], mode=STICK)
    halves = np.arange(18)
    points, modes, _ = run.sample(halves * math.pi / RATE)
    amplitudes = np.maximum(1.0 - 2 * band * halves, 1.0 - 2 * band * 17) * (-1.0) ** halves
    amplitudes[17] = -(1.0 - 2 * band * 17)
    np.testing.assert_allclose(points[:, 0], amplitudes, rtol=0, atol=1e-12)
    rest, rest_modes, _ = run.sample([0.6, 1.0, 100.0])
    assert np.all(rest_modes == STICK) and np.all(rest[:, 1] == 0.0)
    np.testing.assert_allclose(rest[:, 0], -(1.0 - 2 * band * 17), rtol=0, atol=1e-12)
    assert abs(rest[0, 0]) <= band
    kinds = [event[1] for event in run.events]
    assert kinds == [BACKWARD, *[FORWARD, BACKWARD] * 8, STICK]
    np.testing.assert_allclose([event[0] for event in run.events], np.arange(18) * math.pi / RATE, rtol=0, atol=1e-13)


@pytest.mark.parametrize("start", [0.03, 0.03 * (1 - 1e-9), -0.03])
def test_a_spring_at_most_as_strong_as_friction_moves_nothing(start):
    run = Integration(friction_oscillator(0.03 * RATE**2), [start], [0.0], mode=STICK)
    points, modes, _ = run.sample([0.0, 0.1, 10.0])
    assert np.all(points[:, 0] == start) and np.all(modes == STICK)
    assert run.events == []


def den_hartog(beta, share):
    """Amplitude over P/k of the non-stop motion; `beta` = ω/Ω, `share` = friction over P."""
    response = 1 / (1 - beta**2)
    loss = math.sin(math.pi / beta) / (beta * (1 + math.cos(math.pi / beta)))
    return math.sqrt(response**2 - (share * loss) ** 2)


def test_the_turning_points_of_den_hartogs_oscillator():
    """A17. Sampled exactly where the velocity changes its sign, after the transient has died: to rounding."""
    system = friction_oscillator(0.2 * RATE**2, drive=RATE**2)
    scout = Integration(system, [2.5], [0.0], mode=STICK, speed=0.8 * RATE)
    period = 2 * math.pi / (0.8 * RATE)
    scout.sample([3000 * period])
    turns = np.array([event[0] for event in scout.events[-10:]])
    np.testing.assert_allclose(np.diff(turns), period / 2, rtol=0, atol=1e-10)
    points, _, _ = Integration(system, [2.5], [0.0], mode=STICK, speed=0.8 * RATE).sample(turns)
    np.testing.assert_allclose(abs(points[:, 0]), den_hartog(0.8, 0.2), rtol=1e-13)
    assert np.all(abs(points[:, 1]) < 1e-9)


def test_the_period_one_impact_oscillator():
    """A13. q'' + Ω² q = a Ω² cos(phase), rigid stop at q = d, restitution e: one blow a period at v.

    The orbit attracts, so that after many periods only rounding is left; v = 3.572472 m/s.
    """
    rate, speed, reach, stop, restitution = 111.80340, 100.0, 0.02, 0.03, 0.7
    velocity = form(velocity=1.0)
    wall = Guard(form(constant=stop, position=-1.0), (0,), strike=True,
                 jump={0: form(constant=stop), 1: -restitution * velocity})
    row = form(position=-rate**2, signal=reach * rate**2)
    system = build(DRIVEN, [[row]], [[wall]], cosine_table(), monitor=(0 * velocity, velocity, {}))
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


def bouncing_mass():
    """Return q'' = -1 above the floor q = 0, and a spring of rate 1e4 below it, whose force is monitored; modes: open
    0, closed 1.
    """
    channels = Channels(1, 1, 0, 0)
    fall, spring, position = np.zeros((3, channels.count))
    fall[channels.one], spring[channels.one] = -1.0, -1.0
    spring[channels.position(0)], position[channels.position(0)] = -1e8, 1.0
    guards = [[Guard(position, (1,))], [Guard(-position, (0,))]]
    approach = np.zeros(channels.count)
    approach[channels.velocity(0)] = -1.0
    return build(channels, [[fall], [spring]], guards, monitor=(-1e8 * position, approach, {1}))


def test_full_rooms_for_events_lose_none():
    """However many events fit into the array at once, events and samples have the same bits."""
    results = []
    for room in (4, 7, 1000):
        run = Integration(bouncing_mass(), [0.5], [0.0])
        points, _, _ = run.sample(np.linspace(0, 20, 11), room)
        results.append((points.tobytes(), run.events))
    assert results[0] == results[1] == results[2]
    assert len(results[0][1]) > 25


def test_two_crossings_within_one_segment_are_seen():
    """A slow oscillation passes a wall by 1e-9, and leaves it again within 1e-6 of a period."""
    channels = Channels(1, 1, 0, 0)
    row, wall = np.zeros((2, channels.count))
    row[channels.position(0)] = -1.0
    wall[channels.position(0)] = -1.0
    for depth, contacts in ((1e-9, 3), (1e-13, 3), (-1e-13, 0)):
        wall[channels.one] = 1.0 - depth
        run = Integration(build(channels, [[row], [row]], [[Guard(wall, (1,))], [Guard(-wall, (0,))]]), [0.0], [1.0])
        run.sample([6 * math.pi])
        entries = [event[0] for event in run.events if event[1] == 1]
        assert len(entries) == contacts
        expected = math.pi / 2 - math.acos(1.0 - max(depth, 0.0)) + 2 * math.pi * np.arange(contacts)
        amplitude = 1.1e-15  # what the rounding of two turns came to in 60 starts, at most
        np.testing.assert_allclose(entries, expected, rtol=0, atol=amplitude / math.sqrt(2 * abs(depth)))


def toggling(value):
    """Return two modes with the guard q - 1 + `value`, while q stays at 1: if the guard fires, the modes alternate."""
    channels = Channels(1, 1, 0, 0)
    row, guard = np.zeros((2, channels.count))
    guard[[channels.position(0), channels.one]] = 1.0, value - 1.0
    return build(channels, [[row], [row]], [[Guard(guard, (1,))], [Guard(guard, (0,))]])


def test_events_without_end_at_one_instant_are_given_up():
    run = Integration(toggling(-1e-12), [1.0], [0.0])
    run.sample([1.0])
    assert run.status == event_loop.STUCK


def test_guards_that_are_negative_within_rounding_only_do_not_fire():
    run = Integration(toggling(-4.4e-16), [1.0], [0.0])
    points, _, _ = run.sample([1.0])
    assert run.status == event_loop.REACHED and points[0, 0] == 1.0


def test_modes_that_contradict_each_other_within_rounding():
    """A spring that acts beyond q = 1 is loaded to a depth of some roundings: both modes may hold, and one of them is
    kept.
    """
    channels = Channels(1, 1, 0, 0)
    for depth in np.arange(-12, 13) * 2.2e-16:
        free, spring, wall = np.zeros((3, channels.count))
        free[channels.one] = 1e-3
        spring[[channels.position(0), channels.one]] = -1e9, 1e9 + 1e-3
        wall[[channels.position(0), channels.one]] = -1.0, 1.0
        system = build(channels, [[free], [spring]], [[Guard(wall, (1,))], [Guard(-wall, (0,))]])
        run = Integration(system, [1.0 + depth], [0.0])
        points, _, _ = run.sample(np.linspace(0, 0.01, 20))
        assert run.status == event_loop.REACHED
        assert np.all(abs(points[:, 0] - 1.0) < 1e-11)


def test_what_grows_beyond_all_numbers_is_reported():
    channels = Channels(1, 1, 0, 0)
    row = np.zeros(channels.count)
    row[channels.position(0)] = 1e4
    run = Integration(build(channels, [[row]]), [1.0], [0.0])
    run.sample([100.0])
    assert run.status == event_loop.DIVERGED
