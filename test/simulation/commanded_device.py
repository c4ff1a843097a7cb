"""A device with parameters of the test's own, and what its tests compare of it."""

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

import vibro_ros

SWINGING = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}
RAMP = {"effects.motor": "ramp", "motor.speed": 0.0}


def device(changes=None, scene="unilateral"):
    return vibro_ros.Simulator(vibro_ros.load_scene(scene).with_parameters(changes or {}))


def state_bits(made):
    return np.array(dataclasses.astuple(made.state)).tobytes()


def of_kind(events, *kinds):
    return events[np.isin(events["kind"], kinds)]


def running(scene: str = "device", **changes: object) -> vibro_ros.Simulator:
    """A device at 100 rad/s; of a parameter's name here __ stands for its dot."""
    return device({"motor.speed": 100.0} | {name.replace("__", "."): value for name, value in changes.items()}, scene)


@contextlib.contextmanager
def refused(made: vibro_ros.Simulator, words: str) -> Iterator[None]:
    """What is asked of the device in this block is refused in these words and changes nothing."""
    before = made.checkpoint().tobytes()
    with pytest.raises(ValueError, match=words):
        yield
    assert made.checkpoint().tobytes() == before


def booked_energy(accounts: dict[str, float]) -> float:
    """Energy on all accounts [J], in magnitude: what their residual is measured by."""
    return sum(abs(amount) for name, amount in accounts.items() if name != "residual")


def assert_balanced(made: vibro_ros.Simulator, part: float = 1e-12) -> None:
    """The accounts leave no more than this part of the energy that was exchanged."""
    accounts = made.statistics["energy_accounts"]
    assert abs(accounts["residual"]) <= part * booked_energy(accounts)
