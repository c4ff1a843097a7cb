"""A device with parameters of the test's own, and what its tests compare of it."""

import dataclasses

import numpy as np

import vibro_ros

SWINGING = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}
RAMP = {"effects.motor": "ramp", "motor.speed": 0.0}


def device(changes=None, scene="unilateral"):
    return vibro_ros.Simulator(vibro_ros.load_scene(scene).with_parameters(changes or {}))


def state_bits(made):
    return np.array(dataclasses.astuple(made.state)).tobytes()


def of_kind(events, *kinds):
    return events[np.isin(events["kind"], kinds)]
