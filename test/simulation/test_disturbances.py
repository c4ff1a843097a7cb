"""A push on the body and faults of the device: exact, ended at their instants, independent of how time is divided."""

import math

import numpy as np
import pytest
from commanded_device import assert_go_on_alike, refused, running

import vibro_ros

GRAVITY = 9.81


def block() -> vibro_ros.Simulator:
    """A body whose masses hang at rest on sliders that stand still, away from their plates."""
    device = running("damped", motor__speed=0.0, upper__gap=0.03, inclined__gap=0.03)
    device.advance_to(0.1)
    assert device.state.body_velocity == 0.0
    return device


def test_a_pushed_block_slides_as_far_as_newton_and_coulomb_say():
    device = block()
    mass, friction = device.scene.total_mass, device.scene["ground.friction"]
    device.push(0.1, force_x=5.0)
    speed = (5.0 / mass - friction * GRAVITY) * 0.1
    device.advance_to(0.2)
    assert device.state.body_velocity == pytest.approx(speed, rel=1e-13)
    device.advance_to(1.0)
    assert device.state.body_position == pytest.approx(0.5 * speed * 0.1 + speed**2 / (2.0 * friction * GRAVITY),
                                                       rel=1e-12)


@pytest.mark.parametrize(("share", "moves"), [(1.0 - 1e-9, False), (1.0 + 1e-9, True)])
def test_a_push_below_the_bound_of_friction_moves_nothing(share: float, moves: bool):
    device = block()
    device.push(0.5, force_x=-share * device.scene["ground.friction"] * device.scene.total_mass * GRAVITY)
    device.advance_to(0.3)
    assert (device.state.body_velocity < 0.0) == moves
    assert device.state.friction_force == pytest.approx(-share * 0.2 * device.scene.total_mass * GRAVITY, rel=1e-8)


def test_a_short_push_is_a_blow():
    device = block()
    device.push(1e-6, force_x=1e5)  # 0.1 N s
    device.advance_to(0.1 + 1e-6)
    assert device.state.body_velocity == pytest.approx(0.1 / device.scene.total_mass, rel=1e-4)


def test_the_momentum_of_a_body_that_is_thrown_up_is_the_push_s_and_gravity_s():
    device = running("device", ground__restitution=0.0)
    total, scene = device.scene.total_mass, device.scene

    def momentum() -> np.ndarray:
        state, (along_x, upwards) = device.state, scene.direction("inclined")
        upper, inclined = scene["mass.upper"] * state.upper_velocity, scene["mass.inclined"] * state.inclined_velocity
        return np.array([total * state.body_velocity + along_x * inclined,
                         total * state.body_vertical_velocity + upper + upwards * inclined])

    device.push(0.3, force_z=3.0 * total * GRAVITY, force_x=2.0)
    device.advance_to(0.2)
    momentum_before = momentum()
    assert device.state.body_height > 0.1
    device.advance_to(0.35)  # the push ends at 0.3 s
    change = [2.0 * 0.1, 2.0 * total * GRAVITY * 0.1 - total * GRAVITY * 0.05]
    assert momentum() - momentum_before == pytest.approx(change, abs=1e-12)


def test_a_part_follows_its_last_command_after_a_fault():
    device = running("device")
    device.fail("motor_stall", 1.0)
    device.fail("plate_stuck", 1.0, of="inclined")
    device.command(motor_speed=80.0, inclined_gap=0.001)
    place = device.state.inclined_plate_position
    device.advance_to(0.9)
    assert device.commanded_motor_speed == 80.0
    assert device.state.motor_speed == 0.0 and device.state.inclined_plate_position == place
    device.set_parameters({"ground.friction": 0.1})
    device.advance_to(2.0)
    assert device.state.motor_speed == 80.0 and not device.disturbances
    assert device.state.inclined_plate_position == device.scene["crank.inclined_rod"] + 0.001


def test_a_duration_of_zero_and_a_reset_end_disturbances():
    device, untouched = running("damped"), running("damped")
    for which in (lambda: device.push(0.0), lambda: device.fail("motor_stall", 0.0), device.reset):
        device.push(5.0, force_x=1.0)
        device.fail("motor_stall", 5.0)
        which()
    assert not device.disturbances
    assert_go_on_alike(device, untouched, 0.2)


def patch(**changes: object) -> dict[str, object]:
    """The arguments of a fault that the device accepts, a patch of ground ahead of it, with changes."""
    return {"fault": "friction_patch", "duration": 1.0, "value": 0.1, "from_x": 0.0, "to_x": 1.0} | changes


@pytest.mark.parametrize(("ask", "words"), [
    (lambda device: device.push(math.inf, force_x=1.0), "duration: inf is not finite"),
    (lambda device: device.push(1e9, force_x=1.0), "from 0 to 86400 s"),
    (lambda device: device.push(1.0, force_x=math.nan), "force_x: nan is not finite"),
    (lambda device: device.push(1.0, force_z=5.0), "stays on the ground"),
    (lambda device: device.push(0.0), "duration: 0 s ends a push, and none lasts; give a duration above 0"),
    (lambda device: device.push(0.0, force_x=5.0), "duration: 0 s with a force of 5 N along x and 0 N upwards pushes"),
    (lambda device: device.push(1.0), "give a duration and a force, or neither to end the present push"),
    (lambda device: device.fail("motor_stall", 0.0), "duration: 0 s ends a motor_stall, and none lasts"),
    (lambda device: device.fail("plate_stuck", 0.0, of="upper"), "ends a plate_stuck of upper, and none lasts"),
    (lambda device: device.fail("earthquake", 1.0), "fault: 'earthquake' is unknown; choose one of motor_stall"),
    (lambda device: device.fail("plate_stuck", 1.0), "of: '' has no plate_stuck; give upper or inclined"),
    (lambda device: device.fail("motor_stall", 1.0, of="upper"), "give nothing"),
    (lambda device: device.fail("supply_sag", 1.0, value=9.0), "befalls a dc motor, and this one is ideal"),
    (lambda device: device.fail("supply_sag", 1.0), "value: 0 is out of range"),
    (lambda device: device.fail("lost_commands", 1.0), "befalls commands, which this device does not have"),
    (lambda device: device.fail(["motor_stall"], 1.0), "fault"),
    (lambda device: device.fail("motor_stall", "long"), "duration: 'long' is not a number"),
    *((lambda device, changes=changes: device.fail(**patch(**changes)), words) for changes, words in (
        ({"from_x": 1.0}, "to_x: 1 m does not lie ahead of from_x, 1 m; give a greater one"),
        ({"from_x": math.nan}, "from_x: nan is not finite"), ({"from_x": -1e300}, "from_x: -1e[+]300 is out of range"),
        ({"from_x": "here"}, "from_x: 'here' is not a number"), ({"value": -0.1}, "value: -0.1 is out of range"),
        ({"value": 900.0}, "value: as on a patch, ground.friction: at 900 the reaction"),
        ({"of": "upper"}, "of: 'upper' has no friction_patch; give nothing"),
        ({"fault": "motor_stall", "value": 0.0, "from_x": 1.0, "to_x": 0.0}, "from_x: 1 is out of range"),
        ({"duration": 0.0, "value": 0.0}, "to_x: 1 is out of range")))])
def test_an_impossible_disturbance_is_refused_and_changes_nothing(ask, words: str):
    device = running("unilateral", effects__reaction=True)
    device.advance_to(0.1)
    with refused(device, words):
        ask(device)
