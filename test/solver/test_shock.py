"""A landing with friction that falls with the speed, compared with the integral of the impulse and with its limit,
Coulomb's law.
"""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vibro_ros.solver import shock
from vibro_ros.solver.system import SHOCK

KERNELS = shock
KINETIC, STATIC = 0.1, 0.3


def law(decay_speed, restitution, kinetic=KINETIC, static=STATIC):
    record = np.zeros(1, SHOCK)
    record["kinetic"], record["static"], record["has_friction"] = kinetic, static, True
    record["decay_speed"], record["restitution"] = decay_speed, restitution
    return record[0]


def integrated(inertia, speed, fall, decay_speed, restitution):
    """Return x' and y' by DOP853 over P_y, restarted where the body stops and where y' vanishes."""
    inverse, velocity, given, end, direction = np.linalg.inv(inertia), [speed, fall], 0.0, math.inf, np.sign(speed)

    def change(_, velocity, direction):
        if direction == 0.0:
            return inverse @ (hold, 1.0)
        coefficient = KINETIC + (STATIC - KINETIC) * math.exp(-abs(velocity[0]) / decay_speed)
        return inverse @ (-direction * coefficient, 1.0)

    def stops(_, velocity, direction):
        return velocity[0] if direction else 1.0

    def rises(_, velocity, direction):
        return velocity[1]

    stops.terminal = rises.terminal = True
    rises.direction = 1.0
    hold = -inverse[0, 1] / inverse[0, 0]  # P_x of a unit of P_y by which x' does not change
    while given < end:
        if direction == 0.0 and abs(hold) > STATIC:
            direction = -np.sign(hold)
            velocity[0] = direction * 1e-300
        last = given + 10.0 * abs(fall) * inertia[1, 1] if end == math.inf else end
        flow = solve_ivp(change, (given, last), velocity, "DOP853", args=(direction,), rtol=3e-14, atol=1e-15,
                         events=[stops, rises] if end == math.inf else [stops])
        given, velocity = flow.t[-1], flow.y[:, -1].copy()
        if len(flow.t_events[0]):
            velocity[0], direction = 0.0, 0.0
        elif end == math.inf:
            end = (1.0 + restitution) * given
    return velocity


@pytest.mark.parametrize("restitution", [0.0, 0.7])
@pytest.mark.parametrize("across", [0.0, 0.05, 0.2, -0.2, 0.35, -0.35])
def test_a_landing_with_stribecks_friction_is_the_integral_of_the_impulse(across, restitution):
    """A74. Bodies that slip on, that stop and stick in either phase, that continue to slip, and that are turned back.
    1e-11 is the error of DOP853 at a stop.
    """
    inertia, outcomes = np.array([[1.3, across], [across, 0.9]]), set()
    for speed, decay_speed in itertools.product((0.0, 1e-3, -0.02, 0.05, -0.1, 0.15, 0.3, -2.0), (0.02, 0.3)):
        after, rise, outcome = KERNELS.land(law(decay_speed, restitution), 1.3, across, 0.9, speed, -0.5)
        assert (after, rise) == pytest.approx(integrated(inertia, speed, -0.5, decay_speed, restitution), abs=1e-11)
        assert outcome == (0 if after > 0.0 else 1 if after < 0.0 else 2)
        outcomes.add((np.sign(speed), outcome))
    assert len(outcomes) >= 3


@pytest.mark.parametrize("across", [0.0, 0.2, -0.35])
def test_friction_that_falls_at_once_or_never_is_coulombs(across):
    """At a speed far above v_s only mu acts, at one far below only mu_s; each error is of the order of the ratio of the
    speeds, also at the ends of the range of numbers.
    """
    for speed, restitution in itertools.product((0.3, -0.3, 2.0), (0.0, 0.7)):
        for tiny in (1e-9, 1e-300):
            landed = KERNELS.land(law(tiny, restitution), 1.3, across, 0.9, speed, -0.5)
            expected = KERNELS.land(law(0.0, restitution), 1.3, across, 0.9, speed, -0.5)
            assert landed == pytest.approx(expected, abs=1e2 * max(tiny, 1e-15))
        for large in (1e9, 1e300):
            landed = KERNELS.land(law(large, restitution), 1.3, across, 0.9, speed, -0.5)
            expected = KERNELS.land(law(0.0, restitution, STATIC), 1.3, across, 0.9, speed, -0.5)
            assert landed == pytest.approx(expected, abs=1e-9)


def test_friction_takes_energy_from_a_landing():
    """dP_x acts against x', so no landing gains energy."""
    chance = np.random.default_rng(4)
    for _ in range(2000):
        along, up = chance.uniform(1.0, 2.0, 2)
        across, speed, fall = chance.uniform(-0.5, 0.5), chance.normal(), -chance.uniform(1e-9, 2.0)
        kinetic = chance.uniform(0.0, 0.8)
        record = law(10.0 ** chance.uniform(-4.0, 2.0), chance.uniform(0.0, 0.5), kinetic,
                     kinetic + chance.uniform(0.0, 0.5))
        after, rise, outcome = KERNELS.land(record, along, across, up, speed, fall)
        energy_before = along * speed**2 + 2.0 * across * speed * fall + up * fall**2
        energy_after = along * after**2 + 2.0 * across * after * rise + up * rise**2
        assert rise >= 0.0 and energy_after <= energy_before * (1.0 + 1e-14)
        assert outcome == 2 or after == 0.0 or np.sign(after) == (1.0, -1.0)[outcome]
