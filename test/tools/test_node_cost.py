"""The measurement of the whole robot against a bare node: real processes, and how the result is shown."""

import re
import signal
import time
from pathlib import Path

import pytest
from rclpy.serialization import serialize_message

from tools.bare_node import ready_messages
from tools.node_cost import BARE, table
from vibro_ros.configuration.scene_file import load_scene
from vibro_ros.messages.frames import Frames
from vibro_ros.messages.topics import ROBOT_TOPICS
from vibro_ros.ros.topics.messages import message_class, transforms
from vibro_ros.ros.topics.outputs import makers
from vibro_ros.simulation.simulator import Simulator

PATIENCE = 60.0  # [s]


@pytest.mark.quiet
def test_robot_and_bare_node_are_measured_and_nothing_stays_behind(start, tmp_path):
    measuring = start("node_cost", "--rates", "100", "--rounds", "1", "--settling", "0.1", "--duration", "0.5")
    assert measuring.end() == 0, measuring.text
    rows = re.findall(r"^\| 100 Hz \| ([\d.]+) % \| (.*) \| ([\d.]+) % \| ([\d.]+) \|$", measuring.text, re.MULTILINE)
    assert [case for _, case, _, _ in rows] == ["running", "standing still"]
    assert all(float(share) > 0.0 for bare, _, robot, _ in rows for share in (bare, robot))
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_measurement_ends_what_it_has_started(start):
    measuring = start("node_cost", "--rates", "20")
    measuring.wait_for("measuring")
    children = Path(f"/proc/{measuring.pid}/task/{measuring.pid}/children")
    deadline = time.monotonic() + PATIENCE
    while not (child := children.read_text().strip()):
        assert time.monotonic() < deadline, "no bare node was started"
    measuring.send(signal.SIGINT)
    assert measuring.end() == 130
    assert not Path(f"/proc/{child}").exists()


def test_the_bare_node_publishes_as_many_bytes_as_the_robot():
    scene = load_scene("device")
    state, ready = Simulator(scene).state, ready_messages()
    made = {topic: make(state, 0) for topic, make in makers(scene, "").items()}
    if "tf" in ready:
        frames = Frames(scene)
        made["tf"] = transforms(frames, state, frames.turns(state.crank_angle), 0)
    assert list(ready) == list(made)
    assert all(type(message) is message_class(ROBOT_TOPICS[topic]) for topic, message in ready.items())
    assert [len(serialize_message(message)) for message in ready.values()] == [
        len(serialize_message(message)) for message in made.values()]


def test_medians_over_rounds_and_the_median_of_their_ratios_are_shown():
    found = {(200.0, BARE): [0.1, 0.2, 0.3], (200.0, "running"): [0.3, 0.2, 0.15], (200.0, "standing still"): [0.1] * 3}
    shown = table(found)
    assert "| 200 Hz | 20.0 % | running | 20.0 % | 1.00 |" in shown
    assert "| 200 Hz | 20.0 % | standing still | 10.0 % | 0.50 |" in shown
