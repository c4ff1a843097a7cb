"""The fault `friction_patch`: ground with another friction coefficient from one x to another, with exact edges."""

import math

import numpy as np
import pytest
from commanded_device import assert_go_on_alike, running

import vibro_ros

GRAVITY = 9.81
LONG = 1000.0  # [s]


def block(speed: float, **changes: object) -> vibro_ros.Simulator:
    """A body that slides, whose masses hang at rest on sliders that stand still, away from their plates."""
    device = running("damped", **({"motor__speed": 0.0, "upper__gap": 0.03, "inclined__gap": 0.03,
                                   "ground__friction": 0.3} | changes))
    device.set_state(body_velocity=speed)
    return device


def stopping(speed: float, *ground: tuple[float, float]) -> tuple[float, float]:
    """Distance [m] and time [s] in which a block stops on stretches of ground, each (coefficient, length)."""
    distance = time = 0.0
    for friction, length in ground:
        deceleration = friction * GRAVITY
        left = speed**2 - 2.0 * deceleration * length
        if left <= 0.0:
            return distance + speed**2 / (2.0 * deceleration), time + speed / deceleration
        distance, time, speed = distance + length, time + 2.0 * length / (speed + math.sqrt(left)), math.sqrt(left)
    raise AssertionError("the ground ends before the block stops")


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("law", ["coulomb", "static"])
@pytest.mark.parametrize("friction", [0.0, 0.05, 0.9])
def test_a_block_that_slides_over_a_patch_stops_where_and_when_coulomb_says(way: float, law: str, friction: float):
    """A15."""
    device = block(2.0 * way, effects__friction=law, ground__static_friction=0.4, solver__accounts=True)
    low, high = sorted((0.1 * way, 0.4 * way))
    device.fail("friction_patch", LONG, value=friction, from_x=low, to_x=high)
    distance, time = stopping(2.0, (0.3, 0.1), (friction, 0.3), (0.3, math.inf))
    device.advance_to(5.0)
    assert device.state.body_velocity == 0.0
    assert device.state.body_position == pytest.approx(way * distance, abs=1e-12)
    [event] = device.take_events()
    assert event["kind"] == "stick" and event["time"] == pytest.approx(time, abs=1e-12)
    statistics = device.statistics
    lost = 0.5 * device.scene.total_mass * 2.0**2
    assert statistics["energy_accounts"]["friction"] == pytest.approx(lost, rel=1e-13)
    assert abs(statistics["energy_accounts"]["residual"]) < 1e-13


def test_a_patch_that_ends_in_time_lasts_to_the_instant():
    device = block(2.0)
    device.fail("friction_patch", 0.25, value=0.0, from_x=0.1, to_x=5.0)
    deceleration = 0.3 * GRAVITY
    arrival = (2.0 - math.sqrt(4.0 - 2.0 * deceleration * 0.1)) / deceleration
    speed = 2.0 - deceleration * arrival
    device.advance_to(3.0)
    assert not device.disturbances
    expected = 0.1 + speed * (0.25 - arrival) + speed**2 / (2.0 * deceleration)
    assert device.state.body_position == pytest.approx(expected, abs=1e-12)


def test_a_body_that_does_not_reach_a_patch_or_stands_on_its_edge_does_not_feel_it():
    distance, _ = stopping(1.0, (0.3, math.inf))
    for start in (np.nextafter(distance, 1.0), distance + 1e-9, distance + 0.1):
        device, untouched = block(1.0), block(1.0)
        device.fail("friction_patch", LONG, value=0.0, from_x=start, to_x=start + 1.0)
        assert_go_on_alike(device, untouched, 2.0)
    standing = block(0.0)
    standing.set_state(body_position=0.25)
    for edges in ((0.25, 0.5), (0.0, 0.25), (0.25 - 1e-17, 0.25 + 1e-16)):
        standing.fail("friction_patch", LONG, value=0.1, from_x=edges[0], to_x=edges[1])
        standing.advance_to(standing.time + 1.0)
        assert (standing.state.body_position, standing.state.body_velocity) == (0.25, 0.0)


def test_a_patch_that_is_narrower_than_rounding_is_passed():
    device, untouched = block(1.0), block(1.0)
    device.fail("friction_patch", LONG, value=0.0, from_x=0.1, to_x=float(np.nextafter(0.1, 1.0)))
    for each in (device, untouched):
        each.advance_to(2.0)
    assert device.state.body_position == pytest.approx(untouched.state.body_position, abs=1e-15)


def test_on_a_slope_the_body_slides_off_the_ice_and_is_held_beside_it():
    device = block(0.0, ground__slope=0.1)
    device.advance_to(1.0)
    assert device.state.body_position == 0.0  # held by 0.3
    device.fail("friction_patch", LONG, value=0.05, from_x=-0.2, to_x=0.5)
    device.advance_to(5.0)
    pull, braking = math.sin(0.1) - 0.05 * math.cos(0.1), 0.3 * math.cos(0.1) - math.sin(0.1)
    assert device.state.body_position == pytest.approx(-0.2 - 0.2 * pull / braking, abs=1e-12)
    assert device.state.body_velocity == 0.0


