"""Quantities that are derived from samples alone."""

import numpy as np
import pytest

import vibro_ros
from vibro_ros.simulation.samples import resets


@pytest.mark.parametrize("rate", [200.0, 10.0])
@pytest.mark.parametrize(("name", "changes"), [
    ("device", {}), ("damped", {"effects.motor": "lag", "motor.time_constant": 0.05}), ("damped", {}), ("machine", {})])
def test_resets_are_told_whichever_way_the_crank_runs(name, changes, rate):
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
    found = resets(*np.array(rows).T)
    assert np.flatnonzero(found).tolist() == wanted[:-1]
