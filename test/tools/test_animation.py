"""The animation is the simulation, to scale."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from PIL import Image

import vibro_ros
from tools import animation
from tools.mechanism import HUB_HEIGHT, Mechanism

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "robot.gif"


@pytest.fixture
def device():
    made = vibro_ros.Simulator(vibro_ros.load_scene("damped"))
    made.advance_to(0.123)
    return made


@pytest.fixture
def drawn(device):
    """The axes of a drawing at the device's state; 1 mm is 1 data unit."""
    axes = Figure().add_subplot()
    Mechanism(axes, device.scene).show(device.state, {"upper": 1.0})
    return axes


def data_points(axes, line):
    """Points of a line in data units [mm], through its own transform."""
    return (line.get_transform() - axes.transData).transform(line.get_xydata())


def test_crank_and_rods_have_their_lengths_and_meet(drawn, device):
    """Crank and rods are the lines of two points that differ: 20 mm, 60 mm, 60 mm."""
    links = [points for line in drawn.get_lines() if len(points := data_points(drawn, line)) == 2]
    crank, = [link for link in links if np.ptp(link, axis=0) @ np.ptp(link, axis=0) < 30.0**2]
    rods = [link for link in links if link is not crank]
    assert np.linalg.norm(crank[1] - crank[0]) == pytest.approx(20.0, abs=1e-9)
    assert crank[0] == pytest.approx([device.state.body_position * 1e3, 0.0], abs=1e-9)
    assert len(rods) == 2
    for rod in rods:
        assert np.linalg.norm(rod[1] - rod[0]) == pytest.approx(60.0, abs=1e-9)
        assert rod[0] == pytest.approx(crank[1], abs=1e-9)


def test_the_whole_robot_hops(device):
    """What stands in the air in the simulation stands in the air in the picture, to scale."""
    scene = vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0})
    hopping = vibro_ros.Simulator(scene)
    lowest = []
    axes = Figure().add_subplot()
    mechanism = Mechanism(axes, scene)
    [sled] = [patch for patch in axes.patches if isinstance(patch, Polygon) and len(patch.get_xy()) == 5
              and patch.get_xy()[:, 1].min() == -HUB_HEIGHT]
    for instant in np.linspace(2.0, 2.3, 31):
        hopping.advance_to(instant)
        mechanism.show(hopping.state, {})
        corners = (sled.get_transform() - axes.transData).transform(sled.get_xy())
        lowest.append(corners[:, 1].min() + HUB_HEIGHT)
        assert lowest[-1] == pytest.approx(hopping.state.body_height * 1e3, abs=1e-9)
    assert max(lowest) > 5.0 and min(lowest) == pytest.approx(0.0, abs=1e-9)


def test_the_committed_gif_moves_and_is_small():
    with Image.open(PICTURE) as committed:
        assert committed.n_frames == 4 * animation.FRAMES_PER_TURN
    assert PICTURE.stat().st_size < 2e6
