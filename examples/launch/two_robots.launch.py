"""Two robots, each with a controller, kept apart by namespaces: ros2 launch vibro_ros two_robots.launch.py."""

from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node, SetParameter
from launch_ros.substitutions import FindPackageShare

ROBOT = PathJoinSubstitution([FindPackageShare("vibro_ros"), "launch", "robot.launch.py"])


def robot_and_controller(name, script):
    """Return a robot, which stops its motor when its controller dies, and what commands it."""
    return [
        GroupAction([
            SetParameter("command.timeout", 1.0),
            IncludeLaunchDescription(ROBOT, launch_arguments={"namespace": name, "frame_prefix": f"{name}/"}.items())]),
        Node(package="vibro_ros", executable="controller", namespace=name, output="screen",
             arguments=[script, "--launched"])]


def generate_launch_description():
    """Return the robots r1 and r2, whose other arguments are those of robot.launch.py."""
    return LaunchDescription([*robot_and_controller("r1", "crawl"), *robot_and_controller("r2", "pulses")])
