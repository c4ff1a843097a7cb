"""Lyapunov exponents against closed forms, Floquet multipliers, determinants, and an independent measurement."""

import math

import numpy as np
import pytest
from scipy.linalg import eigvals

import vibro_lab
import vibro_ros
from vibro_lab.orbits.chaos import exponent_of_pairs, spectrum_from
from vibro_lab.orbits.orbit import derivative
from vibro_lab.orbits.turn_map import Stroboscope, TurnMap, free_cut


def scene(name, **changes):
    return vibro_ros.load_scene(name).with_parameters({"motor.speed": 100.0} | changes)


@pytest.mark.parametrize("damping", [3.0, 21.0])
def test_a_linear_mass_has_the_real_parts_of_its_eigenvalues(damping):
    """A43. For an oscillating and for an overdamped mass."""
    robot = scene("unilateral", **{"effects.inclined_mass": False, "upper.spring.damping": damping, "upper.gap": 0.03})
    expected = np.sort(np.roots([robot["mass.upper"], damping, robot["upper.spring.stiffness"]]).real)[::-1]
    spectrum = vibro_lab.lyapunov_spectrum(robot)
    assert spectrum.exponents == pytest.approx(expected, abs=1e-4)
    assert (spectrum.turns, spectrum.spread.tolist()) == (1, [0.0, 0.0])


def test_a_run_finds_the_same_but_for_the_phase_that_a_complex_pair_ends_in():
    """The phase changes each exponent of the pair by about 1 / (turns T); their sum is exact."""
    robot = scene("unilateral", **{"effects.inclined_mass": False, "upper.spring.damping": 3.0, "upper.gap": 0.03})
    exponents = spectrum_from(TurnMap(robot), np.array([3.0, 0.1]), 200).exponents
    assert exponents == pytest.approx([-15.0, -15.0], abs=1.0 / (200 * 0.0628))
    assert exponents.sum() == pytest.approx(-30.0, abs=1e-6)


def test_masses_that_yield_to_each_other_have_the_eigenvalues_of_their_matrices():
    """A43. Both masses and the body without plates, friction and hop, with the reaction: M q'' + C q' + K q = forcing.
    The body's speed, by which nothing changes, has the exponent 0."""
    coupled = scene("no_impact", **{
        "effects.friction": "none", "effects.normal_force": "weight", "effects.reaction": True,
        "upper.spring.damping": 6.0, "inclined.spring.damping": 4.0, "inclined.spring.stiffness": 2e3})
    sine, m3 = math.sin(coupled["guide.angle"]), coupled["mass.inclined"]
    mass = np.array([[coupled["mass.upper"], 0.0, 0.0], [0.0, m3, -m3 * sine], [0.0, -m3 * sine, coupled.total_mass]])
    damping, stiffness = np.diag([6.0, 4.0, 0.0]), np.diag([1e3, 2e3, 0.0])
    rates = eigvals(np.block([[np.zeros((3, 3)), np.eye(3)],
                              [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])).real
    expected = np.delete(np.sort(rates)[::-1], 0)  # of the two zeros, that of the body's place is no coordinate
    assert vibro_lab.lyapunov_spectrum(coupled).exponents == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("name", "changes", "turns"), [
    ("damped", {}, 1), ("device", {}, 4), ("rigid", {}, 1)])
def test_of_a_periodic_motion_they_are_its_multipliers_logarithms(name, changes, turns):
    """A44. A direction that vanishes within a turn has a multiplier that is only rounding. Of a complex pair a run
    finds the exact sum, and each exponent apart from the effect of the phase at which the run ends.
    """
    machine = scene(name, **changes)
    orbit, motion = vibro_lab.find_orbit(machine, turns), vibro_lab.settled_motion(machine)
    assert motion.turns == turns
    period = turns * 2.0 * math.pi / machine["motor.speed"]
    with np.errstate(divide="ignore"):
        expected = np.log(np.abs(orbit.multipliers)) / period
    along_run = spectrum_from(free_cut(machine), motion.states[-1], 40 * turns)
    of_cycle = vibro_lab.lyapunov_spectrum(machine)
    for spectrum, error in ((along_run, 6.0 / (40 * period)), (of_cycle, 0.05)):
        lasting = ~np.isneginf(spectrum.exponents)
        assert spectrum.exponents[lasting] == pytest.approx(expected[lasting], abs=error)
        assert spectrum.exponents[lasting].sum() == pytest.approx(expected[lasting].sum(), abs=1e-3)
        assert (orbit.multipliers[~lasting] < 1e-7).all()


