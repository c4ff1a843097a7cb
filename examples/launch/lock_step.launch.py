"""A robot that waits for its controller at each sample, so that two runs have equal bags.

ros2 launch vibro_ros lock_step.launch.py
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
)
from launch.event_handlers import OnProcessExit, OnProcessIO
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node, SetParameter
from launch_ros.ros_adapters import get_ros_node
from launch_ros.substitutions import FindPackageShare
from std_srvs.srv import SetBool

ROBOT = PathJoinSubstitution([FindPackageShare("vibro_ros"), "launch", "robot.launch.py"])
WAITS = {"clock.publish": True, "clock.lock_step": "[vibro_controller]", "rate.start_paused": True,
         "rate.real_time_factor": 0.0}


def generate_launch_description():
    """Return the robot, paused, and its controller; robot time begins when the script has begun, and ends with it."""
    robot = GroupAction([*(SetParameter(name, value) for name, value in WAITS.items()),
                         IncludeLaunchDescription(ROBOT)])
    controller = Node(package="vibro_ros", executable="controller", output="screen",
                      namespace=LaunchConfiguration("namespace"), parameters=[{"use_sim_time": True}],
                      arguments=[LaunchConfiguration("script"), "--launched"])
    pause = None

    def find_robot(context):
        nonlocal pause
        space = LaunchConfiguration("namespace").perform(context).strip("/")
        pause = get_ros_node(context).create_client(SetBool, f"/{space}/vibro_robot/pause".replace("//", "/"))

    def resume(event):  # the log is on stderr, or on stdout where RCUTILS_LOGGING_USE_STDOUT is 1
        nonlocal pause
        if b"entry 1" in event.text and pause:
            pause.wait_for_service(10.0)
            pause.call_async(SetBool.Request(data=False))
            pause = None

    def end(_, context):  # not a second time: after Ctrl-C, launch_ros takes a second Shutdown for an error
        return None if context.is_shutdown else Shutdown()

    return LaunchDescription([
        DeclareLaunchArgument("script", default_value="crawl", description="a shipped script's name, or a file"),
        DeclareLaunchArgument("namespace", default_value="", description="namespace of both, such as r1"),
        OpaqueFunction(function=find_robot), robot, controller,
        RegisterEventHandler(OnProcessIO(target_action=controller, on_stdout=resume, on_stderr=resume)),
        RegisterEventHandler(OnProcessExit(target_action=controller, on_exit=end))])
