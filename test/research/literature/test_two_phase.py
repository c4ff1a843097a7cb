"""The closed form of transport by vibration: against the exact simulation, scipy and its own special cases."""

import math

import numpy as np
import pytest

from research.literature import two_phase


def test_the_closed_form_has_the_fixed_point_of_the_cosine_as_its_limit():
    angle = math.asin(two_phase.closed_form(-1.0))
    assert angle == pytest.approx(math.cos(angle), abs=1e-12)
    assert two_phase.closed_form(0.0) == 0.0
    assert two_phase.closed_form(0.4) == pytest.approx(-two_phase.closed_form(-0.4))


def test_the_closed_form_is_the_zero_of_the_mean_friction():
    press, quadrature = 0.6, 0.7
    speed = two_phase.closed_form(press)
    phase = (np.arange(1_000_000) + 0.5) * 2.0 * math.pi / 1_000_000
    friction = np.sign(speed + np.cos(phase)) * (1.0 + press * np.cos(phase) + quadrature * np.sin(phase))
    assert abs(np.mean(friction)) < 1e-5


@pytest.mark.parametrize(("press", "tuning"), [(0.3, two_phase.STIFF), (0.9, two_phase.STIFF), (0.5, 0.7), (0.5, 1.0)])
def test_the_simulated_speed_is_the_closed_forms(press, tuning):
    share = two_phase.measured_share(two_phase.block_scene(press, tuning))
    assert share.error < 3.0 * two_phase.WEAKNESS
    assert share.shaking.press == pytest.approx(press, rel=1e-9)


def test_what_averaging_leaves_out_falls_with_the_friction():
    errors = [two_phase.measured_share(two_phase.block_scene(0.5, 1.0, weakness=weakness)).error
              for weakness in (0.04, 0.01)]
    assert errors[1] < errors[0] / 3.0  # of order 1


def test_an_independent_integration_of_a_block_on_a_shaken_plate_agrees():
    assert two_phase.difference(0.5) < 1e-4  # the rods' harmonics: l/(4 L) = 1.25e-5 of the stroke


def test_friction_at_half_the_shaking_speed_is_a_third():
    assert two_phase.friction_at_half_speed() == pytest.approx(1.0 / 3.0, abs=3.0 * two_phase.WEAKNESS)


def test_the_way_turns_where_the_press_is_in_quadrature():
    scene = two_phase.block_scene(0.5, 1.0, 0.1)
    assert two_phase.measured_switch(scene) == pytest.approx(two_phase.switch_speed(scene), rel=1e-3)
