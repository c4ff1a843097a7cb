"""How a recording tells operations, and what it may tell of a device that nobody could have asked for."""

import json

import pytest

import vibro_ros
from vibro_ros.messages.topics import NAMES, SET, STEP, Operation, perform, read_operation


@pytest.mark.parametrize("operation", [
    *(Operation(name) for name in NAMES if name not in (STEP, SET)), Operation(STEP, steps=7),
    Operation(SET, parameters={"ground.friction": 0.1 + 0.2, "rate.real_time_factor": 1e-300})])
def test_a_text_tells_an_operation_to_the_last_bit(operation: Operation):
    assert read_operation(str(operation)) == operation


@pytest.mark.parametrize("text", [
    "", "rest", "reset now", "step", "step many", "step " + "9" * 10_000, "set", "set []", "set 1", "set {", "\0",
    "set " + "[" * 100_000, "x" * 1_000_000])
def test_a_text_that_tells_none_is_refused_in_few_words(text: str):
    with pytest.raises(ValueError, match="is no operation of the robot") as refused:
        read_operation(text)
    assert len(str(refused.value)) < 300 and "\n" not in str(refused.value)


@pytest.mark.parametrize("parameters", [
    {"mass.body": 2.0}, {"ground.friction": -1.0}, {"ground.friction": None}, {"ground.friction": [0.1]},
    {"ground.friction": 10**400}, {"ground.friction": 0.1, "motor.max_speed": "fast"}])
def test_parameters_that_no_robot_took_change_nothing(parameters: dict):
    device = vibro_ros.Simulator(vibro_ros.load_scene("device"))
    before = device.scene, device.state
    with pytest.raises(ValueError, match=next(iter(parameters)) + "|motor.max_speed"):
        perform(read_operation(f"set {json.dumps(parameters)}"), device)
    assert (device.scene, device.state) == before


@pytest.mark.parametrize("text", ["pause", "resume", "step 3", 'set {"rate.real_time_factor": 3.0}', "set {}"])
def test_what_only_the_wall_clock_knows_leaves_the_device_alone(text: str):
    device = vibro_ros.Simulator(vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0}))
    device.advance_to(0.1)
    before = device.checkpoint().tolist()
    perform(read_operation(text), device)
    assert device.checkpoint().tolist() == before
