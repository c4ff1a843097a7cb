"""Free parameters: coordinates there and back, and refusals that name value, limit and remedy."""

import math

import numpy as np
import pytest

import vibro_ros
from vibro_lab.identification.unknowns import Unknowns, plates_in, unknown_of

SCENE = vibro_ros.load_scene("damped")
FREE = ("upper.plate.damping", "guide.angle", "ground.friction", "upper.gap", "upper.plate.stiffness", "mass.body")


def restitution_number(values):
    return values["upper.plate.damping"] / math.sqrt(values["upper.plate.stiffness"])


def test_values_come_back_from_their_coordinates():
    unknowns = Unknowns.of(SCENE, FREE, {})
    coordinates = unknowns.coordinates(SCENE.parameters)
    values = unknowns.values(coordinates)
    assert values == pytest.approx({name: SCENE[name] for name in FREE}, rel=1e-12)
    assert unknowns.scene_of(coordinates)["mass.body"] == pytest.approx(SCENE["mass.body"], rel=1e-12)
    assert unknowns.names == FREE


def test_a_unit_of_a_coordinate_is_a_share_of_a_positive_parameter_and_a_length_or_an_angle_otherwise():
    scene = SCENE.with_parameters({"upper.gap": -0.001})
    unknowns = Unknowns.of(scene, ("mass.body", "upper.gap", "guide.angle"), {})
    coordinates = unknowns.coordinates(scene.parameters)
    more = unknowns.values(coordinates + [0.1, 0.1, 0.1])
    assert more["mass.body"] == pytest.approx(scene["mass.body"] * math.exp(0.1))
    assert more["upper.gap"] == pytest.approx(-0.001 + 1e-4)
    assert more["guide.angle"] == pytest.approx(scene["guide.angle"] + 0.01)


def test_the_stiffness_of_a_plate_changes_its_damping_with_it_and_not_its_restitution():
    """The coordinate of the damping is the logarithm of c / sqrt(k), whatever the order of the names."""
    unknowns = Unknowns.of(SCENE, FREE, {})
    coordinates = unknowns.coordinates(SCENE.parameters)
    stiffer = unknowns.values(coordinates + 0.2 * np.eye(len(FREE))[FREE.index("upper.plate.stiffness")])
    assert stiffer["upper.plate.stiffness"] == pytest.approx(SCENE["upper.plate.stiffness"] * math.exp(0.2))
    assert restitution_number(stiffer) == pytest.approx(restitution_number(SCENE.parameters))
    damped = unknowns.values(coordinates + 0.2 * np.eye(len(FREE))[FREE.index("upper.plate.damping")])
    assert damped["upper.plate.stiffness"] == pytest.approx(SCENE["upper.plate.stiffness"])
    assert restitution_number(damped) == pytest.approx(math.exp(0.2) * restitution_number(SCENE.parameters))
    assert plates_in(FREE) == [("upper.plate.stiffness", "upper.plate.damping")]
    assert plates_in(("upper.plate.stiffness", "inclined.plate.damping")) == []


def test_slopes_are_differences_of_values():
    unknowns = Unknowns.of(SCENE, FREE, {})
    coordinates, step = unknowns.coordinates(SCENE.parameters), 1e-6
    allowed = np.array([1e-8 * (SCENE[name] + 1e-3) for name in FREE])
    for k, row in enumerate(np.eye(len(FREE))):
        up, down = (np.array([*unknowns.values(coordinates + sign * step * row).values()]) for sign in (1.0, -1.0))
        assert (np.abs(unknowns.slopes(coordinates)[:, k] - (up - down) / (2.0 * step)) < allowed).all()


def test_beyond_its_range_a_value_is_the_end_of_the_range():
    unknowns = Unknowns.of(SCENE, ("ground.friction",), {"ground.friction": (0.1, 0.4)})
    assert unknowns.values(np.array([3.0])) == {"ground.friction": 0.4}
    assert unknowns.values(np.array([-1e6])) == {"ground.friction": 0.1}
    assert unknowns.values(np.array([1e6])) == {"ground.friction": 0.4}
    assert unknown_of(SCENE, "upper.gap").value(-1e300) == pytest.approx(unknown_of(SCENE, "upper.gap").low)


@pytest.mark.parametrize(("free", "ranges", "words"), [
    (("mass.bodi",), {}, ["mass.bodi", "no number of the robot", "such as ground.friction"]),
    (("effects.friction",), {}, ["effects.friction", "no number of the robot"]),
    (("solver.step",), {}, ["solver.step", "no number of the robot"]),
    (("sensors.tracking.noise",), {}, ["sensors.tracking.noise", "no number of the robot"]),
    ((), {}, ["free", "give a list of names"]),
    (("mass.body", "mass.body"), {}, ["mass.body", "each once"]),
    ("mass.body", {}, ["mass.body", "give a list of names"]),
    (("mass.body",), {"ground.friction": (0.1, 0.2)}, ["ground.friction", "is not free", "free it"]),
    (("ground.friction",), {"ground.friction": (0.4, 0.1)}, ["ground.friction", "0.4 to 0.1 is no range", "LOW:HIGH"]),
    (("ground.friction",), {"ground.friction": (0.2, 0.2)}, ["0.2 to 0.2 is no range"]),
    (("ground.friction",), {"ground.friction": (-1.0, 0.4)}, ["-1 to 0.4 is no range within 0 to"]),
    (("ground.friction",), {"ground.friction": (math.nan, 0.4)}, ["nan to 0.4 is no range"]),
    (("ground.friction",), {"ground.friction": (0.9, 1.0)}, ["does not include the scene's value", "change one"]),
    (([],), {}, ["free", "give a list of names"]),
], ids=str)
def test_what_cannot_be_free_is_refused_in_one_line(free, ranges, words):
    with pytest.raises(ValueError) as refusal:
        Unknowns.of(SCENE, free, ranges)
    said = str(refusal.value)
    assert "\n" not in said and len(said) < 300
    for word in words:
        assert word in said
