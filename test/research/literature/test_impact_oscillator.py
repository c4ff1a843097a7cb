"""The impact oscillator of Budd and Dux: closed forms against the exact simulation, scipy and finite differences."""

import math
from dataclasses import replace

import numpy as np
import pytest

from research.literature.impact_oscillator import (
    Oscillator,
    difference,
    doubling,
    followed,
    oscillator_scene,
    settled,
    started,
)


@pytest.mark.parametrize("oscillator", [
    Oscillator(1.9, 1.05, 0.8), Oscillator(0.6, 1.3, 0.5), Oscillator(2.4, 1.01, 0.3)])
def test_exact_and_scipy_agree_in_the_literatures_variables(oscillator):
    assert difference(oscillator, 10) < 1e-5


@pytest.mark.parametrize(("omega", "turns"), [(1.9, 1), (2.0, 1), (2.1, 1), (4.2, 2), (6.0, 3)])
def test_the_settled_orbit_has_the_closed_forms_speed(omega, turns):
    oscillator = Oscillator(omega, 0.2 / abs(1.0 - omega**2), 0.7)
    motion = settled(started(oscillator, 1.0), oscillator)
    assert (motion.impacts, motion.turns) == (1, turns)
    assert motion.speeds[0] == pytest.approx(oscillator.speeds(turns)[0], rel=1e-5)


def test_the_closed_form_is_a_periodic_motion():
    """x = cos ωt/(1 - ω²) + a free oscillation returns to the stop after n turns with the speed of the impact."""
    oscillator, turns = Oscillator(1.9, 0.3, 0.8), 1
    speed, (a, _) = oscillator.speeds(turns)[0], oscillator.shape(turns)
    period = 2.0 * math.pi * turns / oscillator.omega
    free = -a * speed  # σ less the driven part at the impact
    forced = oscillator.sigma - free
    forced_speed = (1.0 - oscillator.restitution) * speed / 2.0
    free_speed = -oscillator.restitution * speed - forced_speed
    assert forced**2 + (forced_speed / oscillator.omega)**2 == pytest.approx(oscillator.reach**2)
    assert free * math.cos(period) + free_speed * math.sin(period) == pytest.approx(free)
    assert -free * math.sin(period) + free_speed * math.cos(period) + forced_speed == pytest.approx(speed)


def test_the_product_of_the_multipliers_is_the_restitution_squared():
    oscillator = Oscillator(2.1, 0.05, 0.6)
    multipliers = oscillator.multipliers(1, oscillator.speeds(1)[0])
    assert np.prod(multipliers) == pytest.approx(0.36)


def test_a_multiplier_is_one_at_the_fold():
    oscillator = Oscillator(1.9, 0.0, 0.8)
    at_fold = replace(oscillator, sigma=oscillator.fold(1) * (1.0 - 1e-12))
    assert np.max(np.real(at_fold.multipliers(1, at_fold.speeds(1)[0]))) == pytest.approx(1.0, abs=1e-4)
    beyond = replace(oscillator, sigma=oscillator.fold(1) * 1.001)
    assert all(map(math.isnan, beyond.speeds(1)))


def test_the_orbit_ends_at_the_fold_and_doubles_where_a_multiplier_is_minus_one():
    folding, fold = Oscillator(1.9, 0.0, 0.8), Oscillator(1.9, 0.0, 0.8).fold(1)
    found = [followed(replace(folding, sigma=fold * share), 0.0) for share in (0.99, 1.01)]
    assert [motion.impacts == 1 for motion in found] == [True, False]
    oscillator = Oscillator(2.8, 0.0, 0.8)
    place = doubling(oscillator, 1, -0.07, 0.0)
    motions = [followed(replace(oscillator, sigma=place + step), place - 0.01) for step in (-0.003, 0.003)]
    assert [(motion.impacts, motion.turns) for motion in motions] == [(1, 1), (2, 2)]


def test_the_scene_has_the_literatures_numbers():
    scene = oscillator_scene(Oscillator(1.9, 0.3, 0.8))
    rate = math.sqrt(scene["upper.spring.stiffness"] / scene["mass.upper"])
    assert scene["motor.speed"] / rate == pytest.approx(1.9)
    assert scene["upper.gap"] / scene["crank.radius"] == pytest.approx(0.3)
