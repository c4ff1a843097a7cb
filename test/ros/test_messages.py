"""Units, signs and frames of the messages, from a state whose every field is another number."""

from dataclasses import fields

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from vibro_ros.ros.topics import messages
from vibro_ros.simulation.samples import EVENT_DTYPE, Samples

STAMP = 1_763_700_000_123_456_789  # [ns]
# numpy scalars, as the simulator may give them: rclpy would serialise them to garbage where they are not cast
STATE = Samples(**{field.name: np.float32(i + 0.5) for i, field in enumerate(fields(Samples))})


def through_dds(message):
    """What a subscriber gets."""
    return deserialize_message(serialize_message(message), type(message))


def assert_stamped(message, frame: str) -> None:
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_763_700_000, 123_456_789)
    assert message.header.frame_id == frame


def test_odometry_is_along_x_above_the_ground():
    message = through_dds(messages.odometry(STATE, STAMP))
    assert_stamped(message, "odom")
    assert message.child_frame_id == "base_link"
    pose, twist = message.pose.pose, message.twist.twist
    assert (pose.position.x, pose.position.y, pose.position.z) == (STATE.body_position, 0.0, STATE.body_height)
    assert (pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w) == (0.0, 0.0, 0.0, 1.0)
    assert (twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.z) == (
        STATE.body_velocity, 0.0, STATE.body_vertical_velocity, 0.0)


def test_joints_have_position_velocity_and_effort():
    message = through_dds(messages.joint_states(STATE, ["crank", "inclined_mass", "upper_plate"], STAMP))
    assert_stamped(message, "base_link")
    assert list(message.name) == ["crank", "inclined_mass", "upper_plate"]
    assert list(message.position) == [STATE.crank_angle, STATE.inclined_position, STATE.upper_plate_position]
    assert list(message.velocity) == [STATE.motor_speed, STATE.inclined_velocity, STATE.upper_plate_velocity]
    assert list(message.effort) == [STATE.motor_torque, STATE.inclined_drive_force, STATE.upper_plate_force]


def test_the_ground_pushes_the_body_against_the_friction_of_the_paper():
    message = through_dds(messages.ground_contact(STATE, STAMP))
    assert_stamped(message, "base_link")
    force = message.wrench.force
    assert (force.x, force.y, force.z) == (-STATE.friction_force, 0.0, STATE.normal_force)


@pytest.mark.parametrize("side", ["upper", "inclined"])
def test_an_impact_pushes_its_plate_outwards(side):
    (event,) = np.array([(0.25, f"{side}_contact", 0.7, 812.5, 3e-4)], dtype=EVENT_DTYPE)
    message = through_dds(messages.impact(event, STAMP))
    assert_stamped(message, f"{side}_plate")
    force, torque = message.wrench.force, message.wrench.torque
    assert (force.x, force.y, force.z) == (0.0, 0.0, 812.5)
    assert (torque.x, torque.y, torque.z) == (0.0, 0.0, 0.0)


def test_power_is_a_plain_number():
    assert through_dds(messages.motor_power(STATE)).data == STATE.motor_power


def test_a_prefix_begins_the_name_of_every_frame_as_it_is():
    (event,) = np.array([(0.25, "upper_contact", 0.7, 812.5, 3e-4)], dtype=EVENT_DTYPE)
    odometry = through_dds(messages.odometry(STATE, STAMP, "r1/"))
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("r1/odom", "r1/base_link")
    assert through_dds(messages.joint_states(STATE, ["crank"], STAMP, "r1/")).header.frame_id == "r1/base_link"
    assert list(messages.joint_states(STATE, ["crank"], STAMP, "r1/").name) == ["crank"]
    assert through_dds(messages.ground_contact(STATE, STAMP, "r1_")).header.frame_id == "r1_base_link"
    assert through_dds(messages.impact(event, STAMP, "r1/")).header.frame_id == "r1/upper_plate"
