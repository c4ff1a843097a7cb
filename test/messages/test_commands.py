"""The commands in a JointState, in every form in which the hardware of ros2_control has sent it."""

import math
from types import SimpleNamespace

import pytest

from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.topics import joint_commands

SCENE = load_scene("device")
ALL = ("crank", "upper_plate", "inclined_plate")
NAN = math.nan


def commands_of_message(name=ALL, position=(), velocity=(), effort=()):
    return joint_commands(SimpleNamespace(name=list(name), position=position, velocity=velocity, effort=effort), SCENE)


@pytest.mark.parametrize("message", [
    {"position": (0.0605, 0.059), "velocity": (100.0,)},  # only declared interfaces are appended
    {"position": (NAN, 0.0605, 0.059), "velocity": (100.0, NAN, NAN)},
    {"position": (NAN, 0.0605, 0.059), "velocity": (100.0,), "effort": (NAN,) * 3},
    {"name": ("upper_mass", *ALL), "position": (0.0605, 0.059), "velocity": (100.0,)},  # a joint that has states alone
    {"name": (*ALL[::-1],), "position": (0.059, 0.0605), "velocity": (100.0,)}])
def test_each_joint_gets_its_number_whatever_is_left_out(message: dict):
    commands, faults = commands_of_message(**message)
    assert commands == pytest.approx({"motor_speed": 100.0, "upper_gap": 0.0005, "inclined_gap": -0.001})
    assert not faults


def test_a_number_that_is_not_finite_is_neither_a_command_nor_a_fault():
    assert commands_of_message(position=(NAN, math.inf), velocity=(NAN,)) == ({}, [])
    assert commands_of_message(position=(NAN, NAN), velocity=(50.0,)) == ({"motor_speed": 50.0}, [])
    assert commands_of_message(name=()) == ({}, [])


@pytest.mark.parametrize(("message", "commands", "words"), [
    ({"position": (0.06,), "velocity": (50.0,)}, {"motor_speed": 50.0}, "position: 1 numbers for 3 names, 2 of them"),
    ({"position": (1.0, 0.06, 0.06)}, {"upper_gap": 0.0, "inclined_gap": 0.0}, "'crank' is not commanded by position"),
    ({"name": ("elbow\n",), "velocity": (1.0,)}, {}, r"'elbow\n' is not commanded by velocity; give crank by velocity"),
    ({"name": (*ALL, "elbow"), "velocity": (1.0,)}, {"motor_speed": 1.0}, "'elbow' is no joint of this robot; give"),
    ({"velocity": (1.0,), "effort": (0.0, 0.0, 1.0)}, {"motor_speed": 1.0}, "'crank' is not commanded by effort"),
    ({"name": ("crank", "elbow"), "velocity": (1.0,) * 3}, {}, "velocity: 3 numbers for 2 names"),
    ({"name": ("crank", "upper_plate", "crank"), "velocity": (1.0, 2.0)}, {}, "'crank' is named 2 times; name each")])
def test_meaningless_entries_are_reported_and_the_rest_is_used(message: dict, commands: dict, words: str):
    understood, faults = commands_of_message(**message)
    assert understood == commands and words in faults[0]
