"""A robot: ros2 launch vibro_ros robot.launch.py scene:=damped."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    """Return the robot, with its arguments."""
    return LaunchDescription([
        DeclareLaunchArgument("scene", default_value="device", description="a shipped scene's name, or a file"),
        DeclareLaunchArgument("record_directory", default_value=".", description="where the bag's folder is made"),
        Node(package="vibro_ros", executable="robot", output="screen", parameters=[{
            "scene": ParameterValue(LaunchConfiguration("scene"), value_type=str),
            "record.directory": ParameterValue(LaunchConfiguration("record_directory"), value_type=str),
        }]),
    ])
