"""Two robots, each with a controller, kept apart by namespaces: ros2 launch vibro_ros two_robots.launch.py."""

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    """Return the robots r1 and r2, which stop their motors when their controllers die, and what commands them."""
    return LaunchDescription([
        one for name, script in (("r1", "crawl"), ("r2", "pulses")) for one in (
            Node(package="vibro_ros", executable="robot", namespace=name, output="screen",
                 parameters=[{"frame_prefix": f"{name}/", "command.timeout": 1.0}]),
            Node(package="vibro_ros", executable="controller", namespace=name, output="screen", arguments=[script]))])
