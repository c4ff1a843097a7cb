"""The model contains the published capsule; progressions and attractors are told apart."""

import dataclasses
import math

import numpy as np
import pytest

from research.literature import capsule
from research.literature.capsule_equations import Capsule, Drive, harmonic, integrate
from vibro_ros.simulation.simulator import Simulator

QUIET = dataclasses.replace(capsule.REFERENCE, alpha=0.05)


@pytest.mark.parametrize("machine", [
    capsule.REFERENCE, QUIET, dataclasses.replace(capsule.REFERENCE, gamma=1.0, omega=1.1, xi=0.1),
    dataclasses.replace(capsule.REFERENCE, beta=50.0, delta=0.5, alpha=3.0)])
def test_exact_and_scipy_agree_on_the_published_equations(machine):
    assert capsule.difference(machine, 3) < 20.0 * capsule.rod_harmonics(machine)


def test_what_differs_is_the_rods_harmonic():
    """r²/(4 L): a rod of a quarter of the length, four times the difference."""
    ratio = capsule.difference(capsule.REFERENCE, 3, rod=2.5) / capsule.difference(capsule.REFERENCE, 3, rod=10.0)
    assert ratio == pytest.approx(4.0, rel=0.05)


def test_a_force_from_outside_is_an_internal_one_as_long_as_there_is_no_impact():
    assert capsule.outside_difference(capsule.REFERENCE, 3) < 1e-6


def test_a_force_from_outside_is_another_machine_where_there_are_impacts():
    times = np.linspace(0.0, 3 * capsule.REFERENCE.period, 50)
    inside, outside = (integrate(capsule.REFERENCE, times, harmonic(capsule.REFERENCE, 0.0, reaction))[:, 2]
                       for reaction in (1.0, 0.0))
    assert np.max(np.abs(inside - outside)) > 0.1


def test_a_wrong_damping_would_be_seen():
    times = np.linspace(0.0, 3 * capsule.REFERENCE.period, 50)
    other = dataclasses.replace(capsule.REFERENCE, xi=0.0501)
    found = [integrate(machine, times, harmonic(capsule.REFERENCE, 0.0))[:, 2]
             for machine in (capsule.REFERENCE, other)]
    assert np.max(np.abs(found[0] - found[1])) > 1e-5


def test_a_weak_drive_never_moves_the_capsule():
    device = Simulator(capsule.capsule_scene(QUIET))
    device.advance_to(1.0)
    assert device.state.body_position == 0.0


def test_scipys_free_mass_is_the_driven_oscillator():
    """Capsule at rest: z = C (cos ω τ - cos τ), C = α/(1 - ω²)."""
    machine = Capsule(alpha=0.1, omega=0.5, beta=0.0, gamma=1.0, delta=10.0, xi=0.0)
    times = np.linspace(0.0, 20.0, 101)
    expected = 0.1 / (1.0 - 0.25) * (np.cos(0.5 * times) - np.cos(times))
    np.testing.assert_allclose(integrate(machine, times, harmonic(machine, 0.0))[:, 0], expected, atol=1e-9)


def test_scipys_capsule_slides_under_a_constant_push_from_outside():
    """Without a spring force on it the capsule rests, however hard the mass is pushed from outside at first."""
    machine = Capsule(alpha=0.0, omega=1.0, beta=0.0, gamma=2.0, delta=1e9, xi=0.0)
    found = integrate(machine, np.array([0.0, 0.5, 1.0]), Drive(lambda time: 0.5, reaction=0.0))
    assert np.all(found[:, 2] == 0.0)
    np.testing.assert_allclose(found[:, 0], 0.5 * (1.0 - np.cos([0.0, 0.5, 1.0])), atol=1e-10)


def test_a_progression_counts_when_it_is_large_and_the_same_in_both_halves():
    assert capsule.Progression(0.2, 0.201).settled
    assert not capsule.Progression(0.2, 0.3).settled
    assert not capsule.Progression(1e-3, 1e-3).settled
    assert capsule.Progression(-0.2, -0.2).mean == -0.2


def test_a_survey_finds_reversal_and_attractors_in_both_directions():
    forth, back = capsule.Progression(0.5, 0.5), capsule.Progression(-0.5, -0.5)
    survey = capsule.Survey(capsule.REFERENCE, {1.0: (back, back), 2.0: (forth, back), 3.0: (forth, forth)})
    assert survey.signs_from_rest() == {1.0, -1.0}
    assert survey.opposed_ratios() == [2.0]


def test_the_machines_are_the_same_every_time_and_within_the_box():
    drawn = capsule.machines(8)
    assert drawn == capsule.machines(8) and len(set(drawn)) == 8
    assert all(low <= getattr(machine, name) <= high for machine in drawn for name, (low, high) in capsule.BOX.items())


def test_the_scene_has_the_published_numbers():
    scene, machine = capsule.capsule_scene(capsule.REFERENCE), capsule.REFERENCE
    rate = math.sqrt(scene["inclined.spring.stiffness"] / scene["mass.inclined"])
    friction = scene["ground.friction"] * scene.total_mass * scene["gravity"]
    assert scene["mass.body"] / scene["mass.inclined"] == pytest.approx(machine.gamma)
    assert scene["motor.speed"] / rate == pytest.approx(machine.omega)
    assert scene["inclined.gap"] * scene["inclined.spring.stiffness"] / friction == pytest.approx(machine.delta)
    assert scene["inclined.spring.damping"] / (2.0 * scene["mass.inclined"] * rate) == pytest.approx(machine.xi)


def test_a_capsule_with_wheels_that_turn_one_way_never_moves_backwards():
    times = np.linspace(0.0, 5 * capsule.REFERENCE.period, 400)
    both, one = (integrate(dataclasses.replace(capsule.REFERENCE, grip=grip, gamma=1.0), times,
                           harmonic(capsule.REFERENCE, 0.0))[:, 2] for grip in (1.0, math.inf))
    assert np.min(np.diff(both)) < -1e-3
    assert np.min(np.diff(one)) > -1e-9
    assert one[-1] > both[-1]


def test_a_touch_of_the_second_spring_is_told_with_its_speed():
    """Without friction on the capsule's side and drive: the mass flies into the gap's end at its own speed."""
    machine = Capsule(alpha=0.0, omega=1.0, beta=5.0, gamma=2.0, delta=0.5, xi=0.0)
    blows = []
    integrate(machine, np.array([0.0, 2.0]), harmonic(machine, 0.0), speed=0.8, blows=blows)
    (when, speed), = blows
    assert when == pytest.approx(math.asin(0.5 / 0.8), abs=1e-9)
    assert speed == pytest.approx(math.sqrt(0.8**2 - 0.5**2), abs=1e-9)


def test_a_slide_within_a_step_ends_after_it_began():
    """This capsule slides back for less than a step; integrated in one, it would never leave the slide's start."""
    machine = dataclasses.replace(capsule.machines(16)[5], gamma=2.0)
    times = machine.period * np.array([1.0, 2.0])
    found = integrate(machine, times, harmonic(machine, -math.pi / 2.0, reaction=0.0), tolerance=1e-6)
    assert np.all(np.isfinite(found))
