"""A robot, and RViz that shows it: ros2 launch vibro_ros robot_rviz.launch.py scene:=damped."""

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription, Shutdown
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """Return the robot of robot.launch.py, with its arguments, and RViz, whose end ends both."""
    share = FindPackageShare("vibro_ros")
    return LaunchDescription([
        IncludeLaunchDescription(PathJoinSubstitution([share, "launch", "robot.launch.py"])),
        Node(package="rviz2", executable="rviz2", on_exit=Shutdown(),
             arguments=["-d", PathJoinSubstitution([share, "config", "layouts", "robot.rviz"])]),
    ])
