"""`solver.tolerance` is kept, and no tolerance below rounding is accepted: a change in the last place shifts positions
by less.
"""

import numpy as np
import pytest

import vibro_ros
from vibro_lab.accuracy.harness import SceneProblem
from vibro_lab.accuracy.programs import Setting, UnableError, by_device
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.simulation.simulator import ToleranceWarning

TIMES = np.linspace(0.0, 0.2, 1001)
ROUNDED = ("mass.upper", "mass.inclined", "mass.body", "crank.radius", "crank.upper_rod", "upper.spring.stiffness",
           "guide.angle")


def positions(scene):
    run = vibro_ros.simulate(scene, times=TIMES)
    return np.array([run.body_position, run.body_height, run.upper_position, run.inclined_position])


def shift(scene):
    """Return the largest change of a position [m] caused by one unit in the last place of a parameter, up or down."""
    reference = positions(scene)
    neighbours = ({name: float(np.nextafter(scene[name], towards))} for name in ROUNDED for towards in (0.0, np.inf))
    return max(np.abs(positions(scene.with_parameters(changes)) - reference).max() for changes in neighbours)


@pytest.mark.process
@pytest.mark.parametrize("stiffness", [1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11])
@pytest.mark.parametrize("name", shipped_scenes())
def test_a_rounding_of_a_parameter_shifts_positions_by_less_than_is_promised(name, stiffness):
    scene = vibro_ros.load_scene(name).with_parameters({
        "motor.speed": 100.0, **{f"{side}.plate.stiffness": stiffness for side in ("upper", "inclined")}})
    assert shift(scene) <= scene.attainable_accuracy


def test_long_rods_are_rounded_more():
    scene = vibro_ros.load_scene("paper").with_parameters({"crank.upper_rod": 20.0, "crank.inclined_rod": 20.0})
    assert 2e-11 < shift(scene) <= scene.attainable_accuracy


@pytest.mark.parametrize(("changes", "least"), [
    ({"inclined.plate.stiffness": 1e9}, "2.8e-10"), ({"inclined.plate.stiffness": 1e10}, "4.9e-09"),
    ({"mass.inclined": 1e-3}, "2.1e-10"), ({"crank.upper_rod": 20.0}, "2.9e-10")])
def test_a_promise_that_stiff_plates_do_not_let_keep_is_refused(changes, least):
    scene = vibro_ros.load_scene("paper").with_parameters(changes)
    with pytest.raises(ValueError, match="solver.tolerance: 1e-12 m is below what rounding allows with these rods and "
                                         f"plates; give at least {least} m, or softer plates"):
        scene.with_parameters({"solver.tolerance": 1e-12})
    assert scene.with_parameters({"solver.tolerance": float(least)})
    without = {"effects.upper_contact": "none", "effects.inclined_contact": "none", "crank.upper_rod": 0.06}
    assert scene.with_parameters({"solver.tolerance": 1e-12, **without})


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_keep_all_that_may_be_asked_for(name):
    assert vibro_ros.load_scene(name).with_parameters({"solver.tolerance": 1e-12})


def test_the_default_is_warned_of_where_rounding_does_not_let_it_be_kept():
    scene = vibro_ros.load_scene("paper").with_parameters({"upper.plate.stiffness": 1e10})
    assert scene.attainable_accuracy > scene["solver.tolerance"]
    with pytest.warns(ToleranceWarning, match="solver.tolerance: 1e-09 m is below what rounding allows with these rods "
                                              "and plates; give at least 3.7e-09 m, or softer plates"):
        vibro_ros.Simulator(scene)


@pytest.mark.parametrize("name", shipped_scenes())
def test_every_tolerance_is_kept(name):
    """Against heyoka at its strictest, whose own error within 0.2 s is below 1e-13 m (test_heyoka_robot)."""
    scene, heyoka = vibro_ros.load_scene(name), pytest.importorskip("benchmark.programs.heyoka")
    try:
        peer = heyoka.prepare(SceneProblem(scene, TIMES), Setting(1e-15, ""))().samples
    except UnableError as reason:
        pytest.skip(str(reason))
    for tolerance in (1e-3, 1e-6, 1e-9, 1e-12):
        samples = by_device("exact", scene, TIMES, tolerance).samples
        error = np.abs(samples - peer)[:, ::2].max()
        assert error < tolerance, f"{error:.1e} m"
