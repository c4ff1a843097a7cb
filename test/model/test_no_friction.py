"""Friction without a coefficient is no friction."""

import dataclasses
import itertools

import numpy as np
import pytest

import vibro_ros

SCENES = ("paper", "unilateral", "damped", "rigid")


# The device's reaction and its hop do not go with Stribeck's law.
@pytest.mark.parametrize(("name", "law"), [
    *itertools.product([*SCENES, "device"], ["coulomb", "static"]), *itertools.product(SCENES, ["stribeck"])])
def test_a_coefficient_of_zero_gives_the_bits_of_no_friction(name, law):
    """Every sample, event and count: it compiles to the same modes, terms and guards."""
    scene = vibro_ros.load_scene(name).with_parameters({"motor.speed": 100.0})
    smooth = scene.with_parameters({"effects.friction": law, "ground.friction": 0.0, "ground.static_friction": 0.0})
    without = scene.with_parameters({"effects.friction": "none"})
    assert smooth.describe() == without.describe()
    found, expected = (vibro_ros.simulate(one, duration=1.0, rate=1000.0) for one in (smooth, without))
    assert len(expected.events) > 20 and np.abs(expected.body_velocity).max() > 0.1
    for field in dataclasses.fields(expected):
        if field.name != "statistics":
            np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name), field.name)
    assert {**found.statistics, "wall_time": 0.0} == {**expected.statistics, "wall_time": 0.0}


def test_a_static_coefficient_alone_is_friction():
    """Both must be zero: a body that nothing brakes once it slips may be held until then."""
    scene = vibro_ros.load_scene("unilateral").with_parameters({
        "effects.friction": "static", "ground.friction": 0.0, "ground.static_friction": 0.2})
    events = vibro_ros.simulate(scene, duration=0.2, rate=100.0).events
    assert np.isin(events["kind"], ["slip_forward", "slip_backward"]).any()
