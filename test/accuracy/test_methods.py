"""The table of methods: each against exact, and a wrong one must look wrong."""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.accuracy import precision
from vibro_ros.accuracy.methods import COLUMNS, METHODS, Answer, UnableError

TIMES = np.linspace(0.0, 0.1, 101)
RAMP = {"motor.acceleration": 2000.0}  # rad/s²: so that the device scene reaches 100 rad/s within the horizon


def scene(name):
    return vibro_ros.load_scene(name).with_parameters(RAMP)


def error(found: Answer, name: str) -> float:
    """Largest error of a position [m]."""
    return float(np.abs(found.samples - METHODS["exact"](scene(name), TIMES, 1e-9).samples)[:, ::2].max())


@pytest.mark.parametrize("name", ["damped", "device", "rigid", "no_impact"])
@pytest.mark.parametrize("method", ["DOP853", "LSODA", "Radau"])
def test_scipy_with_located_events_agrees_with_exact(name, method):
    """Local errors of 1e-9 add up, over some 1e3 steps at most."""
    if method == "Radau" and name != "damped":
        pytest.skip("slow: seconds a scene; the others show the same code")
    found = METHODS[method](scene(name), TIMES, 1e-9)
    exact = METHODS["exact"](scene(name), TIMES, 1e-9)
    assert error(found, name) < 1e-7
    assert found.steps > 10 and found.evaluations > found.steps
    contacts = [events[(events["kind"] == "upper_contact") & (events["time"] > 1e-3)]["time"]
                for events in (found.events, exact.events)]
    np.testing.assert_allclose(contacts[0], contacts[1], rtol=0, atol=1e-7)


def test_what_a_method_cannot_do_it_says():
    with pytest.raises(UnableError, match="rk4 may need a solver.step below 0.01 s"):
        METHODS["rk4"](scene("damped"), np.linspace(0.0, 20.0, 11), 1e-2)


@pytest.mark.parametrize(("method", "reason"), [
    ("DOP853", "a dc motor's controller takes samples"),
    ("moreau", "mass.upper_slider: 0.01 is not simulated by moreau")])
def test_what_a_method_lacks_of_a_machine_with_a_dc_motor_it_says(method, reason):
    with pytest.raises(UnableError, match=reason):
        METHODS[method](vibro_ros.load_scene("machine"), TIMES, 1e-6)


def test_no_mean_speed_is_asked_of_a_method_that_lacks_the_scene():
    devices = precision._devices(vibro_ros.load_scene("machine"), METHODS)
    assert devices == ["exact", "rk4", "rk4_located", "semi_implicit_euler"]


@pytest.mark.parametrize(("method", "coarse", "fine"), [("rk4", 1e-4, 1e-6), ("semi_implicit_euler", 1e-4, 1e-6),
                                                        ("moreau", 1e-4, 1e-6)])
def test_a_hundredth_of_the_step_is_well_worth_it(method, coarse, fine):
    """First order gains a factor of 100; half of its decades at least, whatever the scatter."""
    assert error(METHODS[method](scene("rigid"), TIMES, fine), "rigid") < 0.1 * error(
        METHODS[method](scene("rigid"), TIMES, coarse), "rigid")


def test_columns_are_fields_of_a_run():
    run = vibro_ros.simulate(scene("paper"), times=TIMES)
    found = METHODS["exact"](scene("paper"), TIMES, 1e-9)
    for k, column in enumerate(COLUMNS):
        np.testing.assert_array_equal(found.samples[:, k], getattr(run, column))