def test_the_sum_is_the_mean_logarithm_of_the_determinant():
    """A45. For a chaotic motion whose body slips but never sticks, so that no direction vanishes."""
    chaotic = scene("unilateral", **{"effects.friction": "none"})
    turn_map = free_cut(chaotic)
    state = Stroboscope(turn_map).begin_as().states[-1]
    spectrum = spectrum_from(turn_map, state, 50)
    logarithms = []
    for turn in range(55):
        matrix, (state, *_) = derivative(turn_map, state)
        if turn >= 5:
            logarithms.append(np.linalg.slogdet(matrix)[1])
    assert spectrum.exponents.sum() == pytest.approx(np.mean(logarithms) / turn_map.period, abs=1e-6)


def test_the_largest_is_that_of_two_runs_that_part():
    """A46. Of two devices over 20 s, as in studies; both results are means over chaos, each with its spread."""
    chaotic = scene("unilateral")
    spectrum = vibro_lab.lyapunov_spectrum(chaotic, turns=320, settling=64)
    device = vibro_ros.Simulator(chaotic)
    other, spread = exponent_of_pairs(device, 4.0, 20.0)
    assert spectrum.exponents[0] > 3.0
    assert 0.0 < spread < other  # a mean of ten parts, whose sign is known
    assert abs(spectrum.exponents[0] - other) < spectrum.spread[0] + spread


def test_a_motion_of_a_long_period_is_no_chaos():
    """`device` at 204 rad/s repeats itself every 158 turns: it has no period up to 64 turns, but no exponent above 0.
    """
    machine = scene("device", **{"motor.speed": 204.0})
    assert vibro_lab.settled_motion(machine).turns == 0
    spectrum = vibro_lab.lyapunov_spectrum(machine)
    assert spectrum.turns == 158 and spectrum.sign == -1 and not spectrum.spread.any()
    # A body that sticks and a landing forget directions.
    assert np.isneginf(vibro_lab.lyapunov_spectrum(scene("device")).exponents).tolist() == 4 * [False] + 3 * [True]


def test_turns_are_doubled_until_the_sign_is_known():
    """Chaos lets rounding decide at which points 20 turns suffice for the sign, so that several points are looked at:
    at most of them 20 turns do not suffice for `device` at 186 rad/s, and do for `unilateral`.
    """
    signs = []
    for machine in (scene("device", **{"motor.speed": 186.0}), scene("unilateral")):
        turn_map = free_cut(machine)
        stroboscope = Stroboscope(turn_map)
        stroboscope.begin_as()
        stroboscope.turns(1024)
        for _ in range(6):
            state = stroboscope.turns(64).states[-1]
            single, extended = spectrum_from(turn_map, state, 20), spectrum_from(turn_map, state, 20, 3)
            assert single.turns == 20
            assert extended.turns == 20 if single.sign else extended.turns in (40, 80, 160)
            assert extended.sign or extended.turns == 160
            signs.append(single.sign)
    assert 0 in signs[:6] and any(signs[6:])


@pytest.mark.parametrize(("arguments", "words"), [
    ({"turns": 5}, "turns: 5 is out of range; give a whole number from 20 to 1000000"),
    ({"turns": 50.0}, "turns: 50.0 is out of range"),
    ({"settling": 0}, "settling: 0 is out of range; give a whole number from 64 to 1000000")])
def test_numbers_out_of_range_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        vibro_lab.lyapunov_spectrum(scene("damped"), **arguments)
