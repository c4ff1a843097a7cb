"""scipy's solvers without event location: they work harder, and refuse what they cannot do."""

from functools import partial

import numpy as np
import pytest

import vibro_ros
from tools.peer.blind import blind
from vibro_ros.accuracy.methods import METHODS, by_scipy
from vibro_ros.accuracy.tables_by_scipy import UnableError

TIMES = np.linspace(0.0, 0.1, 101)


def test_without_event_location_the_same_solver_works_harder():
    """Its step control has to find every contact and every stop; where they fall decides how well it does."""
    scene = vibro_ros.load_scene("damped")
    unlocated, located, exact = (method(scene, TIMES, tolerance) for method, tolerance in (
        (partial(by_scipy, "DOP853", blind), 1e-6), (METHODS["DOP853"], 1e-6), (METHODS["exact"], 1e-9)))
    assert unlocated.evaluations > 3 * located.evaluations
    for found, least in ((located, 1e-5), (unlocated, 1e-3)):  # m
        assert np.abs(found.samples - exact.samples)[:, ::2].max() < least
    assert len(unlocated.events) == 0 < len(located.events)


@pytest.mark.parametrize("name", ["rigid", "device"])
def test_a_jump_of_a_speed_is_refused(name):
    with pytest.raises(UnableError, match="no rigid plates and no landing"):
        by_scipy("LSODA", blind, vibro_ros.load_scene(name), TIMES, 1e-6)
