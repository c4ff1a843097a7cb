"""What `python -m tools.node_cost` compares the robot with: an rclpy node that publishes, and nothing else.

A publisher of each topic that has every sample, with the robot's types and quality of service, a thread that sleeps
until each deadline and publishes messages that lie ready, and an executor in the main thread, as every node has one. It
neither simulates nor records, and its messages are never changed.
"""

import argparse
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

import rclpy
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros.node import qos

NODE_NAME = "bare_node"
READY = "ready"
"""What it says once it publishes."""
_POLL = 1.0  # s, between two looks whether to end: next to no cost beside that of publishing
_PROFILES = {"tf": qos.TRANSFORMS}
_PARENTS = {"base_link": "odom", "crank": "base_link", "upper_rod": "crank", "inclined_rod": "crank",
            "upper_mass": "upper_guide", "inclined_mass": "inclined_guide", "upper_plate": "upper_guide",
            "inclined_plate": "inclined_guide"}
_JOINTS = ["crank", "upper_mass", "inclined_mass", "upper_plate", "inclined_plate"]


def ready_messages() -> Mapping[str, Any]:
    """A message of each topic that has every sample, as large as the robot's in the scene `device`."""
    odometry = Odometry(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    joints = JointState(name=_JOINTS, position=[1.0] * 5, velocity=[2.0] * 5, effort=[3.0] * 5)
    contact = WrenchStamped()
    joints.header.frame_id = contact.header.frame_id = "base_link"
    return {"odom": odometry, "joint_states": joints, "ground_contact": contact, "motor_power": Float64(data=1.0),
            **_transforms()}


def _transforms() -> Mapping[str, Any]:
    """The message of tf, where its type is not missing."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return {}
    message = TFMessage()
    message.transforms = [TransformStamped(child_frame_id=child) for child in _PARENTS]
    for transform, parent in zip(message.transforms, _PARENTS.values(), strict=True):
        transform.header.frame_id = parent
    return {"tf": message}


class Publishing:
    """A thread that publishes a message of each topic at a rate [Hz]; a context manager."""

    def __init__(self, node: Node, rate: float):
        self._rate = rate
        self._messages = [(node.create_publisher(type(message), topic, _PROFILES.get(topic, qos.SAMPLES)), message)
                          for topic, message in ready_messages().items()]
        self._over = False
        self._thread = threading.Thread(target=self._run, name="publishing")

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()

    def _run(self) -> None:
        start, tick = time.monotonic(), 0
        while not self._over:
            for publisher, message in self._messages:
                publisher.publish(message)
            tick += 1
            time.sleep(max(0.0, start + tick / self._rate - time.monotonic()))


def main(words: Sequence[str]) -> int:
    """Run the command line `words`; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=200.0, help="of publishing [Hz] (default %(default)g)")
    rate = parser.parse_args(words).rate
    with StopRequest() as stop:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        node, executor = Node(NODE_NAME), SingleThreadedExecutor()
        executor.add_node(node)
        with Publishing(node, rate):
            print(READY, flush=True)
            while not stop:
                executor.spin_once(timeout_sec=_POLL)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return stop.exit_code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
