"""The energy audit sees an error of the solver, and only that."""

import dataclasses

import pytest

import vibro_ros
from vibro_ros.simulation.motion import new_stepper


def audited(name, damage=lambda system: None):
    """Share of the energy exchanged that does not balance within 1 s, after `damage` to what the solver integrates."""
    scene = vibro_ros.load_scene(name).with_parameters({"solver.audit": True, "motor.speed": 100.0})
    device = vibro_ros.Simulator(scene)
    original = device._motion.model
    system = original.system._replace(acceleration=original.system.acceleration.copy())
    damage(system)
    device._motion.model = dataclasses.replace(original, system=system)
    device._motion._stepper = new_stepper(scene, device._motion.model)
    device.advance_to(1.0)
    statistics = device.statistics
    return abs(statistics["energy_residual"]) / statistics["energy_exchanged"]


@pytest.mark.parametrize("name", ["unilateral", "rigid", "device"])
def test_an_exact_motion_balances(name):
    """Blows of rigid plates and landings are in the balance: between them nothing is lost."""
    assert audited(name) < 1e-13


@pytest.mark.parametrize("name", ["unilateral", "rigid", "device"])
def test_a_wrong_equation_shows(name):
    """Springs that pull harder than they should by 1e-9 of their force."""
    def stiffen(system):
        system.acceleration[:, 0, 0] *= 1.0 + 1e-9

    assert audited(name, stiffen) > 1e-11
