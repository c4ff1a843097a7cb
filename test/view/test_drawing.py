"""The drawing data of a robot agrees with its scene and can be written as JSON."""

import json

import pytest

import vibro_ros
from vibro_ros.configuration.scene_file import shipped_scenes
from vibro_ros.view.protocol import drawing, quantities


@pytest.mark.parametrize("name", shipped_scenes())
def test_lengths_limits_and_units_of_every_shipped_scene(name):
    scene = vibro_ros.load_scene(name)
    robot = json.loads(json.dumps(drawing(scene), allow_nan=False))
    assert (robot["name"], robot["crank_radius"]) == (name, scene["crank.radius"])
    assert [guide["side"] for guide in robot["guides"]] == list(scene.guides)
    floor = ["ground.friction"] if scene["effects.friction"] != "none" else []
    assert [knob["name"] for knob in robot["knobs"]] == [
        "motor_speed", *(f"{side}_gap" for side in scene.plates), *floor]
    assert list(robot["quantities"]) == list(quantities(scene)) and robot["hops"] == (name in ("device", "machine"))


@pytest.mark.parametrize("changes", [{"effects.reaction": False}, {"effects.friction": "static"}])
def test_the_robot_refuses_beyond_a_knobs_limits_and_nowhere_before(changes):
    device = vibro_ros.Simulator(vibro_ros.load_scene("device").with_parameters(changes))
    for knob in drawing(device.scene)["knobs"]:
        for limit, beyond in ((knob["from"], -1e-6), (knob["to"], 1e-6)):
            turn = device.set_parameters if knob["parameter"] else lambda value: device.command(**value)
            turn({knob["name"]: limit})
            with pytest.raises(ValueError):
                turn({knob["name"]: limit + beyond})


def test_a_robot_without_a_mass_or_a_plate_has_no_quantities_of_them():
    scene = vibro_ros.load_scene("damped").with_parameters(
        {"effects.upper_mass": False, "effects.inclined_contact": "none", "ground.slope": -0.2})
    robot = drawing(scene)
    assert (robot["slope"], robot["weight"]) == (-0.2, scene.total_mass * scene["gravity"])
    assert [(guide["side"], guide["plate"]) for guide in robot["guides"]] == [("inclined", False)]
    assert [knob["name"] for knob in robot["knobs"]] == ["motor_speed", "ground.friction"]
    assert not any("upper" in name or "plate" in name for name in robot["quantities"])
    assert robot["quantities"]["inclined_position"] == "m" and robot["quantities"]["inclined_drive_force"] == "N"
    assert robot["quantities"]["crank_angle"] == "rad" and robot["quantities"]["motor_speed"] == "rad/s"
