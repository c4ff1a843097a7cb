"""The stateful device at the limits of its parameters: nothing infinite, no endless turns, energy accounted for."""


import pytest
from commanded_device import RAMP, device

from vibro_ros.model.slider import Slider


@pytest.mark.parametrize("damping", [0.0, 2.0, 300.0])
@pytest.mark.parametrize("adhesion", [True, False])
@pytest.mark.parametrize("load", [0.0, 1e-18, -1e-18, 1e-16, 1e-15, 1e-13, -1e-13])
def test_a_mass_that_rests_on_its_plate_without_load(load, damping, adhesion):
    """Preloads whose penetration is lost in rounding: contact and no contact must not take turns for ever."""
    rest = float(Slider(0.02, 0.06, 0.9).position(0.0))
    made = device(RAMP | {
        "guide.angle": 0.9, "effects.adhesion": adhesion, "upper.gap": 0.02 + load, "inclined.gap": rest - 0.06 + load,
        "upper.plate.stiffness": 1e9, "inclined.plate.stiffness": 1e7, "upper.spring.damping": damping,
        "inclined.spring.damping": damping, "upper.plate.damping": damping, "inclined.plate.damping": damping})
    made.advance_to(0.1)
    made.command(motor_speed=60.0)
    made.advance_to(0.2)
    made.command(motor_speed=0.0)
    made.advance_to(0.6)
    assert made.state.motor_speed == 0.0