def test_a_body_that_is_put_on_a_patch_feels_it_and_a_floor_that_changes_is_that_beside_it():
    device = block(0.0)
    device.fail("friction_patch", LONG, value=0.1, from_x=1.0, to_x=2.0)
    weight = device.scene.total_mass * GRAVITY
    for position, friction in ((1.5, 0.1), (0.0, 0.3), (3.0, 0.3), (1.0, 0.1), (2.0, 0.3), (0.0, 0.3)):  # forwards
        device.set_state(body_position=position, body_velocity=1.0)
        assert device.state.friction_force == pytest.approx(friction * weight, rel=1e-13)
    device.set_parameters({"ground.friction": 0.2})
    assert device.state.friction_force == pytest.approx(0.2 * weight, rel=1e-13)
    device.set_state(body_position=1.5)
    device.set_parameters({"ground.friction": 0.7})
    assert device.state.friction_force == pytest.approx(0.1 * weight, rel=1e-13)
    device.fail("friction_patch", 0.0)
    assert device.state.friction_force == pytest.approx(0.7 * weight, rel=1e-13) and not device.disturbances


def test_a_body_that_lands_on_ice_after_a_flight_over_its_edge_keeps_its_momentum():
    device = running("device", motor__speed=0.0, ground__restitution=0.0)
    total, scene, along_x = device.scene.total_mass, device.scene, device.scene.direction("inclined")[0]

    def momentum() -> float:
        return total * device.state.body_velocity + along_x * scene["mass.inclined"] * device.state.inclined_velocity

    device.fail("friction_patch", LONG, value=0.0, from_x=0.1, to_x=100.0)
    device.set_state(body_velocity=1.0, body_vertical_velocity=2.0, body_height=0.01)
    momentum_before = momentum()
    device.advance_to(2.0)
    landings = [event["time"] for event in device.take_events() if event["kind"] == "landing"]
    assert landings and device.state.body_position > 1.0
    assert momentum() == pytest.approx(momentum_before, abs=1e-12)


def test_the_filtered_acceleration_follows_the_body_over_an_edge():
    scene = block(0.0).scene
    device, other = (vibro_ros.Simulator(scene, acceleration_bandwidth=100.0) for _ in range(2))
    for each in (device, other):
        each.set_state(body_velocity=2.0)
    device.fail("friction_patch", LONG, value=0.05, from_x=0.1, to_x=9.0)
    deceleration = 0.3 * GRAVITY
    other.advance_to((2.0 - math.sqrt(4.0 - 2.0 * deceleration * 0.1)) / deceleration)  # at the edge
    other.set_parameters({"ground.friction": 0.05})
    for time in (other.time + 1e-4, other.time + 3e-3, 0.5):
        for each in (device, other):
            each.advance_to(time)
        assert device.filtered_acceleration() == pytest.approx(other.filtered_acceleration(), abs=1e-11)
    assert device.filtered_acceleration()[0] == pytest.approx(-0.05 * GRAVITY, rel=1e-12)


@pytest.mark.parametrize("scene", ["device", "damped", "rigid"])
def test_the_first_edge_is_where_bisection_finds_it_and_the_floor_changes_there(scene: str):
    device = running(scene)
    device.push(0.5, force_x=-3.0)
    device.advance_to(0.1)
    begun = device.checkpoint()
    edge = device.state.body_position - 0.01
    device.fail("friction_patch", LONG, value=0.05, from_x=-100.0, to_x=edge)
    other = running(scene)
    other.restore(begun)
    # Samples a millisecond apart find the first one behind the edge; bisection goes on from there.
    times = 0.1 + 1e-3 * np.arange(400)
    last = int(np.argmax(other.sample(times).body_position < edge)) - 1
    low, high = times[last], times[last + 1]
    while low < 0.5 * (low + high) < high:
        middle = 0.5 * (low + high)
        other.restore(begun)
        other.advance_to(middle)
        low, high = (middle, high) if other.state.body_position >= edge else (low, middle)
    other.restore(begun)
    other.advance_to(high)
    other.set_parameters({"ground.friction": 0.05})
    for each in (device, other):
        each.advance_to(high + 0.05)
    assert device.state.body_position < edge - 1e-4
    for name in ("body_position", "body_velocity", "upper_position", "inclined_velocity"):
        assert getattr(device.state, name) == pytest.approx(getattr(other.state, name), abs=1e-11), name


@pytest.mark.parametrize(("changes", "words"), [
    ({"solver__method": "rk4"}, "solver.method rk4 does not find; choose exact"),
    ({"effects__friction": "none"}, "needs friction on a body that moves"),
    ({"effects__inclined_mass": False}, "needs friction on a body that moves")])
def test_a_device_without_such_ground_refuses_a_patch(changes: dict, words: str):
    device = running("unilateral", **changes)
    with pytest.raises(ValueError, match=words):
        device.fail("friction_patch", 1.0, value=0.1, from_x=0.0, to_x=1.0)
    with pytest.raises(ValueError, match="duration: 0 s ends a friction_patch, and none lasts"):
        device.fail("friction_patch", 0.0)
