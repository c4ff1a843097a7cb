"""Waiting until a robot listens, which may be compiling before it does."""

import time
from collections.abc import Sequence

from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher

from vibro_ros.configuration.scene_file import NODE_NAME
from vibro_ros.process.stop_signals import StopRequest
from vibro_ros.ros.node import process

REPORTS = 10.0
"""Time [s] between two lines that say what is waited for."""


def deaf(publishers: Sequence[Publisher]) -> list[str]:
    """Topics of `publishers` that nobody subscribes to."""
    return [publisher.topic_name for publisher in publishers if publisher.get_subscription_count() == 0]


def wait_for_listeners(node: Node, executor: Executor, publishers: Sequence[Publisher], patience: float,
                       stop: StopRequest) -> None:
    """Return when somebody subscribes to every one of `publishers`, or on `stop`.

    A robot subscribes when it can obey, not before: what is sent to one that compiles would be applied in a burst.

    Parameters
    ----------
    patience : float
        Longest wait [s]; 0 waits without end, and says every `REPORTS` what for.

    Raises
    ------
    RuntimeError
        When `patience` is over.
    """
    begun, log = time.monotonic(), node.get_logger()
    limit = f"up to {patience:g} s " if patience else ""
    log.info(f"waiting {limit}for a robot on {', '.join(publisher.topic_name for publisher in publishers)}")
    due = REPORTS

    def over() -> bool:
        nonlocal due
        topics, waited = deaf(publishers), time.monotonic() - begun
        if topics and not stop and waited >= due:
            due += REPORTS
            log.info(f"waiting for {waited:.0f} s: nobody listens to {', '.join(topics)}; {_remedy(node)}")
        return bool(stop or not topics or (patience and waited > patience))

    process.spin_until(executor, over)
    if (topics := deaf(publishers)) and not stop:
        raise RuntimeError(f"no robot listens to {', '.join(topics)} after {patience:g} s; {_remedy(node)}")


def _remedy(node: Node) -> str:
    """What a user can do; a robot that is there and does not listen is starting, or is another's."""
    robots = sorted(f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces()
                    if name == NODE_NAME)  # unless it is remapped
    if robots:
        return (f"{', '.join(robots)} is there and does not: it compiles at its first start, or has another namespace "
                "or other topics")
    return "start one (ros2 run vibro_ros robot), in the same ROS domain and namespace"
