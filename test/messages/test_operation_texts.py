"""The texts of operations in a recording, including operations that no device can have performed."""

import pytest

import vibro_ros
from vibro_ros.messages.operations import (
    ARGUMENTS,
    FAULT,
    NAMES,
    PUSH,
    RESET,
    SET,
    STATE,
    STEP,
    Operation,
    perform,
    read_operation,
)


@pytest.mark.parametrize("operation", [
    *(Operation(name) for name in NAMES if name not in (STEP, *ARGUMENTS)), Operation(STEP, steps=7),
    Operation(STATE, parameters={"body_velocity": 1.0 / 3.0}),
    Operation(RESET, parameters={"body_velocity": 1.0 / 3.0}),
    Operation(PUSH, parameters={"duration": 0.1, "force_x": -1e-300, "force_z": 0.0}),
    Operation(FAULT, parameters={"fault": "friction_patch", "of": "", "duration": 0.1, "value": 0.02,
                                 "from_x": -1.0 / 3.0, "to_x": 1e-300}),
    Operation(SET, parameters={"ground.friction": 0.1 + 0.2, "rate.real_time_factor": 1e-300})])
def test_an_operation_survives_its_text_to_the_last_bit(operation: Operation):
    assert read_operation(str(operation)) == operation


@pytest.mark.parametrize("text", [
    "", "rest", "reset now", "step", "step many", "step " + "9" * 10_000, "set", "set []", "set 1", "set {", "\0",
    "set " + "[" * 100_000, "x" * 1_000_000, "push", "push {}", 'push {"duration": 1.0}', "state", "state 1",
    "fault {}", 'fault {"fault": "motor_stall", "duration": 1.0, "of": "", "value": 0.0}',
    'fault {"fault": "motor_stall", "duration": 1.0, "of": "", "value": 0.0, "from_x": 0.0, "to_x": 0.0, "more": 1}'])
def test_a_text_that_is_no_operation_is_refused_in_one_line(text: str):
    with pytest.raises(ValueError, match="is no operation of the robot") as refused:
        read_operation(text)
    assert len(str(refused.value)) < 300 and "\n" not in str(refused.value)


@pytest.mark.parametrize("text", [
    'set {"ground.friction": -1.0}', 'set {"ground.friction": [0.1]}', f'set {{"ground.friction": {10**400}}}',
    'set {"ground.friction": 0.1, "motor.max_speed": "fast"}', 'reset {"self": 1.0}', 'state {"body_velocity": NaN}',
    'state {"body_velocity": "fast"}', 'push {"duration": [1], "force_x": {}, "force_z": 0}',
    'fault {"fault": ["motor_stall"], "duration": 1.0, "of": {}, "value": null, "from_x": [], "to_x": "far"}',
    'fault {"fault": "friction_patch", "duration": 1.0, "of": "", "value": 0.1, "from_x": NaN, "to_x": 1.0}',
    'fault {"fault": "sensor_dropout", "duration": 1.0, "of": "imu", "value": 0.0, "from_x": 0.0, "to_x": 0.0}'])
def test_an_operation_that_no_robot_performed_changes_nothing(text: str):
    device = vibro_ros.Simulator(vibro_ros.load_scene("device"))
    device_before = device.scene, device.state, device.disturbances
    with pytest.raises(ValueError, match="give|choose|does not have"):
        perform(read_operation(text), device)
    assert (device.scene, device.state, device.disturbances) == device_before


@pytest.mark.parametrize("text", ["pause", "resume", "step 3", 'set {"rate.real_time_factor": 3.0}', "set {}",
                                  'fault {"fault": "lost_commands", "duration": 9.0, "of": "", "value": 0.0, '
                                  '"from_x": 0.0, "to_x": 0.0}'])
def test_pauses_and_steps_do_not_change_the_device(text: str):
    device = vibro_ros.Simulator(vibro_ros.load_scene("device").with_parameters({"motor.speed": 100.0}))
    device.advance_to(0.1)
    checkpoint = device.checkpoint().tolist()
    perform(read_operation(text), device)
    assert device.checkpoint().tolist() == checkpoint
