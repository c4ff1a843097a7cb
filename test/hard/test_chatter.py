"""A body that leaves stick leaves it once: no state comes back at one instant."""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.model import tables
from vibro_ros.model.ground import Ground

STATES = ("stick", "slip_forward", "slip_backward")


@pytest.mark.parametrize("stiffness", [0.5, 50.0, 5e3])
@pytest.mark.parametrize("name", ["damped", "unilateral"])
def test_a_spring_between_body_and_world_makes_no_chatter(monkeypatch, name, stiffness):
    """Where stick ends the body is at rest but for rounding, although its equation has a spring of its own."""
    viscous = Ground.viscous_force
    monkeypatch.setattr(Ground, "viscous_force", lambda ground, *forms: viscous(ground, *forms) + stiffness
                        * ground._forms.position(ground._forms.body))
    tables._compile_machine.cache_clear()
    scene = vibro_ros.load_scene(name).with_parameters({"ground.viscous_friction": 1e-9})
    events = vibro_ros.simulate(scene, duration=2.0, rate=100.0).events
    tables._compile_machine.cache_clear()
    changes = events[np.isin(events["kind"], STATES)]
    assert len(changes) > 50
    assert np.diff(changes["time"]).min() > 1e-9
