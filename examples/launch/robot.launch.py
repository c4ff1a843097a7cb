"""A robot: ros2 launch vibro_ros robot.launch.py scene:=damped."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PARAMETERS = {"scene": ("scene", str), "record_directory": ("record.directory", str),
              "frame_prefix": ("frame_prefix", str), "use_sim_time": ("use_sim_time", bool)}


def robot(context):
    """Return the robot, with the parameters of those arguments alone that are given."""
    given = {name: value for name in (*PARAMETERS, "namespace", "params_file")
             if (value := LaunchConfiguration(name).perform(context))}
    return [Node(package="vibro_ros", executable="robot", output="screen", namespace=given.get("namespace"),
                 ros_arguments=["--params-file", given["params_file"]] if "params_file" in given else None,
                 parameters=[{parameter: ParameterValue(LaunchConfiguration(name), value_type=kind)
                              for name, (parameter, kind) in PARAMETERS.items() if name in given}])]


def generate_launch_description():
    """Return the robot, with its arguments."""
    return LaunchDescription([
        DeclareLaunchArgument("scene", default_value="", description="a shipped scene's name, or a file"),
        DeclareLaunchArgument("record_directory", default_value="", description="where the bag's folder is made"),
        DeclareLaunchArgument("namespace", default_value="", description="namespace of the robot, such as r1"),
        DeclareLaunchArgument("params_file", default_value="", description="a ROS parameter file for the robot"),
        DeclareLaunchArgument("use_sim_time", default_value="", description="true: take the time from /clock"),
        DeclareLaunchArgument("frame_prefix", default_value="", description="begin of each frame's name, such as r1/"),
        OpaqueFunction(function=robot)])
