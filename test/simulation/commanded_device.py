"""A device with parameters that a test chooses, and comparisons of it."""

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

import vibro_ros
from vibro_ros.simulation.samples import Run

SWINGING = {"effects.upper_contact": "none", "effects.inclined_contact": "none"}
RAMP = {"effects.motor": "ramp", "motor.speed": 0.0}


def device(changes=None, scene="unilateral"):
    return vibro_ros.Simulator(vibro_ros.load_scene(scene).with_parameters(changes or {}))


def changed(name: str, *changes: dict) -> vibro_ros.Scene:
    """Return a shipped scene with changes, of which later ones take precedence."""
    return vibro_ros.load_scene(name).with_parameters({
        key: value for values in changes for key, value in values.items()})


def state_bits(made):
    return np.array(dataclasses.astuple(made.state)).tobytes()


def of_kind(events, *kinds):
    return events[np.isin(events["kind"], kinds)]


def running(scene: str = "device", **changes: object) -> vibro_ros.Simulator:
    """Return a device at 100 rad/s; in the name of a parameter `__` stands for the dot."""
    return device({"motor.speed": 100.0} | {name.replace("__", "."): value for name, value in changes.items()}, scene)


@contextlib.contextmanager
def refused(made: vibro_ros.Simulator, words: str) -> Iterator[None]:
    """Check that the request in this block is refused with this message and changes nothing."""
    checkpoint = made.checkpoint().tobytes()
    with pytest.raises(ValueError, match=words):
        yield
    assert made.checkpoint().tobytes() == checkpoint


def assert_go_on_alike(made: vibro_ros.Simulator, other: vibro_ros.Simulator, until: float) -> None:
    """Check that two devices that are advanced to an instant [s] have the same state there, to the last bit."""
    for each in (made, other):
        each.advance_to(until)
    assert made.state == other.state


def disturb_in_every_way(made: vibro_ros.Simulator) -> None:
    """Give a device every fault that it can have, and a push, from now on."""
    made.push(0.0371, force_x=8.0, force_z=9.0 if made.scene.body_hops else 0.0)
    if not made.scene.linkage or made.scene["effects.motor"] != "ideal":  # such a motor keeps its speed
        made.fail("motor_stall", 0.02)
    for side in made.scene.plates:
        made.fail("plate_stuck", 0.031, of=side)
    if made.scene.has_rotor:
        made.fail("supply_sag", 0.043, value=9.0)
    if made.scene.has_dry_friction and made.scene["solver.method"] == "exact":
        place = made.state.body_position
        made.fail("friction_patch", 0.06, value=0.02, from_x=place - 1e-4, to_x=place + 1e-4)


def booked_energy(accounts: dict[str, float]) -> float:
    """Return the sum of the magnitudes of all energy accounts [J], to which the residual is compared."""
    return sum(abs(amount) for name, amount in accounts.items() if name != "residual")


def assert_balanced(made: vibro_ros.Simulator | Run, part: float = 1e-12, rounding: float = 0.0) -> None:
    """Check that the residual is at most this part of the exchanged energy, and a rounding [J]."""
    accounts = made.statistics["energy_accounts"]
    assert abs(accounts["residual"]) <= part * booked_energy(accounts) + rounding
