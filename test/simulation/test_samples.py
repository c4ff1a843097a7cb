"""Quantities that are derived from samples alone."""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.simulation.samples import FIELDS, resets


@pytest.mark.parametrize("rate", [200.0, 10.0])
@pytest.mark.parametrize(("name", "changes"), [
    ("device", {}), ("damped", {"effects.motor": "lag", "motor.time_constant": 0.05}), ("damped", {}), ("machine", {})])
def test_resets_are_detected_for_both_directions_of_the_crank(name, changes, rate):
    """Commands one second apart that reverse the crank are not taken for resets; resets on either side of the start
    angle are recognised.
    """
    device = vibro_ros.Simulator(vibro_ros.load_scene(name).with_parameters(changes))
    rows, wanted, elapsed = [], [], 0.0
    for speeds in ((100.0, 90.0, -95.0), (-90.0, -100.0, 60.0), (80.0,)):
        for k, speed in enumerate(speeds):
            device.command(motor_speed=speed)
            for tick in range(int(rate)):
                device.advance_to(k + (tick + 1) / rate)
                rows.append((elapsed + device.time, device.state.crank_angle, device.state.motor_speed))
        elapsed += device.time
        wanted.append(len(rows) - 1)  # between this sample and the next one
        device.reset()
    reset_after = resets(*np.array(rows).T)
    assert np.flatnonzero(reset_after).tolist() == wanted[:-1]


def test_a_run_has_a_repr_of_one_line_and_a_table():
    pandas = pytest.importorskip("pandas")
    run = vibro_ros.simulate(vibro_ros.load_scene("damped"), duration=0.5, rate=100.0)
    contacts = np.count_nonzero(run.events["kind"] == "upper_contact")
    assert repr(run).startswith("<Run: 51 samples from 0 s to 0.5 s; events: ") and "\n" not in repr(run)
    assert f" {contacts} upper_contact" in repr(run)
    assert repr(vibro_ros.simulate(vibro_ros.load_scene("damped"), times=[])) == "<Run: 0 samples; events: none>"
    table = run.to_pandas()
    assert isinstance(table, pandas.DataFrame) and table.index.name == "time"
    assert ["time", *table] == list(FIELDS)
    for name in table.reset_index():
        np.testing.assert_array_equal(table.reset_index()[name], getattr(run, name))


def test_the_repr_of_a_scene_is_the_call_that_makes_it():
    for name in ("paper", "machine", "rigid"):
        scene = vibro_ros.load_scene(name)
        assert eval(repr(scene), {"Scene": vibro_ros.Scene}) == scene
    assert repr(vibro_ros.Scene("heavy", {"mass.body": 2.0})) == "Scene('heavy', {'mass.body': 2.0})"
