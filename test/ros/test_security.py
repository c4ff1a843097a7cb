"""Requested security is enforced or refused in one line, and under `Enforce` never missing without an error."""

import os

import pytest


@pytest.fixture
def secured(tmp_path, monkeypatch):
    """Return a keystore with an empty enclave for the robot."""
    (tmp_path / "keys" / "enclaves" / "robot").mkdir(parents=True)
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", os.fspath(tmp_path / "keys"))


def test_a_robot_that_cannot_be_secured_does_not_start(secured, start):
    robot = start("robot", "--ros-args", "--enclave", "/robot")
    assert robot.end() == 2
    assert len(robot.lines) == 1, robot.text
    assert robot.text.startswith("robot: ROS refuses the arguments: ")
