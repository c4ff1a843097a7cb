"""Published forces obey the laws of the scene, by every method, also between events that a step has not detected."""

import itertools

import numpy as np
import pytest

import vibro_ros

STEP = 2e-5
TIMES = np.linspace(0.0, 0.3, 1801)  # 100/6 us: not where steps end
RULES = ("weight", "unilateral", "printed", "hop")


def scenes(name, method, rule):
    """Return the scene with every kind of friction, and with plates that can and cannot pull, where these are legal."""
    for friction, adhesion in itertools.product(("none", "coulomb", "static", "stribeck"), (True, False)):
        try:
            yield vibro_ros.load_scene(name).with_parameters({
                "solver.method": method, "solver.step": STEP, "motor.speed": 80.0, "effects.normal_force": rule,
                "effects.friction": friction, "effects.adhesion": adhesion, "ground.static_friction": 0.4})
        except ValueError:  # such as rigid plates as printed: refused
            continue


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("method", ["exact", "rk4"])
@pytest.mark.parametrize("name", ["damped", "device", "rigid"])
def test_published_forces_obey_their_laws(name, method, rule):
    """A34. Also between the events that a step of fixed length has not seen."""
    for scene in scenes(name, method, rule):
        run, weight = vibro_ros.simulate(scene, times=TIMES), scene.total_mass * scene["gravity"]
        rounding = 1e-8 if method == "exact" else 0.0  # of forces of 1e4 N that cancel, in mu N and the plates'
        flying = run.body_height > 1e-12
        assert not run.normal_force[flying].any() and not run.friction_force[flying].any()
        if rule == "weight":
            np.testing.assert_allclose(run.normal_force, weight, rtol=1e-14)
        if rule in ("unilateral", "hop"):
            assert run.normal_force.min() >= 0.0
        assert (np.abs(run.friction_force) <= max(scene.resting_frictions) * np.abs(run.normal_force) + rounding).all()
        assert run.body_height.min() >= -STEP * max(1e-9, np.abs(run.body_vertical_velocity).max()) - 1e-15
        for side in scene.plates:
            pulls = scene["effects.adhesion"] and scene[f"{side}.plate.damping"] > 0.0 and name != "rigid"
            assert pulls or getattr(run, f"{side}_plate_force").min() >= -rounding
