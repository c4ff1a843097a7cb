"""The smallest shock: what is found changes the motion, half of it does not, and it is near the edge of a map."""

import math

import numpy as np
import pytest

import vibro_ros
from vibro_ros.orbits.fatal_shock import LARGEST, Shocked
from vibro_ros.orbits.recurrence import SettledMotion, settle
from vibro_ros.orbits.turn_map import Stroboscope, free_cut

RARE = vibro_ros.load_scene("damped").with_parameters({
    "effects.normal_force": "printed", "mass.inclined": 0.25, "guide.angle": math.radians(80.0)})


@pytest.fixture(scope="module")
def stroboscope() -> Stroboscope:
    return Stroboscope(free_cut(RARE))


def motion_from(stroboscope: Stroboscope, **start: float) -> SettledMotion:
    stroboscope.begin_as(**start)
    return settle(stroboscope)


def after(stroboscope: Stroboscope, motion: SettledMotion, angle: float, change: np.ndarray) -> SettledMotion:
    """What follows when a motion is shocked at a crank angle, by another way: a device that runs there on its own."""
    turn_map = stroboscope.turn_map
    device = vibro_ros.Simulator(RARE)
    turn_map.put(device, motion.states[0])
    device.advance_to((angle - turn_map.phase) % (2.0 * math.pi) / RARE["motor.speed"])
    names = turn_map.names
    values = (turn_map.read(device.state) + change) * turn_map.units
    return motion_from(stroboscope, crank_angle=angle, **dict(zip(names, values.tolist(), strict=True)))


@pytest.mark.parametrize("speed", [0.0, -1.5])
def test_a_fatal_shock_changes_the_motion_and_a_smaller_one_along_it_does_not(stroboscope, speed):
    motion = motion_from(stroboscope, body_velocity=speed)
    shock = Shocked(stroboscope, motion).anywhere(None, 200)
    assert shock.size == pytest.approx(np.linalg.norm(shock.change)) and shock.size < LARGEST
    assert not shock.leads_to.is_same(motion)
    assert after(stroboscope, motion, shock.crank_angle, shock.change).is_same(shock.leads_to)
    for part in (0.0, 0.1, 0.5):
        assert after(stroboscope, motion, shock.crank_angle, part * shock.change).is_same(motion)


def test_the_smallest_shock_of_one_coordinate_is_the_edge_that_a_scan_finds(stroboscope):
    """Of the motion at -236 mm/s, of which little body velocity is enough."""
    motion = motion_from(stroboscope, body_velocity=-1.5)
    coordinate = stroboscope.turn_map.names.index("body_velocity")
    shock = Shocked(stroboscope, motion).along(coordinate, 60)
    assert np.flatnonzero(shock.change).tolist() == [coordinate]
    unit = np.eye(len(shock.change))[coordinate] * np.sign(shock.change[coordinate])
    scanned = next(size for size in np.linspace(0.0, 0.05, 501)
                   if not after(stroboscope, motion, shock.crank_angle, size * unit).is_same(motion))
    assert shock.size == pytest.approx(scanned, abs=2e-4)


def test_the_search_from_any_seed_comes_to_about_the_same(stroboscope):
    motion = motion_from(stroboscope, body_velocity=-1.5)
    sizes = []
    for seed in (0, 1):
        shocked = Shocked(stroboscope, motion, seed)
        sizes.append(shocked.anywhere(shocked.along(4, 60), 300).size)
    assert max(sizes) / min(sizes) < 1.15


def test_the_only_motion_has_no_fatal_shock():
    stroboscope = Stroboscope(free_cut(vibro_ros.load_scene("damped")))
    assert Shocked(stroboscope, motion_from(stroboscope)).anywhere(None, 60) is None
